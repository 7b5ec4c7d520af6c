from __future__ import annotations

import random

import can
import pytest

from nros_backends.can.faults import malformed
from nros_backends.can.frames import can_id, segment
from nros_backends.can.messages import HEARTBEAT_SUBJECT, Heartbeat
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import Liveliness
from tests.backends.can.conftest import Bench, publisher, subscription, take
from tests.backends.log import Log


@pytest.mark.parametrize("seed", range(5))
def test_malformed_and_foreign_frames_change_nothing(either: Bench, seed: int) -> None:
    session, ear = either.session(), either.session()
    talker = publisher(session, liveliness=Liveliness.MANUAL_BY_TOPIC, lease_ms=200)
    listener = subscription(ear)
    logs = {kind: Log().watch(listener, kind, 50) for kind in EventKind if kind <= EventKind.MESSAGE_LOST}
    either.run()
    talker.publish_raw(b"before")
    either.run()
    assert take(listener) == [b"before"]
    for _ in range(4):
        assert either.backend.inject("inject", session=ear, count=60, seed=seed) == ReturnCode.OK
        either.run(50)
    assert take(listener) == []
    assert logs[EventKind.LIVELINESS_CHANGED].counts == (0, 1), "no lease was renewed"
    assert logs[EventKind.REQUESTED_DEADLINE_MISSED].total == 4, "no period began anew"
    talker.publish_raw(b"after" * 5)
    either.run()
    assert take(listener) == [b"after" * 5]
    assert logs[EventKind.MESSAGE_LOST].total == 0
    assert logs[EventKind.LIVELINESS_CHANGED].counts == (1, 0)


def test_malformed_frames_follow_from_the_seed(bench: Bench) -> None:
    session = bench.session()
    first, second, other = (
        [str(frame.data) for frame in malformed(session, random.Random(seed), 30)] for seed in (1, 1, 2)
    )
    assert first == second != other
    assert list(malformed(session, random.Random(1), 0)) == []


@pytest.mark.parametrize("seed", range(3))
def test_random_frames_of_any_kind_do_no_harm(bench: Bench, seed: int) -> None:
    chance = random.Random(seed)
    session, ear = bench.session(), bench.session()
    talker, listener = publisher(session), subscription(ear, depth=2_000)
    bench.run()
    bus = can.Bus(f"{bench.backend._buses._token} 0", interface="virtual")
    for _ in range(2_000):
        subject = chance.choice((6141, 6142, 6143, 7509, talker.outlet.subject, chance.randrange(8192)))
        node = chance.choice((99, 100, 127))
        data = chance.randbytes(chance.randrange(7)) + bytes((chance.choice((0xE0, 0xA0, 0x40, 0x60, 0x00)),))
        bus.send(can.Message(arbitration_id=can_id(chance.randrange(8), subject, node), data=data))
    bench.run(5)
    assert take(listener) == []
    talker.publish_raw(b"still here")
    bench.run()
    assert take(listener) == [b"still here"]
    bus.shutdown()


def test_a_partition_costs_the_publisher_behind_it_until_it_heals(bench: Bench) -> None:
    session = bench.session()
    publisher(session)
    publisher(bench.session())
    log = Log().watch(subscription(bench.session()), EventKind.LIVELINESS_CHANGED)
    bench.run()
    assert log.counts == (2, 0)
    assert bench.backend.inject("partition", session=session) == ReturnCode.OK
    bench.run(1_005)
    assert log.counts == (1, 1)
    assert bench.backend.inject("heal", session=session) == ReturnCode.OK
    bench.run(205)
    assert log.counts == (2, 0)


def test_blocked_inwards_a_session_hears_nothing_and_is_heard(bench: Bench) -> None:
    session = bench.session()
    deaf = Log().watch(subscription(session), EventKind.LIVELINESS_CHANGED)
    heard = Log().watch(subscription(bench.session(), "other"), EventKind.LIVELINESS_CHANGED)
    bench.backend.inject("block", session=session, direction="in")
    publisher(session, "other")
    publisher(bench.session())
    bench.run(1_005)  # it does not hear of newcomers, and tells all again once in a second
    assert (deaf.counts, heard.counts) == ((0, 0), (1, 0))


def test_what_is_held_back_comes_in_order_when_it_heals(bench: Bench) -> None:
    session = bench.session()
    talker, listener = publisher(session), subscription(bench.session())
    bench.run()
    bench.backend.inject("stall", session=session)
    for number in range(5):
        assert talker.publish_raw(bytes((number,)) * 20) == ReturnCode.OK
    bench.run(10)
    assert take(listener) == []
    bench.backend.inject("heal", session=session)
    talker.publish_raw(b"later")
    bench.run()
    assert take(listener) == [*(bytes((number,)) * 20 for number in range(5)), b"later"]
    assert listener.losses.total == 0


def test_delayed_samples_come_so_much_later(bench: Bench) -> None:
    session = bench.session()
    talker, listener = publisher(session), subscription(bench.session())
    bench.run()
    bench.backend.inject("delay", session=session, by_ns=30_000_000)
    talker.publish_raw(b"slow")
    bench.run(29)
    assert take(listener) == []
    bench.run(3)
    assert take(listener) == [b"slow"]


def test_off_the_bus_sending_fails_and_automatic_liveliness_is_lost(bench: Bench) -> None:
    session = bench.session()
    talker = publisher(session, lease_ms=200, deadline_ms=100)
    lost = Log().watch(talker, EventKind.LIVELINESS_LOST)
    missed = Log().watch(talker, EventKind.OFFERED_DEADLINE_MISSED)
    listener = subscription(bench.session(), depth=100)
    alive = Log().watch(listener, EventKind.LIVELINESS_CHANGED)
    bench.run()
    talker.publish_raw(b"before")
    assert bench.backend.inject("bus_off", session=session) == ReturnCode.OK
    bench.run(5)
    assert {talker.publish_raw(b"nobody hears") for _ in range(40)} == {ReturnCode.CONNECTION_FAILED}
    bench.run(150)
    assert (lost.total, missed.total) == (0, 1), "a publication that fails begins no period"
    bench.run(100)
    assert (lost.total, alive.counts) == (1, (0, 1))
    bench.backend.inject("heal", session=session)
    bench.run(60)
    assert talker.publish_raw(b"after") == ReturnCode.OK
    bench.run(3)
    assert take(listener) == [b"before", b"after"]
    assert (lost.total, alive.counts, listener.losses.total) == (1, (1, 0), 0)


def test_a_node_with_the_same_id_is_found_and_said(bench: Bench) -> None:
    session = bench.session()
    talker = publisher(session)
    bench.run()
    bus = can.Bus(f"{bench.backend._buses._token} 0", interface="virtual")
    identifier = can_id(4, HEARTBEAT_SUBJECT, session.node)
    bus.send(can.Message(arbitration_id=identifier, data=segment(Heartbeat(0, 0).encode(), 0, 8)[0]))
    assert session.drive_io(0) == ReturnCode.INVALID_CONFIG
    assert talker.publish_raw(b"") == ReturnCode.INVALID_CONFIG
    bench.driven.clear()
    bench.clock.wait(None, bench.clock.now_ns() + 1_000_000_000)
    assert session.drive_io(0) == ReturnCode.OK, "it has not been heard for a lease"
    bus.shutdown()


@pytest.mark.parametrize("fault", ["reorder", "crash", "lose", "block", "inject", "delay", "preset"])
def test_what_cannot_be_injected_is_said(bench: Bench, fault: str) -> None:
    assert bench.backend.inject(fault, session=bench.session()) == ReturnCode.UNSUPPORTED
    assert bench.backend.inject(fault) == ReturnCode.UNSUPPORTED
