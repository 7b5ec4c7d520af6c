from __future__ import annotations

import functools
from datetime import timedelta
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nros_conformance.node import Executor
from nros_conformance.node.executor import TURN_MS
from nros_conformance.rmw.clock import MS, MonotonicClock, VirtualClock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from tests.node.fakes import PolledSubscription, QueueSession
from tests.node.pair import Pair, ms

# One session.


@pytest.mark.parametrize(("timeout", "driven_ms"), [
    (0, 0), (7, 7), (-1, -1), (timedelta(0), 0), (timedelta(milliseconds=15), 15), (timedelta(microseconds=1), 1),
    (timedelta(seconds=2, microseconds=1), 2001),
])  # fmt: skip
def test_a_timeout_is_a_timedelta_or_whole_milliseconds(timeout: Any, driven_ms: int) -> None:
    session = QueueSession()
    assert Executor(session).spin_once(timeout) == ReturnCode.OK
    assert session.drives == [(driven_ms, None)]


@pytest.mark.parametrize("timeout", [0.01, "10", None])
def test_a_timeout_without_a_unit_is_refused(timeout: Any) -> None:
    with pytest.raises(TypeError, match=f"^a timeout is a timedelta or whole milliseconds, not {timeout!r}$"):
        Executor(QueueSession()).spin_once(timeout)


def test_an_executor_needs_something_to_drive() -> None:
    with pytest.raises(ValueError, match=r"^an executor needs a node to drive$"):
        Executor()


def test_the_code_of_drive_io_is_returned_and_spin_raises_it() -> None:
    session = QueueSession()
    session.code = ReturnCode.CONNECTION_FAILED
    executor = Executor(session)
    assert executor.spin_once() == ReturnCode.CONNECTION_FAILED
    with pytest.raises(RmwError, match=r"^CONNECTION_FAILED \(-18\): drive_io$"):
        executor.spin()
    session.code = -77
    with pytest.raises(RmwError, match=r"^ERROR \(-1\): drive_io: unpublished code -77$") as caught:
        executor.spin()
    assert caught.value.code is ReturnCode.ERROR


def test_a_spin_from_inside_a_callback_does_nothing() -> None:
    session, codes = QueueSession(), list[int]()
    executor = Executor(session)
    subscription = PolledSubscription(b"one", b"two")
    executor.add_subscription(subscription, lambda _: codes.append(executor.spin_once(5)))
    assert executor.spin_once() == ReturnCode.OK
    assert codes == [ReturnCode.WOULD_BLOCK, ReturnCode.WOULD_BLOCK]
    assert session.drives == [(0, None)]


def test_a_spin_from_inside_a_callback_leaves_the_other_sessions_alone() -> None:
    first, second, codes = QueueSession(), QueueSession(), list[int]()
    executor = Executor(first, second)
    first.ready.append(lambda: codes.append(executor.spin_once(5)))
    assert executor.spin_once() == ReturnCode.OK
    assert codes == [ReturnCode.WOULD_BLOCK]
    assert (len(first.drives), len(second.drives)) == (1, 1)


# Messages that the backend cannot announce.


def test_messages_that_cannot_be_announced_are_looked_for_after_the_drive() -> None:
    session, got = QueueSession(), list[bytes]()
    executor = Executor(session)
    executor.add_subscription(PolledSubscription(b"1", b"2", b"3"), got.append)

    def event() -> None:
        executor.note_callback()
        got.append(b"event")

    session.ready.append(event)
    executor.spin_once(10, 2)
    assert got == [b"event", b"1"]
    assert executor.ran == 2
    executor.spin_once(10, 2)
    assert got == [b"event", b"1", b"2", b"3"]
    executor.spin_once(10, 2)
    assert executor.ran == 0
    assert [timeout for timeout, _ in session.drives] == [0, 0, 10]  # waits only when nothing is left to do


def test_a_removed_subscription_is_left_alone() -> None:
    executor, got = Executor(QueueSession()), list[bytes]()
    subscription = PolledSubscription(b"1")
    executor.add_subscription(subscription, got.append)
    executor.remove_subscription(subscription)
    executor.spin_once()
    assert (got, list(subscription.samples)) == ([], [b"1"])


def test_a_sample_that_is_gone_when_it_is_taken_is_no_failure() -> None:
    executor, got = Executor(QueueSession()), list[bytes]()
    executor.add_subscription(PolledSubscription(ReturnCode.NO_DATA, b"next"), got.append)
    executor.spin_once()
    executor.spin_once()
    assert got == [b"next"]


def test_a_sample_that_cannot_be_received_surfaces_and_the_next_one_is_delivered() -> None:
    executor, got = Executor(QueueSession()), list[bytes]()
    executor.add_subscription(PolledSubscription(ReturnCode.BUFFER_TOO_SMALL, b"next"), got.append)
    with pytest.raises(RmwError, match=r"^BUFFER_TOO_SMALL \(-12\): receiving from /polled$"):
        executor.spin_once()
    executor.spin_once()
    assert got == [b"next"]


# Callbacks that raise.


def test_an_exception_surfaces_once_and_later_callbacks_run() -> None:
    executor, got = Executor(QueueSession()), list[bytes]()

    def callback(data: bytes) -> None:
        got.append(data)
        if data == b"bad":
            raise LookupError("from the callback")

    executor.add_subscription(PolledSubscription(b"bad", b"good"), callback)
    with pytest.raises(LookupError, match=r"^from the callback$"):
        executor.spin_once()
    assert got == [b"bad", b"good"]
    assert executor.spin_once() == ReturnCode.OK


def test_several_exceptions_surface_one_after_the_other_without_waiting() -> None:
    session = QueueSession()
    executor = Executor(session)

    def callback(data: bytes) -> None:
        raise LookupError(data.decode())

    executor.add_subscription(PolledSubscription(b"first", b"second"), callback)
    for expected in ("first", "second"):
        with pytest.raises(LookupError, match=f"^{expected}$"):
            executor.spin_once(50)
    assert executor.spin_once(50) == ReturnCode.OK
    assert [timeout for timeout, _ in session.drives] == [0, 0, 50]


def test_an_exception_does_not_pass_through_the_middleware(pair: Pair) -> None:
    publisher, subscription, seen = pair.publisher(), pair.subscription(), list[object]()

    def raising(status: object) -> None:
        seen.append(status)
        raise LookupError("from the callback")

    subscription.on_liveliness_changed(raising)
    subscription.on_requested_deadline_missed(ms(10), seen.append)
    publisher.publish(b"x")
    with pytest.raises(LookupError):
        pair.executor.spin(ms(25))
    assert seen == [(1, 0, 1, 0)]
    pair.executor.spin(ms(25))
    assert seen == [(1, 0, 1, 0), (1, 1), (2, 1)]
    publisher.destroy()
    with pytest.raises(LookupError):
        pair.executor.spin_once()
    assert seen[3:] == [(0, 0, -1, 0)]


# Several sessions.


def test_sessions_take_turns_in_waiting_and_in_going_first() -> None:
    first, second = QueueSession(), QueueSession()
    executor = Executor(first, second)
    executor.spin_once(3)
    assert (first.drives, second.drives) == ([(1, None), (1, None)], [(1, None), (0, None)])
    executor.spin_once(1)
    assert (first.drives[2:], second.drives[2:]) == ([(0, None)], [(1, None)])


def test_once_a_callback_ran_the_others_are_not_waited_for() -> None:
    first, second = QueueSession(), QueueSession()
    executor = Executor(first, second)
    subscription = PolledSubscription(b"x")
    executor._dispatchers[0].add_subscription(subscription, lambda _: None)
    executor.spin_once(100)
    assert (first.waited_ms, second.drives, executor.ran) == (0, [(0, None)], 1)


def test_a_session_that_fails_ends_the_spin_and_the_others_go_first_next_time() -> None:
    broken, sound = QueueSession(), QueueSession()
    broken.code = ReturnCode.ERROR
    executor = Executor(broken, sound)
    assert executor.spin_once() == ReturnCode.ERROR
    assert sound.drives == []
    assert executor.spin_once() == ReturnCode.ERROR
    assert sound.drives == [(0, None)]


def test_bare_entities_need_to_know_their_session() -> None:
    with pytest.raises(ValueError, match="too many values to unpack"):
        Executor(QueueSession(), QueueSession()).note_callback()


@given(
    timeout_ms=st.integers(0, 40),
    cap=st.none() | st.integers(0, 5),
    ready=st.lists(st.integers(0, 6), min_size=1, max_size=4),
)
def test_no_spin_exceeds_its_cap_or_its_timeout_and_everything_runs(
    timeout_ms: int, cap: int | None, ready: list[int]
) -> None:
    sessions = [QueueSession() for _ in ready]
    executor = Executor(*sessions)
    ran: list[int] = []

    def callback(index: int) -> None:
        executor._dispatchers[index].note_callback()
        ran.append(index)

    for index, (session, count) in enumerate(zip(sessions, ready, strict=True)):
        session.ready.extend(count * [functools.partial(callback, index)])
    for _ in range(sum(ready) + len(ready)):
        before, waited = len(ran), sum(session.waited_ms for session in sessions)
        assert executor.spin_once(timeout_ms, cap) == ReturnCode.OK
        assert executor.ran == len(ran) - before
        assert cap is None or executor.ran <= cap
        assert sum(session.waited_ms for session in sessions) - waited <= timeout_ms
    assert sorted(ran) == ([] if cap == 0 else sorted(i for i, count in enumerate(ready) for _ in range(count)))


def test_with_a_cap_of_one_a_message_and_an_event_run_in_the_order_in_which_they_became_ready(pair: Pair) -> None:
    seen: list[object] = []
    publisher = pair.publisher()
    subscription = pair.listener.create_subscription("std_msgs/msg/String", "/chatter", seen.append)
    subscription.on_requested_deadline_missed(ms(10), seen.append)
    publisher.publish(b"first")
    pair.clock.wait(None, pair.clock.now_ns() + 12 * MS)
    subscription.on_message_lost(seen.append)
    publisher.publish(b"second")
    for count in (1, 2, 3):
        pair.executor.spin_once(0, 1)
        assert len(seen) == count
    assert seen == [b"first", (1, 1), b"second"]


# Spinning for longer.


def test_spin_lasts_as_long_as_asked_and_dispatches_what_falls_due_meanwhile(pair: Pair, clock: VirtualClock) -> None:
    publisher, subscription, seen = pair.publisher(), pair.subscription(), list[tuple[int, int]]()
    subscription.on_requested_deadline_missed(ms(30), lambda status: seen.append((clock.now_ns(), *status[1:])))
    publisher.publish(b"x")
    begin = clock.now_ns()
    assert not Executor(pair.listener).spin(ms(100))
    assert clock.now_ns() == begin + 100 * MS
    assert seen == [(begin + 30 * MS, 1), (begin + 60 * MS, 1), (begin + 90 * MS, 1)]


def test_another_session_delays_a_callback_by_one_turn_at_most(pair: Pair, clock: VirtualClock) -> None:
    publisher, subscription, seen = pair.publisher(), pair.subscription(), list[int]()
    subscription.on_requested_deadline_missed(ms(30), lambda status: seen.append(clock.now_ns()))
    publisher.publish(b"x")
    begin = clock.now_ns()
    pair.executor.spin(ms(1000))
    assert len(seen) == 33
    assert all(0 <= at - begin - n * 30 * MS <= TURN_MS * MS for n, at in enumerate(seen, 1))


def test_spin_ends_when_its_condition_holds(pair: Pair, clock: VirtualClock) -> None:
    publisher, subscription, seen = pair.publisher(), pair.subscription(), list[object]()
    subscription.on_requested_deadline_missed(ms(30), seen.append)
    publisher.publish(b"x")
    begin = clock.now_ns()
    executor = Executor(pair.listener)
    assert executor.spin(until=lambda: len(seen) == 2)
    assert clock.now_ns() == begin + 60 * MS
    assert executor.spin(0, until=lambda: True)
    assert not executor.spin(timedelta(microseconds=1500), until=lambda: False)
    assert clock.now_ns() == begin + 62 * MS


def test_spin_waits_also_for_the_last_fraction_of_a_millisecond(pair: Pair, clock: VirtualClock) -> None:
    end = clock.now_ns() + 2 * MS
    turns = 0

    def half_a_millisecond_passes() -> bool:
        nonlocal turns
        turns += 1
        if turns == 1:
            clock.wait(None, clock.now_ns() + MS // 2)
        return turns > 5

    assert not Executor(pair.listener).spin(2, until=half_a_millisecond_passes)
    assert end <= clock.now_ns() < end + MS


def test_spin_passes_its_cap_on() -> None:
    session = QueueSession()
    Executor(session, clock=VirtualClock()).spin(until=lambda: len(session.drives) == 2, max_callbacks=1)
    assert session.drives == [(10, 1), (10, 1)]


def test_the_real_clock_is_used_when_nobody_brings_one() -> None:
    assert isinstance(Executor(QueueSession()).clock, MonotonicClock)
