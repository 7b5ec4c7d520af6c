from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

import pytest

from nros_conformance.rmw.clock import MS, MonotonicClock
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import EventKind

if TYPE_CHECKING:
    from nros_backends.cyclone.session import CycloneSession
    from tests.backends.cyclone.conftest import Stage


@pytest.mark.parametrize("timeout_ms", [0, -5])
def test_drive_io_without_a_timeout_does_not_wait(
    session: CycloneSession, clock: MonotonicClock, timeout_ms: int
) -> None:
    durations = []
    for _ in range(50):
        begin = clock.now_ns()
        assert session.drive_io(timeout_ms) == ReturnCode.OK
        durations.append(clock.now_ns() - begin)
    assert sorted(durations)[25] < 1 * MS


def test_an_idle_drive_io_waits_its_timeout_and_burns_nothing(session: CycloneSession, clock: MonotonicClock) -> None:
    begin, cpu = clock.now_ns(), time.thread_time_ns()
    assert session.drive_io(100) == ReturnCode.OK
    assert clock.now_ns() - begin >= 80 * MS
    assert time.thread_time_ns() - cpu < 5 * MS


def test_waiting_lets_other_threads_run(session: CycloneSession) -> None:
    turns, running = 0, True

    def turn() -> None:
        nonlocal turns
        while running:
            turns += 1
            time.sleep(0.001)

    thread = threading.Thread(target=turn)
    thread.start()
    try:
        session.drive_io(100)
        seen = turns
    finally:
        running = False
        thread.join()
    assert seen > 10  # none at all with the GIL held


def test_a_sample_ends_the_wait(stage: Stage) -> None:
    publisher, subscription = stage.pair()
    timer = threading.Timer(0.03, lambda: publisher.publish_raw(b"x"))
    timer.start()
    begin = stage.clock.now_ns()
    assert stage.near.drive_io(5_000) == ReturnCode.OK
    assert stage.clock.now_ns() - begin < 4_000 * MS
    assert subscription.has_data() is True
    timer.join()
    begin = stage.clock.now_ns()
    stage.near.drive_io(50)
    assert stage.clock.now_ns() - begin >= 40 * MS  # a sample that still waits is nothing new


@pytest.mark.parametrize("deadline_ms", [0, 40])
def test_what_falls_due_during_the_wait_is_delivered_by_the_same_call(stage: Stage, deadline_ms: int) -> None:
    publisher, _ = stage.pair(deadline_ms=deadline_ms)
    log = stage.log(publisher, EventKind.OFFERED_DEADLINE_MISSED, 40)
    begin = stage.clock.now_ns()
    publisher.publish_raw(b"x")
    assert stage.far.drive_io(5_000) == ReturnCode.OK
    assert log.total >= 1
    assert begin + 40 * MS <= stage.clock.now_ns() < begin + 4_000 * MS


def test_publishing_from_another_thread_starts_the_clock_of_a_waiting_drive(stage: Stage) -> None:
    publisher, _ = stage.pair()
    log = stage.log(publisher, EventKind.OFFERED_DEADLINE_MISSED, 40)
    timer = threading.Timer(0.03, lambda: publisher.publish_raw(b"x"))
    timer.start()
    begin = stage.clock.now_ns()
    stage.far.drive_io(5_000)
    timer.join()
    assert log.total >= 1
    assert stage.clock.now_ns() < begin + 4_000 * MS


def test_a_drive_inside_a_callback_does_nothing(stage: Stage) -> None:
    publisher, _ = stage.pair(deadline_ms=20)
    inner: list[tuple[int, int]] = []
    running = 0

    def callback(*_: object) -> None:
        nonlocal running
        assert running == 0
        running += 1
        begin = stage.clock.now_ns()
        inner.append((stage.far.drive_io(1_000), stage.clock.now_ns() - begin))
        running -= 1

    publisher.register_event(EventKind.OFFERED_DEADLINE_MISSED, 0, callback, None)
    publisher.publish_raw(b"x")
    stage.until(lambda: stage.far.drive_io(10) == ReturnCode.OK and len(inner) >= 2)
    assert {code for code, _ in inner} == {ReturnCode.WOULD_BLOCK}
    assert max(lasted for _, lasted in inner) < 500 * MS


def test_two_threads_do_not_drive_one_session_at_once(stage: Stage) -> None:
    stage.driven(stage.near)
    codes: set[int] = set()

    def driven_twice() -> bool:
        codes.add(stage.near.drive_io(0))
        return ReturnCode.WOULD_BLOCK in codes

    stage.until(driven_twice)
    assert codes <= {ReturnCode.OK, ReturnCode.WOULD_BLOCK}


def test_a_cap_holds_back_what_is_over_it_for_later_drives(stage: Stage) -> None:
    publishers = [stage.publisher(deadline_ms=20) for _ in range(3)]
    log: list[object] = []
    for publisher in publishers:
        publisher.register_event(EventKind.OFFERED_DEADLINE_MISSED, 0, lambda *_: log.append(1), None)
        publisher.publish_raw(b"x")
    stage.pause(40)
    assert stage.far.drive_io(0, 0) == ReturnCode.OK
    assert len(log) == 0
    assert stage.far.drive_io(0, 1) == ReturnCode.OK
    assert len(log) == 1
    assert stage.far.drive_io(0, 2) == ReturnCode.OK
    assert len(log) == 3
    assert stage.far.drive_io(0, -1) == ReturnCode.INVALID_ARGUMENT


def test_a_callback_that_raises_leaves_the_session_working(stage: Stage) -> None:
    publisher, _ = stage.pair(deadline_ms=20)

    def failing(*_: object) -> None:
        raise ZeroDivisionError

    publisher.register_event(EventKind.OFFERED_DEADLINE_MISSED, 0, failing, None)
    publisher.publish_raw(b"x")
    with pytest.raises(ZeroDivisionError):
        stage.far.drive_io(5_000)
    totals: list[int] = []
    publisher.register_event(
        EventKind.OFFERED_DEADLINE_MISSED, 0, lambda _kind, status, _context: totals.append(status[0]), None
    )
    stage.until(lambda: stage.far.drive_io(10) == ReturnCode.OK and len(totals) >= 2)
    assert totals[0] >= 2  # the first was given to the callback that failed


@pytest.mark.parametrize("what", ["entity", "session"])
def test_a_callback_may_destroy_what_it_was_called_for(stage: Stage, what: str) -> None:
    publisher, subscription = stage.pair(deadline_ms=20)
    codes: list[int] = []

    def callback(*_: object) -> None:
        codes.append((publisher if what == "entity" else stage.far).destroy())

    publisher.register_event(EventKind.OFFERED_DEADLINE_MISSED, 0, callback, None)
    log = stage.log(subscription, EventKind.LIVELINESS_CHANGED)
    stage.until(lambda: stage.near.drive_io(1) == ReturnCode.OK and log.counts == (1, 0))
    publisher.publish_raw(b"x")
    assert stage.far.drive_io(5_000) == ReturnCode.OK
    assert codes == [ReturnCode.OK]
    assert stage.far.drive_io(0) == (ReturnCode.OK if what == "entity" else ReturnCode.INVALID_ARGUMENT)
    stage.until(lambda: stage.near.drive_io(1) == ReturnCode.OK and log.counts == (0, 0))


def test_sessions_do_not_call_each_others_callbacks(stage: Stage) -> None:
    near = stage.log(stage.publisher(stage.near, deadline_ms=20), EventKind.OFFERED_DEADLINE_MISSED)
    far_publisher = stage.publisher(deadline_ms=20)
    far = stage.log(far_publisher, EventKind.OFFERED_DEADLINE_MISSED)
    far_publisher.publish_raw(b"x")
    stage.pause(50)
    stage.near.drive_io(20)
    assert not near.events
    assert not far.events
    stage.far.drive_io(0)
    assert far.total >= 1
