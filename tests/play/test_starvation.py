from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import pytest

from nros_conformance.play import starvation
from nros_conformance.play.process import QUANTITIES
from nros_conformance.play.starvation import Watch, wait_patiently
from nros_conformance.rmw.clock import MS, MonotonicClock, VirtualClock
from nros_conformance.trace.records import Starved

pytestmark = pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="only Linux tells how long threads wait")


def schedstat(monkeypatch: pytest.MonkeyPatch, *looks: dict[str, int]) -> None:
    following, test = iter(looks), threading.current_thread()

    def waits(process: str = "self") -> dict[str, int]:
        # The watch of another test goes on until the process ends.
        return next(following) if threading.current_thread() is test else {}

    monkeypatch.setattr("nros_conformance.play.starvation._waits", waits)


def test_the_longest_wait_of_one_thread_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    schedstat(monkeypatch, {"1": 5 * MS, "2": 0}, {"1": 8 * MS, "2": 40 * MS}, {"1": 9 * MS, "2": 40 * MS})
    watch = Watch()
    watch.look()
    assert [watch.look(), watch.look()] == [40 * MS, MS]


def test_a_thread_that_is_new_has_waited_since_it_began(monkeypatch: pytest.MonkeyPatch) -> None:
    schedstat(monkeypatch, {}, {"9": 3 * MS})
    watch = Watch()
    watch.look()
    assert watch.look() == 3 * MS


def test_who_listens_is_told_until_it_has_finished(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nros_conformance.play.starvation.LOOK_S", 0.001)
    monkeypatch.setattr(Watch, "look", lambda self: 5 * MS)
    watch, told, first = Watch(), list[Starved](), threading.Event()

    def note(record: Starved) -> None:
        told.append(record)
        first.set()

    watch.start()
    with watch.telling(note):
        assert first.wait(20)
    count = len(told)
    other = threading.Event()
    with watch.telling(lambda record: other.set()):
        assert other.wait(20)
    assert len(told) == count


def test_what_was_waited_for_just_before_the_end_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    schedstat(monkeypatch, {"1": 0}, {"1": 0, "2": 40 * MS}, {"1": 0, "2": 40 * MS})
    monkeypatch.setattr("nros_conformance.play.starvation.LOOK_S", 3600.0)
    watch, told = Watch(), list[Starved]()
    watch.start()
    with watch.telling(told.append):
        assert told == []
    assert [one.wait for one in told] == [40 * MS]
    assert told[0].begin <= told[0].end
    with watch.telling(told.append):
        pass
    assert len(told) == 1


def test_sleeping_is_no_waiting() -> None:
    watch = Watch()

    def waited() -> int:
        sleeper = threading.Thread(target=time.sleep, args=(0.05,))
        sleeper.start()
        watch.look()
        sleeper.join()
        return watch.look()

    # A busy host has a thread wait for a core afterwards, but not each time for so long.
    assert any(waited() < 50 * MS for _ in range(10))


def test_a_millisecond_is_not_worth_a_word(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Watch, "look", lambda self: MS)
    told = list[Starved]()
    with Watch().telling(told.append):
        pass
    assert told == []


def test_threads_of_other_processes_count_for_the_play_that_depends_on_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nros_conformance.play.starvation.LOOK_S", 3600.0)
    others = iter([{"8": 30 * MS, "9": 0}, {"8": 31 * MS, "9": 4 * MS}])
    monkeypatch.setattr("nros_conformance.play.starvation._waits", lambda one="self": {7: next}[one](others))
    monkeypatch.setattr(Watch, "look", lambda self: 3 * MS)
    watch, told, beside = Watch(), list[Starved](), list[Starved]()
    with (
        watch.telling(beside.append),
        watch.telling(told.append, lambda: [7]),
        watch.telling(lambda record: None),
    ):
        pass  # all are told when one of them ends
    assert [one.wait for one in told] == [30 * MS, 4 * MS]
    assert [one.wait for one in beside] == [3 * MS] * 3


def test_what_has_no_core_gets_more_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nros_conformance.play.starvation._GLANCE_NS", MS)
    clock, looks = MonotonicClock(), 0
    done = clock.signal()

    def waits(process: int | str) -> dict[str, int]:
        nonlocal looks
        looks += 1
        if looks == 8:
            done.set()
        return {"1": looks * 1_000 * MS if process == 7 else 0}

    monkeypatch.setattr("nros_conformance.play.starvation._waits", waits)
    assert wait_patiently(clock, done, clock.now_ns() + MS, 60_000 * MS, ["self", 7])


@pytest.mark.parametrize(("waited", "patience_ms"), [(0, 60_000), (1_000 * MS, 5)])
def test_what_has_its_cores_or_had_time_enough_does_not(
    monkeypatch: pytest.MonkeyPatch, waited: int, patience_ms: int
) -> None:
    monkeypatch.setattr("nros_conformance.play.starvation._GLANCE_NS", MS)
    totals = iter(range(0, 1_000_000 * MS, waited or 1))
    monkeypatch.setattr("nros_conformance.play.starvation._waits", lambda process: {"1": next(totals)})
    clock = MonotonicClock()
    assert not wait_patiently(clock, clock.signal(), clock.now_ns() + MS, patience_ms * MS, ["self"])


def test_on_a_virtual_clock_nothing_is_excused() -> None:
    clock = VirtualClock()
    limit = clock.now_ns() + 5 * MS
    assert not clock.run(lambda: wait_patiently(clock, clock.signal(), limit, 60_000 * MS, ["self"]))
    assert clock.now_ns() == limit


def test_threads_at_hand_keep_a_descriptor_each_until_they_end(monkeypatch: pytest.MonkeyPatch) -> None:
    opened, closed = list[str](), list[int]()
    waits = {"1": 10, "2": 20}

    def open_one(process: int | str, thread: str) -> int:
        opened.append(thread)
        return int(thread)

    monkeypatch.setattr(starvation, "_threads", lambda process: list(waits))
    monkeypatch.setattr(starvation, "_open", open_one)
    monkeypatch.setattr(starvation, "_wait", lambda descriptor: waits[str(descriptor)])
    monkeypatch.setattr(os, "close", closed.append)
    threads = starvation._Threads("self", 9)
    assert threads.waits() == waits
    del waits["2"]
    waits |= {"1": 11, "3": 30}
    assert threads.waits() == waits
    assert (opened, closed) == (["1", "2", "3"], [2])
    threads._most = 1
    assert threads.waits() == waits
    assert closed == [2, 3]


def test_threads_at_hand_are_those_of_proc() -> None:
    threads = starvation._Threads("self", 1_000)
    assert str(threading.get_native_id()) in threads.waits()
    held = list(threads._kept.values())
    threads._most = 0
    threads.waits()
    for descriptor in held:
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(descriptor)


def test_no_more_descriptors_than_allowed_are_open_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    still, seen = set[int](), list[int]()

    def open_one(process: int | str, thread: str) -> int:
        still.add(int(thread))
        seen.append(len(still))
        return int(thread)

    monkeypatch.setattr(starvation, "_threads", lambda process: ["1", "2", "3"])
    monkeypatch.setattr(starvation, "_open", open_one)
    monkeypatch.setattr(starvation, "_wait", lambda descriptor: descriptor * MS)
    monkeypatch.setattr(os, "close", still.remove)
    assert starvation._waits(7) == {"1": MS, "2": 2 * MS, "3": 3 * MS}
    assert (seen, still) == ([1, 1, 1], set())
    assert starvation._Threads(7, 1).waits() == {"1": MS, "2": 2 * MS, "3": 3 * MS}
    assert (seen[3:], still) == ([1, 2, 2], {1})


def test_who_counts_descriptors_does_not_count_what_a_look_has_open(monkeypatch: pytest.MonkeyPatch) -> None:
    looking, counted = threading.Event(), list[int]()

    def wait(descriptor: int) -> int:
        looking.set()
        counting.join(0.1)  # it has the time, and does not take it
        return descriptor

    monkeypatch.setattr(starvation, "_wait", wait)
    counting = threading.Thread(target=lambda: counted.append(looking.wait(5.0) and QUANTITIES["descriptors"]()))
    counting.start()
    starvation._waits()
    assert counted == []
    counting.join(5.0)
    assert len(counted) == 1
