from __future__ import annotations

from typing import Any

import pytest

from nros_backends.can.messages import Heartbeat
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import Liveliness
from tests.backends.can.conftest import TYPE, Bench, publisher, subscription, take
from tests.backends.log import Log

MANUAL = (Liveliness.MANUAL_BY_TOPIC, Liveliness.MANUAL_BY_NODE)


def watched(bench: Bench) -> Log:
    return Log().watch(subscription(bench.session()), EventKind.LIVELINESS_CHANGED)


def crash(bench: Bench, session: object) -> None:
    bench.driven = [other for other in bench.driven if other is not session]


def test_publishers_are_counted_whoever_came_first(either: Bench) -> None:
    first, second = either.session(), either.session()
    early = publisher(first)
    either.run()
    log = watched(either)
    either.run(3)
    assert log.counts == (1, 0)
    late = publisher(second)
    either.run()
    assert log.counts == (2, 0)
    early.destroy()
    either.run()
    assert log.counts == (1, 0)
    second.destroy()
    either.run()
    assert log.counts == (0, 0)
    assert late.publish_raw(b"") == ReturnCode.INVALID_ARGUMENT


def test_of_two_publishers_the_one_that_dies_is_not_alive_after_its_lease(bench: Bench) -> None:
    dying, staying = bench.session(), bench.session()
    publisher(dying, lease_ms=150)
    publisher(staying, lease_ms=150)
    log = watched(bench)
    bench.run(300)
    assert log.counts == (2, 0)
    crash(bench, dying)
    bench.run(150 - 150 // 4 - 2)
    assert log.counts == (2, 0)
    bench.run(150 // 4 + 3)
    assert log.counts == (1, 1)
    bench.run(1_000)
    assert log.counts == (1, 1)


def test_a_session_that_is_driven_again_brings_its_publisher_back(bench: Bench) -> None:
    sleeper = bench.session()
    publisher(sleeper)
    log = watched(bench)
    bench.run()
    crash(bench, sleeper)
    bench.run(1_002)
    assert log.counts == (0, 1), "the lease of the session"
    sleeper.drive_io(0)
    bench.run(1)
    assert log.counts == (1, 0)


def test_a_node_that_starts_again_is_new_and_loses_nothing(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    listener = subscription(bench.session())
    alive = Log().watch(listener, EventKind.LIVELINESS_CHANGED)
    lost = Log().watch(listener, EventKind.MESSAGE_LOST)
    monkeypatch.setattr(bench.backend._nodes, "lease", lambda domain: 77)
    old = bench.session()
    first = publisher(old)
    bench.run()
    for _ in range(10):
        first.publish_raw(b"old")
    bench.run(5)
    crash(bench, old)
    second = publisher(bench.session())
    bench.run()
    for _ in range(10):
        second.publish_raw(b"new")
    bench.run(5)
    assert take(listener) == [b"new"] * 10
    assert lost.total == 10, "the old ones, which the queue had no room for"
    assert alive.counts == (1, 0)


def test_an_uptime_that_runs_back_is_a_restart() -> None:
    from nros_backends.can.peers import Peer

    peer = Peer(5, Heartbeat(10, 1), 0)
    assert not peer.restarted(Heartbeat(10, 1))
    assert peer.restarted(Heartbeat(9, 1))
    assert peer.restarted(Heartbeat(11, 2))


@pytest.mark.parametrize("liveliness", MANUAL)
def test_a_manual_publisher_is_alive_while_it_asserts(bench: Bench, liveliness: Liveliness) -> None:
    talker = publisher(bench.session(), liveliness=liveliness, lease_ms=200)
    lost = Log().watch(talker, EventKind.LIVELINESS_LOST)
    log = watched(bench)
    bench.run()
    for _ in range(6):
        assert talker.assert_liveliness() == ReturnCode.OK
        bench.run(150)
        assert log.counts == (1, 0)
    bench.run(55)
    assert log.counts == (0, 1)
    assert lost.total == 1
    bench.run(1_000)
    assert lost.total == 1
    talker.assert_liveliness()
    bench.run()
    assert log.counts == (1, 0)


def test_one_by_node_covers_those_of_its_node_only(bench: Bench) -> None:
    node, other = bench.session(), bench.session()
    manual: dict[str, Any] = {"liveliness": Liveliness.MANUAL_BY_NODE, "lease_ms": 200}
    asserting, covered = publisher(node, "a", **manual), publisher(node, "b", **manual)
    by_topic = publisher(node, "c", liveliness=Liveliness.MANUAL_BY_TOPIC, lease_ms=200)
    foreign = publisher(other, "d", **manual)
    logs = [Log().watch(one, EventKind.LIVELINESS_LOST) for one in (asserting, covered, by_topic, foreign)]
    for _ in range(5):
        asserting.assert_liveliness()
        bench.run(100)
    assert [log.total for log in logs] == [0, 0, 1, 1]


def test_a_late_subscription_learns_who_has_been_silent(bench: Bench) -> None:
    session = bench.session()
    publisher(session, liveliness=Liveliness.MANUAL_BY_TOPIC, lease_ms=200)
    talker = publisher(session, liveliness=Liveliness.MANUAL_BY_TOPIC, lease_ms=200)
    bench.run(150)
    talker.assert_liveliness()
    bench.run(60)
    log = watched(bench)
    bench.run(3)
    assert log.counts == (1, 1)
    bench.run(200 - 60)
    assert log.counts == (0, 2)


def test_lost_heartbeats_alone_cost_the_liveliness_and_no_sample(bench: Bench) -> None:
    session = bench.session()
    talker = publisher(session)
    listener = subscription(bench.session())
    log = Log().watch(listener, EventKind.LIVELINESS_CHANGED)
    bench.run()
    crash(bench, session)  # nobody drives it, but it goes on publishing
    for _ in range(11):
        talker.publish_raw(b"data")
        bench.run(100)
        assert take(listener) == [b"data"]
    assert log.counts == (0, 1)


def test_a_going_that_nobody_heard_is_found_out(bench: Bench) -> None:
    session = bench.session()
    talker = publisher(session)
    stays = publisher(session)
    log = watched(bench)
    bench.run()
    assert bench.backend.inject("block", session=session, direction="out") == ReturnCode.OK
    talker.destroy()
    bench.backend.inject("heal", session=session)
    bench.run(3_000)
    assert log.counts == (1, 0)
    assert stays.publish_raw(b"") == ReturnCode.OK


def test_other_topics_types_and_domains_do_not_count(bench: Bench) -> None:
    log = watched(bench)
    bench.run()
    session = bench.session()
    publisher(session, "another")
    publisher(bench.session(domain_id=1))
    foreign = bench.session(driven=False)  # it does not know the subscription yet
    foreign.create_publisher("topic", "another/msg/Type", subscription(session, "elsewhere").qos)
    bench.run(5)
    assert log.counts == (0, 0)


def test_another_type_is_refused_once_it_is_known(bench: Bench) -> None:
    from nros_conformance.rmw.codes import RmwError
    from nros_conformance.rmw.qos import DEFAULT

    session = bench.session()
    subscription(bench.session())
    bench.run(3)
    with pytest.raises(RmwError, match=r"topic 'topic' has another type than 'a/B'") as raised:
        session.create_publisher("topic", "a/B", DEFAULT)
    assert raised.value.code is ReturnCode.TOPIC_NAME_INVALID
    assert session.create_publisher("topic", TYPE, DEFAULT)


@pytest.mark.parametrize(
    ("offered", "asked"),
    [
        ({"reliability": 0}, {}),
        ({}, {"deadline_ms": 10}),
        ({"deadline_ms": 20}, {"deadline_ms": 10}),
        ({"lease_ms": 300}, {"lease_ms": 200}),
        ({"liveliness": Liveliness.AUTOMATIC}, {"liveliness": Liveliness.MANUAL_BY_TOPIC}),
        ({"liveliness": Liveliness.MANUAL_BY_NODE}, {"liveliness": Liveliness.MANUAL_BY_TOPIC}),
    ],
)
def test_a_pair_that_does_not_fit_has_neither_data_nor_liveliness(
    bench: Bench, offered: dict[str, Any], asked: dict[str, Any]
) -> None:
    talker, listener = publisher(bench.session(), **offered), subscription(bench.session(), **asked)
    log = Log().watch(listener, EventKind.LIVELINESS_CHANGED)
    bench.run(3)
    talker.publish_raw(b"data")
    bench.run(3)
    assert (take(listener), log.statuses) == ([], [])
    assert bench.backend.matched(talker) == bench.backend.matched(listener) == 0
    assert bench.backend.await_matched(talker, listener, bench.clock.now_ns() + 5 * MS) is False


def test_both_ends_know_when_they_have_met(bench: Bench) -> None:
    talker, listener = publisher(bench.session()), subscription(bench.session())
    assert bench.backend.await_matched(talker, listener, 0) is False
    bench.run()
    assert bench.backend.await_matched(talker, listener, 0) is True
    assert bench.backend.matched(talker) == bench.backend.matched(listener) == 1
