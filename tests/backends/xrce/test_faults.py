from __future__ import annotations

import random
import time

import pytest

from nros_backends.xrce.client.core import Config, Core
from nros_backends.xrce.faults import malformed
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import EventKind, EventStatus
from nros_conformance.rmw.qos import DEFAULT, QosProfile, Reliability
from tests.backends.xrce.conftest import Bench, drain, drive, publisher, subscription

BEST_EFFORT = QosProfile(reliability=Reliability.BEST_EFFORT)
OK = ReturnCode.OK


@pytest.mark.parametrize(
    ("fault", "arrives"),
    [("lose", []), ("duplicate", [0, 1, 2]), ("reorder", [2])],  # on this stream the older ones are discarded
)
def test_what_becomes_of_samples(bench: Bench, fault: str, arrives: list[int]) -> None:
    session = bench.session()
    sent, received = publisher(session, BEST_EFFORT), subscription(session, BEST_EFFORT)
    samples = iter(range(10))

    def publish() -> int:
        return sent.publish_raw(bytes([next(samples)]))

    assert bench.backend.inject(fault, entity=sent, count=3, publish=publish) == OK
    publish()
    arrived: list[bytes] = []

    def last_has_come() -> bool:
        arrived.extend(drain(received))
        return bool(arrived) and arrived[-1] == b"\3"

    assert drive(session, until=last_has_come)
    assert [one[0] for one in arrived] == [*arrives, 3]


def test_a_reliable_stream_repairs_what_is_lost_so_that_is_refused(bench: Bench) -> None:
    session = bench.session()
    assert (
        bench.backend.inject("lose", entity=publisher(session), count=1, publish=lambda: OK) == ReturnCode.UNSUPPORTED
    )


@pytest.mark.parametrize("direction", ["out", "in"])
def test_a_blocked_direction_is_repaired_on_the_reliable_stream(bench: Bench, direction: str) -> None:
    near, far = bench.session(), bench.session("far")
    sent, received = publisher(near), subscription(far)
    blocked = near if direction == "out" else far
    assert bench.backend.inject("block", session=blocked, direction=direction) == OK
    sent.publish_raw(b"sample")
    for _ in range(10):
        near.drive_io(2)
        far.drive_io(2)
    assert received.has_data() is False
    assert bench.backend.inject("heal", session=blocked) == OK
    assert drive(near, far, until=lambda: received.has_data() is True)
    assert drain(received) == [b"sample"]


def test_what_is_delayed_arrives_later(bench: Bench) -> None:
    near, far = bench.session(), bench.session("far")
    sent, received = publisher(near, BEST_EFFORT), subscription(far, BEST_EFFORT)
    assert bench.backend.inject("delay", session=near, by_ns=60_000_000) == OK
    begin = time.monotonic()
    sent.publish_raw(b"sample")
    assert drive(far, until=lambda: received.has_data() is True)
    assert time.monotonic() - begin >= 0.06


def test_what_is_stalled_comes_when_it_is_healed(bench: Bench) -> None:
    near, far = bench.session(), bench.session("far")
    sent, received = publisher(near, BEST_EFFORT), subscription(far, BEST_EFFORT)
    bench.backend.inject("stall", session=near)
    for number in range(4):
        assert sent.publish_raw(bytes([number])) == OK
    far.drive_io(20)
    assert received.has_data() is False
    bench.backend.inject("heal", session=near)
    assert drive(far, until=lambda: len(received._waiting) == 4)


def test_a_cut_link_stays_cut_for_the_node_s_next_session(bench: Bench) -> None:
    session = bench.session("cut", lease_ms=100)
    bench.backend.inject("partition", session=session)
    session.destroy()
    with pytest.raises(Exception, match="the agent does not answer"):
        bench.session("cut", lease_ms=100)
    assert bench.session("other").drive_io(0) == OK
    bench.backend.inject("heal", session=session)
    assert bench.session("cut", lease_ms=100).drive_io(0) == OK


def test_malformed_datagrams_change_nothing(bench: Bench) -> None:
    session = bench.session()
    sent, received = publisher(session), subscription(session)
    told: list[EventStatus] = []
    received.register_event(
        int(EventKind.REQUESTED_DEADLINE_MISSED), 60_000, lambda kind, status, _: told.append(status), None
    )
    assert bench.backend.inject("inject", session=session, count=200, seed=7) == OK
    core = session.client.core
    assert drive(session, until=lambda: core.malformed + core.foreign >= 80)
    assert received.has_data() is False
    assert told == []
    sent.publish_raw(b"sample")
    assert drive(session, until=lambda: received.has_data() is True)
    assert drain(received) == [b"sample"]
    assert session.ping(5_000) == OK


def test_no_malformed_datagram_gets_through_the_client() -> None:
    got: list[object] = []
    core = Core(Config(1), lambda data, at_ns: None, lambda reply, at_ns: got.append(reply))
    chance = random.Random(1)
    for number in range(2_000):
        core.receive(malformed(chance, number), 0)
        core.tick(0)
    assert got == []


def test_a_counter_that_was_set_goes_on_from_there(bench: Bench) -> None:
    session = bench.session()
    received = subscription(session)
    told: list[EventStatus] = []
    kind = int(EventKind.REQUESTED_DEADLINE_MISSED)
    received.register_event(kind, 20, lambda _, status, __: told.append(status), None)
    assert bench.backend.inject("preset", entity=received, kind=kind, count=2**32 - 2) == OK
    assert bench.backend.inject("preset", entity=received, kind=None, count=1) == ReturnCode.UNSUPPORTED
    publisher(session).publish_raw(b"sample")
    assert drive(session, until=lambda: len(told) >= 3)
    assert told[-1][0] == 2**32 - 1
    assert all(status[1] >= 1 for status in told)


def test_unknown_faults_are_unsupported(bench: Bench) -> None:
    assert bench.backend.inject("bus_off", session=bench.session()) == ReturnCode.UNSUPPORTED
    assert bench.backend.inject("lose", entity=None, count=1, publish=lambda: OK) == ReturnCode.UNSUPPORTED
    assert DEFAULT.reliability is Reliability.RELIABLE
