from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import pytest

from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import INFINITE_MS, Durability, Liveliness, Reliability

if TYPE_CHECKING:
    from tests.backends.cyclone.conftest import Stage

CHANGED = EventKind.LIVELINESS_CHANGED
LOST = EventKind.LIVELINESS_LOST
LEASE = 100

BY_TOPIC = pytest.param(Liveliness.MANUAL_BY_TOPIC, id="by topic")
BY_NODE = pytest.param(Liveliness.MANUAL_BY_NODE, id="by node")


@pytest.mark.parametrize("liveliness", [Liveliness.NONE, Liveliness.AUTOMATIC, BY_TOPIC, BY_NODE])
def test_a_publisher_comes_and_leaves_in_order(stage: Stage, liveliness: Liveliness) -> None:
    publisher, subscription = stage.publisher(liveliness=liveliness), stage.subscription()
    changed = stage.log(subscription, CHANGED)
    near = stage.driven(stage.near)
    stage.until(lambda: changed.counts == (1, 0))
    publisher.destroy()
    stage.until(lambda: changed.counts == (0, 0))
    assert {event.thread for event in changed.events} == {near.thread.ident}


def test_publishers_from_before_the_registration_are_reported_by_the_next_drive(stage: Stage) -> None:
    subscription = stage.subscription()
    publishers = [stage.publisher(topic=topic) for topic in ("t", "t", "other", "t")]
    for publisher in (publishers[0], publishers[1], publishers[3]):
        stage.match(publisher, subscription)
    stage.near.drive_io(0)
    changed = stage.log(subscription, CHANGED)
    stage.near.drive_io(0)
    assert [event.status for event in changed.events] == [(3, 0, 3, 0)]


def test_each_subscription_has_its_own_count_also_in_the_publishers_session(stage: Stage) -> None:
    publisher = stage.publisher()
    logs = [
        stage.log(stage.subscription(stage.near), CHANGED),
        stage.log(stage.subscription(stage.near), CHANGED),
        stage.log(stage.subscription(stage.far), CHANGED),
        stage.log(stage.subscription(stage.far, topic="other"), CHANGED),
    ]
    stage.drive()
    stage.until(lambda: [log.counts for log in logs] == [(1, 0), (1, 0), (1, 0), (0, 0)])
    publisher.destroy()
    stage.until(lambda: [log.counts for log in logs] == [(0, 0)] * 4)


def test_a_silent_manual_publisher_is_lost_once_and_a_sample_brings_it_back(stage: Stage) -> None:
    publisher, subscription = stage.pair(liveliness=Liveliness.MANUAL_BY_TOPIC, lease_ms=LEASE)
    changed, lost = stage.log(subscription, CHANGED), stage.log(publisher, LOST)
    stage.drive()
    begin = stage.clock.now_ns()
    assert publisher.publish_raw(b"x") == ReturnCode.OK
    stage.until(lambda: lost.total == 1 and changed.counts == (0, 1))
    assert lost.events[0].at >= begin + LEASE * MS
    assert changed.events[-1].at >= begin + LEASE * MS
    stage.pause(2 * LEASE)
    assert lost.total == 1
    publisher.publish_raw(b"x")
    stage.until(lambda: lost.total == 2)
    # Back, and gone again; both may be seen in one look.
    assert changed.counts in ((1, 0), (0, 1))


def test_assertions_keep_silent_publishers_alive(stage: Stage) -> None:
    latest = stage.clock.now_ns()  # creation is the first assertion
    pairs = [
        stage.pair(topic=f"t{liveliness}{reliability}", liveliness=liveliness, lease_ms=LEASE, reliability=reliability)
        for liveliness in (Liveliness.MANUAL_BY_TOPIC, Liveliness.MANUAL_BY_NODE)
        for reliability in Reliability
    ]
    changed = [stage.log(subscription, CHANGED) for _, subscription in pairs]
    lost = [stage.log(publisher, LOST) for publisher, _ in pairs]
    stage.drive()
    end, longest = stage.clock.now_ns() + 3 * LEASE * MS, stage.clock.now_ns() - latest
    while stage.clock.now_ns() < end:
        latest = stage.clock.now_ns()
        assert [publisher.assert_liveliness() for publisher, _ in pairs] == [ReturnCode.OK] * 4
        stage.pause(LEASE // 8)
        longest = max(longest, stage.clock.now_ns() - latest)
    if longest < LEASE * MS // 2:  # else this host was too slow to say anything
        assert [log.events for log in lost] == [[]] * 4
        assert [log.counts for log in changed] == [(1, 0)] * 4


def test_by_node_one_assertion_covers_the_node_and_by_topic_only_the_publisher(stage: Stage) -> None:
    lease: dict[str, Any] = {"lease_ms": LEASE}
    one, other = (stage.publisher(liveliness=Liveliness.MANUAL_BY_NODE, **lease) for _ in range(2))
    elsewhere = stage.publisher(stage.near, liveliness=Liveliness.MANUAL_BY_NODE, **lease)
    by_topic = stage.publisher(liveliness=Liveliness.MANUAL_BY_TOPIC, **lease)
    logs = [stage.log(publisher, LOST) for publisher in (one, other, elsewhere, by_topic)]
    stage.drive()
    gone = threading.Event()
    longest = 0
    while not gone.is_set():
        before = stage.clock.now_ns()
        assert one.assert_liveliness() == ReturnCode.OK
        stage.pause(LEASE // 8)
        longest = max(longest, stage.clock.now_ns() - before)
        if logs[2].total == 1 and logs[3].total == 1:
            gone.set()
    if longest < LEASE * MS // 2:
        assert [log.total for log in logs] == [0, 0, 1, 1]


def test_what_is_not_manual_stays_alive_by_itself(stage: Stage) -> None:
    pairs = [
        stage.pair(topic=f"t{liveliness}", liveliness=liveliness, lease_ms=150)
        for liveliness in (Liveliness.NONE, Liveliness.AUTOMATIC)
    ]
    lost = [stage.log(publisher, LOST) for publisher, _ in pairs]
    changed = [stage.log(subscription, CHANGED) for _, subscription in pairs]
    stage.drive()
    assert [publisher.assert_liveliness() for publisher, _ in pairs] == [ReturnCode.OK] * 2
    stage.pause(500)
    assert [log.events for log in lost] == [[], []]
    assert [log.counts for log in changed] == [(1, 0), (1, 0)]
    assert [len(log.events) for log in changed] == [1, 1]


@pytest.mark.parametrize("lease_ms", [0, INFINITE_MS])
def test_a_lease_of_nothing_is_never_lost(stage: Stage, lease_ms: int) -> None:
    publisher, subscription = stage.pair(liveliness=Liveliness.MANUAL_BY_TOPIC, lease_ms=lease_ms)
    changed, lost = stage.log(subscription, CHANGED), stage.log(publisher, LOST)
    stage.drive()
    stage.pause(100)
    assert not lost.events
    assert changed.counts == (1, 0)


def test_a_session_cut_off_for_longer_than_its_lease_is_forgotten_and_found_again(stage: Stage) -> None:
    far = stage.open_session(node_name="cut", connection_lease_ms=150)
    subscription = stage.subscription()
    changed = stage.log(subscription, CHANGED)
    stage.match(stage.publisher(far), subscription)
    stage.drive()
    stage.until(lambda: changed.counts == (1, 0))
    assert far.deafmute(deaf=True, mute=True) == ReturnCode.OK
    cut = stage.clock.now_ns()
    stage.until(lambda: changed.counts == (0, 0))
    assert stage.clock.now_ns() - cut > 100 * MS
    assert far.deafmute(deaf=False, mute=False) == ReturnCode.OK
    stage.until(lambda: changed.counts == (1, 0))


def test_incompatible_ends_do_not_match_and_are_not_counted(stage: Stage) -> None:
    offers: tuple[dict[str, Any], ...] = (
        {"reliability": Reliability.BEST_EFFORT},
        {"durability": Durability.VOLATILE},
        {"deadline_ms": 200},
        {"liveliness": Liveliness.AUTOMATIC},
        {"liveliness": Liveliness.MANUAL_BY_TOPIC, "lease_ms": 500},
    )
    asks: tuple[dict[str, Any], ...] = (
        {"reliability": Reliability.RELIABLE},
        {"durability": Durability.TRANSIENT_LOCAL},
        {"deadline_ms": 100},
        {"liveliness": Liveliness.MANUAL_BY_TOPIC},
        {"liveliness": Liveliness.MANUAL_BY_TOPIC, "lease_ms": 400},
    )
    control = stage.publisher(topic="control")
    pairs = [
        (stage.publisher(topic=f"t{i}", **offer), stage.subscription(topic=f"t{i}", **ask))
        for i, (offer, ask) in enumerate(zip(offers, asks, strict=True))
    ]
    logs = [stage.log(subscription, CHANGED) for _, subscription in pairs]
    stage.match(control, stage.subscription(topic="control"))
    for publisher, subscription in pairs:
        assert stage.backend.await_matched(publisher, subscription, stage.clock.now_ns() + 10 * MS) is False
        publisher.publish_raw(b"x")
    stage.near.drive_io(20)
    assert [log.events for log in logs] == [[]] * 5
    assert [subscription.has_data() for _, subscription in pairs] == [False] * 5
