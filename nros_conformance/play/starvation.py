"""Watches how long threads of this process, the middleware's own among them, wait for a core."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from nros_conformance.rmw.clock import MS
from nros_conformance.trace.records import Starved

LOOK_S = 0.1
"""How often all threads are looked at: some 6 us for each, so 1 % of a core with 150 threads."""

_WORTH_NS = 2 * MS
"""Shorter waits are below every tolerance and are not written down."""

Note = Callable[[Starved], None]


class Watch:
    """Tells every play that goes on what its threads had to wait. Linux only; elsewhere it sees nothing."""

    def __init__(self) -> None:
        self._notes: list[Note] = []
        self._lock = threading.Lock()
        self._waited: dict[str, int] = {}

    def start(self) -> None:
        """Look from now on, until the process ends."""
        self._waited = _waits()
        threading.Thread(target=self._loop, name="starvation", daemon=True).start()

    @contextmanager
    def telling(self, note: Note) -> Iterator[Callable[[], None]]:
        """Have ``note`` called with each record, meanwhile or until what is yielded here is called."""

        def finish() -> None:
            with self._lock:
                self._notes = [one for one in self._notes if one is not note]

        with self._lock:
            self._notes.append(note)
        try:
            yield finish
        finally:
            finish()

    def look(self, begin: int) -> Starved | None:
        """The longest wait of one thread since the look at ``begin``; None if it is not worth a word."""
        waited = _waits()
        longest = max((total - self._waited.get(thread, 0) for thread, total in waited.items()), default=0)
        self._waited = waited
        return Starved(begin=begin, end=time.monotonic_ns(), wait=longest) if longest >= _WORTH_NS else None

    def _loop(self) -> None:
        begin = time.monotonic_ns()
        while True:
            time.sleep(LOOK_S)
            record = self.look(begin)
            begin = time.monotonic_ns()
            if record is not None:
                with self._lock:
                    for note in self._notes:
                        note(record)


def _waits() -> dict[str, int]:
    """By thread: how long it has been runnable but not running, ns (field 2 of its schedstat)."""
    found = {}
    try:
        threads = os.listdir("/proc/self/task")  # noqa: PTH208 - a hundred times a second is not worth the objects
    except OSError:
        return {}
    for thread in threads:
        try:
            with open(f"/proc/self/task/{thread}/schedstat", "rb") as file:  # noqa: PTH123
                found[thread] = int(file.read().split()[1])
        except OSError:  # it has just ended
            continue
    return found
