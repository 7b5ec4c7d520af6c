from __future__ import annotations

import functools
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import pytest

from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import CountStatus, EventKind
from nros_conformance.rmw.qos import Durability, History, Liveliness, QosProfile, Reliability

if TYPE_CHECKING:
    from nros_backends.zenoh.subscription import ZenohSubscription

LIVELINESS_CHANGED, REQUESTED, LOST, LIVELINESS_LOST, OFFERED = EventKind
SHORT = {"liveliness": Liveliness.MANUAL_BY_TOPIC, "lease_ms": 150}


def test_samples_and_events_come_on_the_driving_thread_and_wake_it(stage: Any) -> None:
    publisher, subscription = stage.pair()
    log = stage.log(subscription, LIVELINESS_CHANGED)
    called: list[int] = []
    subscription.set_message_callback(lambda context: called.append(threading.get_ident()), None)
    stage.drive(5)
    begin = time.monotonic()
    timer = threading.Timer(0.05, publisher.publish_raw, [b"sample"])
    timer.start()
    assert subscription.session.drive_io(4000) == ReturnCode.OK
    timer.join()
    assert time.monotonic() - begin < 2
    assert called == [threading.get_ident()]
    assert (log.last, log.threads) == (1, {threading.get_ident()})
    assert subscription.try_recv_raw(6) == b"sample"


def test_an_idle_drive_waits_its_time(stage: Any) -> None:
    session = stage.open()
    begin, used = time.monotonic(), time.thread_time()
    session.drive_io(100)
    session.drive_io(100)
    assert time.monotonic() - begin >= 0.19
    assert time.thread_time() - used < 0.05


def test_every_publisher_counts_once(stage: Any) -> None:
    near, far = stage.open(), stage.open()
    publishers = [stage.publisher(far), stage.publisher(near)]
    subscription = stage.subscription(near)
    log = stage.log(subscription, LIVELINESS_CHANGED)
    publishers += [stage.publisher(far), stage.publisher(far)]
    stage.publisher(far, topic="another")
    stage.until(lambda: log.last == 4)
    assert stage.backend.matched(subscription) == 4
    assert publishers[0].destroy() == ReturnCode.OK
    stage.until(lambda: log.last == 3)
    far.destroy()
    stage.until(lambda: log.last == 1)
    assert {status[1] for status in log.statuses} == {0}, "a token that goes does not say why"
    assert stage.backend.matched(publishers[1]) == 1


@pytest.mark.parametrize("liveliness", [Liveliness.MANUAL_BY_TOPIC, Liveliness.MANUAL_BY_NODE])
def test_a_manual_publisher_that_is_silent_is_lost_until_it_asserts(stage: Any, liveliness: Liveliness) -> None:
    subscription = stage.subscription(stage.open())
    log = stage.log(subscription, LIVELINESS_CHANGED)
    begin = stage.clock.now_ns()
    publisher = stage.publisher(stage.open(), liveliness=liveliness, lease_ms=150)
    lost = stage.log(publisher, LIVELINESS_LOST)
    stage.until(lambda: lost.last == 1 and log.statuses and log.last == 0)
    assert lost.times[0] - begin >= 150 * MS
    assert log.times[-1] - begin >= 150 * MS
    stage.drive(200)
    assert lost.last == 1, "silence that goes on is no new loss"
    assert publisher.assert_liveliness() == ReturnCode.OK
    stage.until(lambda: log.last == 1)
    stage.until(lambda: lost.last == 2 and log.last == 0)


def test_others_see_a_manual_publisher_lost_whose_application_hangs(peers: Any) -> None:
    subscription = peers.subscription(peers.open())
    log = peers.log(subscription, LIVELINESS_CHANGED)
    hanging = peers.open()
    peers.publisher(hanging, **SHORT)
    peers.sessions.remove(hanging)  # nobody drives it
    peers.until(lambda: log.last == 1)
    peers.until(lambda: log.last == 0)
    hanging.destroy()


def test_publishing_asserts_and_automatic_neighbours_do_not(peers: Any) -> None:
    session = peers.open()
    publisher = peers.publisher(session, **SHORT)
    peers.publisher(session, topic="other", liveliness=Liveliness.AUTOMATIC, lease_ms=150)
    lost = peers.log(publisher, LIVELINESS_LOST)
    for _ in range(6):
        last = peers.clock.now_ns()
        publisher.publish_raw(b"alive")
        peers.drive(50)
    assert lost.last == 0
    peers.until(lambda: lost.last == 1)
    assert lost.times[0] - last >= 150 * MS


def test_one_assertion_covers_the_node_and_nobody_else(peers: Any) -> None:
    by_node = {"liveliness": Liveliness.MANUAL_BY_NODE, "lease_ms": 150}
    session = peers.open()
    first, second = peers.publisher(session, **by_node), peers.publisher(session, topic="u", **by_node)
    by_topic, elsewhere = peers.publisher(session, **SHORT), peers.publisher(peers.open(), **by_node)
    logs = [peers.log(publisher, LIVELINESS_LOST) for publisher in (first, second, by_topic, elsewhere)]
    for _ in range(6):
        assert first.assert_liveliness() == ReturnCode.OK
        peers.drive(50)
    assert [log.last for log in logs] == [0, 0, 1, 1]


def test_missed_deadlines_are_counted_by_periods_at_both_ends(stage: Any) -> None:
    publisher, subscription = stage.pair(deadline_ms=100)
    offered, requested = stage.log(publisher, OFFERED), stage.log(subscription, REQUESTED)
    stage.drive(150)
    assert (offered.last, requested.last) == (0, 0), "not before the first sample"
    publisher.publish_raw(b"first")
    begin = stage.clock.now_ns()
    subscription.session.drive_io(10)
    time.sleep(0.35)
    stage.drive(5)
    periods = (stage.clock.now_ns() - begin) // (100 * MS)
    assert offered.statuses == [CountStatus(offered.last, offered.last)]
    assert 3 <= offered.last <= periods + 1
    assert requested.last in (offered.last, offered.last - 1)


def test_a_deadline_of_the_registration_begins_with_the_next_sample_received(peers: Any) -> None:
    publisher, subscription = peers.pair()
    log = peers.log(subscription, REQUESTED, 100)
    publisher.publish_raw(b"data")
    begin = peers.clock.now_ns()
    peers.until(lambda: log.last == 1)
    assert log.times[0] - begin >= 100 * MS


@pytest.mark.parametrize("variant", ["peer", "router"])
@pytest.mark.parametrize("reliability", list(Reliability))
def test_frames_taken_out_of_the_wire_are_counted_exactly(
    make_stage: Callable[..., Any], variant: str, reliability: Reliability
) -> None:
    stage = make_stage(variant, "lose")
    publisher, subscription = stage.pair(reliability=reliability, depth=64)
    log = stage.log(subscription, LOST)

    def publish() -> int:
        return int(publisher.publish_raw(b"gone"))

    publisher.publish_raw(b"head")
    assert stage.backend.inject("lose", entity=publisher, count=3, publish=publish) == ReturnCode.OK
    publisher.publish_raw(b"between")
    assert stage.backend.inject("lose", entity=publisher, count=20, publish=publish) == ReturnCode.OK
    publisher.publish_raw(b"tail")
    assert stage.receive(subscription, 3) == [b"head", b"between", b"tail"]
    stage.until(lambda: log.last == 23)
    stage.drive(20)
    assert log.last == 23


@pytest.mark.parametrize("variant", ["peer", "router"])
def test_losing_for_longer_than_a_lease_leaves_the_connection_alone(
    make_stage: Callable[..., Any], variant: str
) -> None:
    stage = make_stage(variant, "lose")
    publisher, subscription = stage.pair(reliability=Reliability.BEST_EFFORT, depth=64)
    lost, matched = stage.log(subscription, LOST), stage.log(subscription, LIVELINESS_CHANGED)

    def publish() -> int:
        stage.drive(20)
        return int(publisher.publish_raw(b"gone"))

    publisher.publish_raw(b"head")
    assert stage.backend.inject("lose", entity=publisher, count=50, publish=publish) == ReturnCode.OK
    publisher.publish_raw(b"tail")
    assert stage.receive(subscription, 2) == [b"head", b"tail"]
    stage.until(lambda: lost.last == 50)
    assert [tuple(status) for status in matched.statuses] == [(1, 0, 1, 0)]


def test_duplicates_arrive_once_and_what_was_overtaken_arrives(peers: Any) -> None:
    publisher, subscription = peers.pair(depth=64)
    log = peers.log(subscription, LOST)
    numbers = iter(range(100))

    def publish() -> int:
        return int(publisher.publish_raw(b"%d" % next(numbers)))

    publish()
    assert peers.backend.inject("duplicate", entity=publisher, count=3, publish=publish) == ReturnCode.OK
    assert peers.receive(subscription, 4) == [b"0", b"1", b"2", b"3"]
    assert peers.backend.inject("reorder", entity=publisher, count=3, publish=publish) == ReturnCode.OK
    assert peers.receive(subscription, 3) == [b"6", b"4", b"5"]
    peers.drive(30)
    assert log.last == 0
    assert subscription.try_recv_raw(10) == ReturnCode.NO_DATA


def test_overflow_is_lost_and_the_newest_stay(peers: Any) -> None:
    publisher, subscription = peers.pair(depth=4)
    log = peers.log(subscription, LOST)
    for number in range(10):
        publisher.publish_raw(b"%d" % number)
    peers.until(lambda: log.last == 6)
    assert peers.receive(subscription, 4) == [b"6", b"7", b"8", b"9"]


def test_a_sample_larger_than_the_buffer_is_lost(peers: Any) -> None:
    publisher, subscription = peers.pair()
    log = peers.log(subscription, LOST)
    publisher.publish_raw(b"too large")
    publisher.publish_raw(b"")
    peers.until(subscription.has_data)
    peers.drive(5)
    assert subscription.try_recv_raw(3) == ReturnCode.BUFFER_TOO_SMALL
    assert peers.receive(subscription, 1) == [b""]
    peers.until(lambda: log.last == 1)


def test_late_subscriptions_get_what_a_transient_local_publisher_keeps(stage: Any) -> None:
    keeps = {"durability": Durability.TRANSIENT_LOCAL, "depth": 3}
    publisher = stage.publisher(stage.open(), **keeps)
    for number in range(8):
        publisher.publish_raw(b"%d" % number)
    plain = stage.open()  # not before: a peer whose link is new is sent all samples, subscribed to or not
    late = stage.subscription(plain, durability=Durability.TRANSIENT_LOCAL, depth=2)
    volatile = stage.subscription(plain)
    log = stage.log(late, LOST)
    stage.match(publisher, late)
    stage.match(publisher, volatile)
    assert stage.receive(late, 2) == [b"6", b"7"]
    stage.drive(20)
    publisher.publish_raw(b"new")
    assert stage.receive(late, 1) == [b"new"]
    assert stage.receive(volatile, 1) == [b"new"]
    stage.drive(20)
    assert log.last == 0, "history that has no room is not lost"


def test_samples_expire_and_are_not_lost(peers: Any) -> None:
    publisher, subscription = peers.pair(lifespan_ms=60)
    log = peers.log(subscription, LOST)
    publisher.publish_raw(b"stale")
    peers.until(subscription.has_data)
    peers.drive(70)
    assert subscription.has_data() is False
    publisher.publish_raw(b"fresh")
    assert peers.receive(subscription, 1) == [b"fresh"]
    assert log.last == 0


@pytest.mark.parametrize(
    ("offered", "requested"),
    [
        ({"reliability": Reliability.BEST_EFFORT}, {}),
        ({}, {"durability": Durability.TRANSIENT_LOCAL}),
        ({"deadline_ms": 200}, {"deadline_ms": 100}),
        ({}, {"deadline_ms": 100}),
        ({}, {"lease_ms": 1000}),
        ({"liveliness": Liveliness.MANUAL_BY_NODE}, {"liveliness": Liveliness.MANUAL_BY_TOPIC}),
    ],
)
def test_ends_that_do_not_go_together_neither_count_nor_deliver(
    peers: Any, offered: dict[str, Any], requested: dict[str, Any]
) -> None:
    publisher = peers.publisher(peers.open(), **offered)
    subscription = peers.subscription(peers.open(), **requested)
    other = peers.subscription(subscription.session, **offered)
    log = peers.log(subscription, LIVELINESS_CHANGED)
    peers.match(publisher, other)
    publisher.publish_raw(b"data")
    assert peers.receive(other, 1) == [b"data"]
    assert (log.statuses, subscription.has_data()) == ([], False)
    assert peers.backend.await_matched(publisher, subscription, 0) is False
    assert peers.backend.matched(subscription) == 0


def test_all_is_kept_when_all_is_to_be_kept(peers: Any) -> None:
    publisher, subscription = peers.pair(history=History.KEEP_ALL, depth=1)
    for _ in range(50):
        publisher.publish_raw(b"x")
    assert len(peers.receive(subscription, 50)) == 50


def test_totals_and_numbers_can_be_preset(peers: Any) -> None:
    publisher, subscription = peers.pair(depth=64)
    log = peers.log(subscription, LOST)
    publisher.publish_raw(b"1")
    peers.receive(subscription, 1)
    assert peers.backend.inject("preset", entity=publisher, kind=None, count=2**32 - 2) == ReturnCode.OK
    for _ in range(5):
        publisher.publish_raw(b"x")
    peers.receive(subscription, 5)
    peers.drive(20)
    assert log.last == 0
    assert peers.backend.inject("preset", entity=subscription, kind=int(LOST), count=40) == ReturnCode.OK
    publisher.publish_raw(b"too large")
    peers.until(subscription.has_data)
    subscription.try_recv_raw(0)
    peers.until(lambda: log.statuses)
    assert log.statuses == [CountStatus(41, 1)]


def creation_error(make: Callable[[], object]) -> str:
    with pytest.raises(RmwError) as error:
        make()
    return str(error.value)


def test_what_cannot_be_created_says_why(peers: Any) -> None:
    session = peers.open()
    assert creation_error(lambda: peers.publisher(session, topic="a b")) == (
        "TOPIC_NAME_INVALID (-7): 'a b' is not a topic name"
    )
    assert creation_error(lambda: peers.subscription(session, lease_ms=99)) == (
        "INCOMPATIBLE_QOS (-6): lease 99 ms is below 100 ms"
    )
    assert creation_error(lambda: peers.open(node_name="a/b")) == (
        "INVALID_ARGUMENT (-4): node 'a/b' in domain 0 cannot exist"
    )
    assert creation_error(lambda: peers.open(connection_lease_ms=-1)) == (
        "INVALID_ARGUMENT (-4): lease -1 ms is not 0 to an hour"
    )
    assert creation_error(lambda: peers.open(hard_liveliness_ms=1)) == (
        "INVALID_CONFIG (-19): hard liveliness: a router checks nobody"
    )
    session.destroy()
    assert creation_error(lambda: peers.publisher(session)) == "INVALID_ARGUMENT (-4): the session is destroyed"


def test_another_type_is_refused_also_when_it_is_known_from_elsewhere(stage: Any) -> None:
    near, far = stage.open(), stage.open()
    stage.publisher(near)
    subscription: ZenohSubscription = stage.subscription(far)
    stage.until(lambda: stage.backend.matched(subscription) == 1)
    for make in (near.create_publisher, far.create_publisher, far.create_subscription):
        message = creation_error(functools.partial(make, "t", "std_msgs/msg/Int32", QosProfile()))
        assert message == "TOPIC_NAME_INVALID (-7): topic 't' has the type 'std_msgs::msg::dds_::String_'"


def test_destroyed_entities_answer_so(peers: Any) -> None:
    publisher, subscription = peers.pair()
    assert [publisher.destroy(), subscription.destroy()] == [ReturnCode.OK, ReturnCode.OK]
    assert [publisher.destroy(), publisher.publish_raw(b""), publisher.assert_liveliness()] == [-4, -4, -4]
    assert [subscription.destroy(), subscription.has_data(), subscription.try_recv_raw(1)] == [-4, -4, -4]
    assert publisher.register_event(int(OFFERED), 10, lambda *_: None, None) == -4
    session = publisher.session
    assert [session.destroy(), session.destroy(), session.drive_io(0), session.ping(10)] == [0, -4, -4, -4]
