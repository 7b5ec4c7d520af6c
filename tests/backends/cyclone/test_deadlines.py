from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import INFINITE_MS

if TYPE_CHECKING:
    from tests.backends.cyclone.conftest import Log, Stage

REQUESTED = EventKind.REQUESTED_DEADLINE_MISSED
OFFERED = EventKind.OFFERED_DEADLINE_MISSED
D = 30

NATIVE = pytest.param({"deadline_ms": D}, id="of the QoS")
SHIM = pytest.param({}, id="of the registration")


def never_early(log: Log, begin: int) -> bool:
    """Each total was reported when that many periods had really elapsed since ``begin``."""
    total = 0
    for event in log.events:
        total += event.status[1]
        if total > (event.at - begin) // (D * MS):
            return False
    return True


@pytest.mark.parametrize("qos", [NATIVE, SHIM])
def test_each_period_without_a_sample_is_one_miss_on_both_sides(stage: Stage, qos: dict[str, int]) -> None:
    publisher, subscription = stage.pair(**qos)
    requested, offered = stage.log(subscription, REQUESTED, D), stage.log(publisher, OFFERED, D)
    near, far = stage.drive()
    stage.pause(2 * D)
    assert not requested.events  # nothing is expected before the first sample
    assert not offered.events
    begin = stage.clock.now_ns()
    assert publisher.publish_raw(b"x") == ReturnCode.OK
    stage.until(lambda: requested.total >= 3 and offered.total >= 3)
    assert never_early(requested, begin)
    assert never_early(offered, begin)
    assert {event.thread for event in requested.events} == {near.thread.ident}
    assert {event.thread for event in offered.events} == {far.thread.ident}
    assert {event.kind for event in requested.events} == {REQUESTED}


@pytest.mark.parametrize("qos", [NATIVE, SHIM])
def test_no_miss_while_samples_come_in_time(stage: Stage, qos: dict[str, int]) -> None:
    publisher, subscription = stage.pair(**qos)
    requested, offered = stage.log(subscription, REQUESTED, D), stage.log(publisher, OFFERED, D)
    stage.drive()
    begin = stage.clock.now_ns()
    latest, longest = begin, 0
    while stage.clock.now_ns() < begin + 4 * D * MS:
        assert publisher.publish_raw(b"x") == ReturnCode.OK
        longest, latest = max(longest, stage.clock.now_ns() - latest), stage.clock.now_ns()
        stage.pause(D // 6)
    longest = max(longest, stage.clock.now_ns() - latest)
    if longest < D * MS // 2:  # else this host was too slow to say anything
        assert not requested.events
        assert not offered.events


@pytest.mark.parametrize("qos", [NATIVE, SHIM])
def test_misses_of_an_absence_are_all_counted_and_come_at_once(stage: Stage, qos: dict[str, int]) -> None:
    publisher, subscription = stage.pair(**qos)
    requested, offered = stage.log(subscription, REQUESTED, D), stage.log(publisher, OFFERED, D)
    begin = stage.clock.now_ns()
    publisher.publish_raw(b"x")
    end = stage.clock.now_ns()
    stage.pause(4 * D + D // 2)
    for log, session in ((requested, stage.near), (offered, stage.far)):
        before = stage.clock.now_ns()
        session.drive_io(0)
        after = stage.clock.now_ns()
        assert len(log.events) == 1
        # The sample was received some time after it was sent: a quarter of a period is ample here.
        assert (before - end - D * MS // 4) // (D * MS) <= log.total <= (after - begin) // (D * MS)


def test_a_sample_received_while_nobody_drives_restarts_the_period_of_a_registration(stage: Stage) -> None:
    publisher, subscription = stage.pair()
    requested = stage.log(subscription, REQUESTED, 150)
    publisher.publish_raw(b"x")
    stage.pause(100)
    publisher.publish_raw(b"x")
    second = stage.clock.now_ns()
    stage.pause(100)
    stage.near.drive_io(0)
    if stage.clock.now_ns() < second + 150 * MS:  # 200 ms after the first
        assert requested.total == 0
    stage.near.drive_io(1000)
    assert requested.total == 1
    assert requested.events[0].at >= second


def test_slow_takes_cause_no_miss_and_samples_not_taken_hide_none(stage: Stage) -> None:
    publisher, subscription = stage.pair(deadline_ms=D)
    requested = stage.log(subscription, REQUESTED)
    stage.drive()
    publisher.publish_raw(b"x")
    begin = stage.clock.now_ns()
    stage.until(lambda: requested.total >= 2)
    assert subscription.has_data() is True
    assert stage.clock.now_ns() >= begin + 2 * D * MS - MS


def test_the_period_of_the_qos_wins_over_that_of_the_registration(stage: Stage) -> None:
    publisher, subscription = stage.pair(deadline_ms=D)
    requested = stage.log(subscription, REQUESTED, 10_000)
    stage.drive()
    publisher.publish_raw(b"x")
    stage.until(lambda: requested.total >= 1)


def test_a_second_registration_changes_the_period_and_counts_on(stage: Stage) -> None:
    publisher, _ = stage.pair()
    offered = stage.log(publisher, OFFERED, D)
    stage.drive()
    publisher.publish_raw(b"x")
    stage.until(lambda: offered.total >= 2)
    changed = stage.clock.now_ns()
    offered.watch(publisher, OFFERED, 5 * D)
    total = offered.total
    stage.until(lambda: offered.total > total)
    assert offered.total <= total + 1 + (offered.events[-1].at - changed) // (D * MS)
    assert stage.clock.now_ns() - changed >= D * MS


def test_time_before_the_registration_is_no_miss(stage: Stage) -> None:
    publisher, subscription = stage.pair()
    publisher.publish_raw(b"x")
    stage.receive(subscription, 1)
    stage.pause(3 * D)
    begin = stage.clock.now_ns()
    requested, offered = stage.log(subscription, REQUESTED, 2 * D), stage.log(publisher, OFFERED, 2 * D)
    stage.near.drive_io(0)
    stage.far.drive_io(0)
    if stage.clock.now_ns() < begin + D * MS:
        assert not requested.events
        assert not offered.events
    stage.drive()
    stage.until(lambda: requested.total >= 1 and offered.total >= 1)  # the clock runs all the same


@pytest.mark.parametrize("qos", [NATIVE, SHIM])
def test_misses_go_on_when_the_publisher_is_gone(stage: Stage, qos: dict[str, int]) -> None:
    publisher, subscription = stage.pair(**qos)
    requested = stage.log(subscription, REQUESTED, D)
    stage.drive()
    publisher.publish_raw(b"x")
    stage.until(lambda: requested.total >= 1)
    publisher.destroy()
    total = requested.total
    stage.until(lambda: requested.total >= total + 3)


@pytest.mark.parametrize("noise", ["assert", "too large"])
@pytest.mark.parametrize("qos", [NATIVE, SHIM])
def test_only_a_successful_publish_restarts_the_period(stage: Stage, qos: dict[str, int], noise: str) -> None:
    publisher, _ = stage.pair(**qos)
    offered = stage.log(publisher, OFFERED, D)
    stage.drive()
    publisher.publish_raw(b"x")
    limit = stage.clock.now_ns() + 5_000 * MS
    while offered.total < 2:
        assert stage.clock.now_ns() < limit
        if noise == "assert":
            assert publisher.assert_liveliness() == ReturnCode.OK
        else:
            assert publisher.publish_raw(bytes(2**21)) == ReturnCode.MESSAGE_TOO_LARGE
        stage.pause(D // 4)


@pytest.mark.parametrize("period", [0, INFINITE_MS])
def test_a_deadline_kind_without_any_period_is_refused(stage: Stage, period: int) -> None:
    publisher, subscription = stage.pair(deadline_ms=period)
    for entity, kind in ((publisher, OFFERED), (subscription, REQUESTED)):
        for deadline_ms in (0, INFINITE_MS):
            code = entity.register_event(kind, deadline_ms, lambda *_: None, None)
            assert code == ReturnCode.INCOMPATIBLE_QOS
