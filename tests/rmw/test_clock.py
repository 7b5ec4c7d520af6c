from __future__ import annotations

import threading
import time

import pytest

from nros_conformance.rmw.clock import MS, NEVER, Deadlock, MonotonicClock, VirtualClock


def test_virtual_time_jumps_to_the_next_task_and_costs_no_real_time() -> None:
    clock = VirtualClock(0)
    seen: list[tuple[str, int]] = []

    def task(name: str, period: int) -> None:
        for _ in range(3):
            clock.wait(None, clock.now_ns() + period)
            seen.append((name, clock.now_ns() // MS))

    def main() -> None:
        tasks = [clock.spawn("a", lambda: task("a", 20 * MS)), clock.spawn("b", lambda: task("b", 3_600_000 * MS))]
        for one in tasks:
            clock.wait(one.done, NEVER)

    begun = time.monotonic()
    clock.run(main)
    assert seen == [("a", 20), ("a", 40), ("a", 60), ("b", 3_600_000), ("b", 7_200_000), ("b", 10_800_000)]
    assert time.monotonic() - begun < 5


def test_virtual_tasks_due_together_run_in_the_order_of_sleeping() -> None:
    def order() -> list[str]:
        clock = VirtualClock()
        seen: list[str] = []

        def sleep(name: str) -> None:
            clock.wait(None, 20_000 * MS)
            seen.append(name)

        def main() -> None:
            tasks = [clock.spawn(name, lambda name=name: sleep(name)) for name in "cab"]  # type: ignore[misc]
            for one in tasks:
                clock.wait(one.done, NEVER)

        clock.run(main)
        return seen

    assert order() == order() == ["c", "a", "b"]


@pytest.mark.parametrize("real", [True, False])
def test_a_signal_wakes_its_waiter_before_the_time_is_up(real: bool) -> None:
    clock = MonotonicClock() if real else VirtualClock()

    def main() -> int:
        signal = clock.signal()
        begin = clock.now_ns()

        def wake() -> None:
            clock.wait(None, begin + 5 * MS)
            signal.set()

        clock.spawn("waker", wake)
        assert clock.wait(signal, begin + 60_000 * MS)
        return clock.now_ns() - begin

    waited = clock.run(main) if isinstance(clock, VirtualClock) else main()
    assert 5 * MS <= waited < 60_000 * MS
    assert real or waited == 5 * MS


@pytest.mark.parametrize("real", [True, False])
def test_a_signal_already_up_does_not_wait_and_cleared_it_does(real: bool) -> None:
    clock = MonotonicClock() if real else VirtualClock()
    signal = clock.signal()
    signal.set()
    before = clock.now_ns()
    assert clock.wait(signal, NEVER)
    signal.clear()
    assert not clock.wait(signal, before + 2 * MS)
    assert clock.now_ns() >= before + 2 * MS


def test_an_exception_of_a_task_is_kept_and_its_end_signalled() -> None:
    clock = VirtualClock()

    def main() -> str:
        task = clock.spawn("broken", lambda: [][0])
        clock.wait(task.done, NEVER)
        return repr(task.error)

    assert clock.run(main) == "IndexError('list index out of range')"


def test_waiting_for_what_nobody_will_do_is_a_deadlock() -> None:
    clock = VirtualClock()
    with pytest.raises(Deadlock, match="all tasks wait for ever"):
        clock.run(lambda: clock.wait(clock.signal(), NEVER))


def test_an_exception_of_the_first_task_comes_out_of_run() -> None:
    with pytest.raises(ZeroDivisionError):
        VirtualClock().run(lambda: 1 // 0)


def test_run_delay_counts_waiting_for_a_core_and_not_sleeping() -> None:
    clock = MonotonicClock()

    def waited() -> int:
        before = clock.run_delay_ns()
        time.sleep(0.02)
        return clock.run_delay_ns() - before

    # A busy host has it wait for a core afterwards, but not each time for so long.
    assert 0 <= min(waited() for _ in range(20)) < 20 * MS


def test_tasks_of_the_real_clock_are_threads_of_their_own() -> None:
    clock = MonotonicClock()
    ids: list[int] = []
    task = clock.spawn("one", lambda: ids.append(clock.task_id()))
    assert clock.wait(task.done, clock.now_ns() + 10_000 * MS)
    assert ids != [threading.get_ident()]
