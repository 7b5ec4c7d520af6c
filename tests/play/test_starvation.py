from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest

from nros_conformance.play.starvation import Watch
from nros_conformance.rmw.clock import MS
from nros_conformance.trace.records import Starved

pytestmark = pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="only Linux tells how long threads wait")


def schedstat(monkeypatch: pytest.MonkeyPatch, *looks: dict[str, int]) -> None:
    following = iter(looks)
    monkeypatch.setattr("nros_conformance.play.starvation._waits", lambda: next(following))


def test_the_longest_wait_of_one_thread_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    schedstat(monkeypatch, {"1": 5 * MS, "2": 0}, {"1": 8 * MS, "2": 40 * MS}, {"1": 9 * MS, "2": 40 * MS})
    watch = Watch()
    watch.look(0)
    record = watch.look(7)
    assert record is not None
    assert (record.begin, record.wait) == (7, 40 * MS)
    assert watch.look(0) is None  # a millisecond is not worth a word


def test_a_thread_that_is_new_has_waited_since_it_began(monkeypatch: pytest.MonkeyPatch) -> None:
    schedstat(monkeypatch, {}, {"9": 3 * MS})
    watch = Watch()
    watch.look(0)
    record = watch.look(0)
    assert record is not None
    assert record.wait == 3 * MS


def test_who_listens_is_told_until_it_has_finished(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nros_conformance.play.starvation.LOOK_S", 0.001)
    monkeypatch.setattr(Watch, "look", lambda self, begin: Starved(begin=begin, end=begin + 1, wait=5 * MS))
    watch, told, first = Watch(), list[Starved](), threading.Event()

    def note(record: Starved) -> None:
        told.append(record)
        first.set()

    watch.start()
    with watch.telling(note) as finish:
        assert first.wait(20)
        finish()
        count = len(told)
        other = threading.Event()
        with watch.telling(lambda record: other.set()):
            assert other.wait(20)
        assert len(told) == count


def test_sleeping_is_no_waiting() -> None:
    watch = Watch()
    sleeper = threading.Thread(target=time.sleep, args=(0.05,))
    sleeper.start()
    watch.look(0)
    sleeper.join()
    record = watch.look(0)
    assert record is None or record.wait < 50 * MS
