"""Watches how long threads of this process, the middleware's own among them, wait for a core."""

from __future__ import annotations

import os
import resource
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from nros_conformance.play.process import passing
from nros_conformance.rmw.clock import MS, Clock, Signal
from nros_conformance.trace.records import Starved

LOOK_S = 0.1
"""How often all threads are looked at: some 2 us for each, so 1 % of a core with 500 threads."""

_WORTH_NS = 2 * MS
"""Shorter waits are below every tolerance and are not written down."""

_GLANCE_NS = 500 * MS
"""Over which it is decided whether threads get their cores."""

_MOST_CROWDED = 10.0

Note = Callable[[Starved], None]


def crowding() -> float:
    """How many times longer work may take than it should, by the load of the last minute: 1 to 10."""
    return min(max(os.getloadavg()[0] / (2 * (os.cpu_count() or 1)), 1.0), _MOST_CROWDED)


class _Listener:
    """A play, and the processes beside this one that it depends on."""

    def __init__(self, note: Note, processes: Callable[[], Sequence[int]]) -> None:
        self.note = note
        self._processes = processes
        self._waited: dict[int, dict[str, int]] = {}

    def longest(self) -> int:
        """Of its other processes, as `Watch.look`."""
        before, self._waited = self._waited, {process: _waits(process) for process in self._processes()}
        return max((_longest(before.get(one, {}), waits) for one, waits in self._waited.items()), default=0)


class Watch:
    """Tells every play that goes on what its threads had to wait. Linux only; elsewhere it sees nothing."""

    def __init__(self) -> None:
        self._listeners: list[_Listener] = []
        self._lock = threading.Lock()
        self._waits: Callable[[], dict[str, int]] = _waits
        self._waited: dict[str, int] = {}
        self._looked = 0

    def start(self, *, at_hand: bool = False) -> None:
        """Look from now on, until the process ends.

        ``at_hand``: with a descriptor for each thread, which is four times quicker, and seen by who counts those.
        """
        if at_hand:
            self._waits = _Threads("self", resource.getrlimit(resource.RLIMIT_NOFILE)[0] // 4).waits
        self._waited, self._looked = self._waits(), time.monotonic_ns()
        threading.Thread(target=self._loop, name="starvation", daemon=True).start()

    @contextmanager
    def telling(self, note: Note, processes: Callable[[], Sequence[int]] = tuple) -> Iterator[None]:
        """Have ``note`` called with each record, meanwhile; threads of ``processes()`` count for this play only.

        There is a last look at the end: what a play waited for just before would come to light after it.
        """
        listener = _Listener(note, processes)
        with self._lock:
            self._listeners.append(listener)
        try:
            yield
        finally:
            with self._lock:
                self._tell()
                self._listeners.remove(listener)

    def look(self) -> int:
        """The longest wait of one thread of this process since the look before, ns."""
        before, self._waited = self._waited, self._waits()
        return _longest(before, self._waited)

    def _loop(self) -> None:
        while True:
            time.sleep(LOOK_S)
            with self._lock:
                self._tell()

    def _tell(self) -> None:
        """Look, and tell everybody for whom it is worth a word; with the lock."""
        own, begin = self.look(), self._looked
        self._looked = time.monotonic_ns()
        for listener in self._listeners:
            longest = max(own, listener.longest())
            if longest >= _WORTH_NS:
                listener.note(Starved(begin=begin, end=self._looked, wait=longest))


def wait_patiently(clock: Clock, done: Signal, limit: int, patience_ns: int, processes: Sequence[int | str]) -> bool:
    """Wait until it is ``done``, or the ``limit`` is over and nothing excuses it: whether it is done.

    For up to ``patience_ns`` more it is excused while a thread of these processes (ids, or ``self``) stands
    without a core for a quarter of the time: a start of Python took 7 s with 45 others on two cores.
    """
    if clock.wait(done, limit):
        return True
    while not clock.virtual and clock.now_ns() < limit + patience_ns:
        before, begin = [_waits(process) for process in processes], clock.now_ns()
        if clock.wait(done, begin + _GLANCE_NS):
            return True
        lasted, after = clock.now_ns() - begin, [_waits(process) for process in processes]
        if 4 * max(map(_longest, before, after), default=0) < lasted:
            return False
    return False


def _longest(before: dict[str, int], after: dict[str, int]) -> int:
    return max((total - before.get(thread, 0) for thread, total in after.items()), default=0)


class _Threads:
    """The threads of a process, the schedstats of ``most`` of them kept open: 2 us to read, 7 with opening."""

    def __init__(self, process: int | str, most: int) -> None:
        self._process = process
        self._most = most
        self._kept: dict[str, int] = {}

    def waits(self) -> dict[str, int]:
        """By thread: how long it has been runnable but not running, ns."""
        with passing:
            return self._read()

    def _read(self) -> dict[str, int]:
        found: dict[str, int] = {}
        before, self._kept = self._kept, {}
        for thread in _threads(self._process):
            descriptor = before.pop(thread, None)
            try:
                if descriptor is None:
                    descriptor = _open(self._process, thread)
                found[thread] = _wait(descriptor)
            except OSError:  # it has just ended
                pass
            if descriptor is not None and thread in found and len(self._kept) < self._most:
                self._kept[thread] = descriptor
            elif descriptor is not None:
                os.close(descriptor)
        for descriptor in before.values():
            os.close(descriptor)
        return found


def _waits(process: int | str = "self") -> dict[str, int]:
    """Of the threads of a process that is looked at now and then."""
    return _Threads(process, 0).waits()


def _threads(process: int | str) -> list[str]:
    try:
        return os.listdir(f"/proc/{process}/task")  # noqa: PTH208 - a hundred times a second is not worth the objects
    except OSError:
        return []


def _open(process: int | str, thread: str) -> int:
    return os.open(f"/proc/{process}/task/{thread}/schedstat", os.O_RDONLY | os.O_CLOEXEC)


def _wait(schedstat: int) -> int:
    """Field 2."""
    return int(os.pread(schedstat, 64, 0).split()[1])
