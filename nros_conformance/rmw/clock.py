"""Time as backends and the player see it: the real monotonic clock, or a virtual one.

Both offer the same blocking calls, so the code that plays a scenario is the same for both. Under the
real clock a task is a thread; under the virtual clock it is a greenlet of one thread, and time jumps
to the next moment at which a task wants to run.
"""

from __future__ import annotations

import abc
import heapq
import os
import threading
import time
from collections.abc import Callable
from typing import TypeVar

import greenlet

MS = 1_000_000
"""Nanoseconds in a millisecond. All times in this project are integers in nanoseconds."""

NEVER = 2**63 - 1
"""A time that does not come."""

_T = TypeVar("_T")


class Signal(abc.ABC):
    """A flag that one task sets and another waits for with `Clock.wait`."""

    @abc.abstractmethod
    def set(self) -> None:
        """Raise the flag and wake the waiting task."""

    @abc.abstractmethod
    def clear(self) -> None:
        """Lower the flag."""

    @abc.abstractmethod
    def is_set(self) -> bool:
        """Whether the flag is up."""


class Task:
    """A running function; `done` is set when it has ended, `error` is what it raised."""

    def __init__(self, name: str, done: Signal) -> None:
        self.name = name
        self.done = done
        self.error: BaseException | None = None

    def _run(self, function: Callable[[], None]) -> None:
        try:
            function()
        except Exception as error:  # handed to whoever looks at the task
            self.error = error
        finally:
            self.done.set()


class Clock(abc.ABC):
    """A monotonic clock with the blocking calls that depend on it."""

    virtual: bool

    @abc.abstractmethod
    def now_ns(self) -> int:
        """Nanoseconds; comparable between all processes of the host when the clock is real."""

    @abc.abstractmethod
    def signal(self) -> Signal:
        """A new, lowered flag."""

    @abc.abstractmethod
    def wait(self, signal: Signal | None, until_ns: int) -> bool:
        """Block until the flag is up or the time has come; whether the flag is up."""

    @abc.abstractmethod
    def spawn(self, name: str, function: Callable[[], None]) -> Task:
        """Start a task."""

    @abc.abstractmethod
    def run_delay_ns(self) -> int:
        """How long this task has been runnable but not running, since it began."""

    @abc.abstractmethod
    def task_id(self) -> int:
        """Identifies the calling task (a thread, or a greenlet)."""


class _ThreadSignal(Signal):
    def __init__(self) -> None:
        self.event = threading.Event()

    def set(self) -> None:
        self.event.set()

    def clear(self) -> None:
        self.event.clear()

    def is_set(self) -> bool:
        return self.event.is_set()


class _Schedstat:
    """The calling thread's schedstat, kept open because it is read twice a spin; closed with the thread."""

    def __init__(self) -> None:
        try:
            self._fd: int | None = os.open("/proc/thread-self/schedstat", os.O_RDONLY | os.O_CLOEXEC)
        except OSError:
            self._fd = None  # not Linux

    def run_delay_ns(self) -> int:
        return 0 if self._fd is None else int(os.pread(self._fd, 64, 0).split()[1])

    def __del__(self) -> None:
        if self._fd is not None:
            os.close(self._fd)


class MonotonicClock(Clock):
    """CLOCK_MONOTONIC and threads."""

    virtual = False

    def __init__(self) -> None:
        self._local = threading.local()

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def signal(self) -> Signal:
        return _ThreadSignal()

    def wait(self, signal: Signal | None, until_ns: int) -> bool:
        assert signal is None or isinstance(signal, _ThreadSignal)
        left = until_ns - time.monotonic_ns()
        if signal is None:
            if left > 0:
                time.sleep(left / 1e9)
            return False
        return signal.event.wait(min(max(left, 0) / 1e9, threading.TIMEOUT_MAX))

    def spawn(self, name: str, function: Callable[[], None]) -> Task:
        task = Task(name, self.signal())
        # Daemons: a session that never returns from drive_io must not keep the worker alive.
        threading.Thread(target=task._run, args=(function,), name=name, daemon=True).start()
        return task

    def run_delay_ns(self) -> int:
        """Field 2 of the thread's schedstat (Linux), about 1 us a read; 0 where there is none."""
        try:
            schedstat: _Schedstat = self._local.schedstat
        except AttributeError:
            schedstat = self._local.schedstat = _Schedstat()
        return schedstat.run_delay_ns()

    def task_id(self) -> int:
        return threading.get_ident()


class _GreenSignal(Signal):
    def __init__(self, clock: VirtualClock) -> None:
        self._clock = clock
        self._up = False
        self.waiting: greenlet.greenlet | None = None

    def set(self) -> None:
        self._up = True
        if self.waiting is not None:
            self._clock.wake(self.waiting)
            self.waiting = None

    def clear(self) -> None:
        self._up = False

    def is_set(self) -> bool:
        return self._up


class Deadlock(RuntimeError):
    """Every task of a virtual clock waits for another one."""


class VirtualClock(Clock):
    """Simulated time for backends that live on it; deterministic, one thread.

    Tasks that are due at the same time run in the order in which they were put to sleep.
    """

    virtual = True

    def __init__(self, start_ns: int = 10_000 * MS) -> None:
        self._now = start_ns
        self._order = 0
        self._due: list[tuple[int, int, greenlet.greenlet]] = []
        self._sleeping: dict[greenlet.greenlet, int] = {}
        self._hub: greenlet.greenlet | None = None

    def now_ns(self) -> int:
        return self._now

    def signal(self) -> Signal:
        return _GreenSignal(self)

    def run(self, function: Callable[[], _T]) -> _T:
        """Run ``function`` as the first task, with all that it spawns, until it returns.

        Raises `Deadlock` when it waits for something that no task will ever do.
        """
        outcome: list[_T] = []
        main = greenlet.greenlet(lambda: outcome.append(function()))
        self._hub = greenlet.getcurrent()
        self._schedule(main, self._now)
        while not main.dead:
            if not self._due:
                raise Deadlock(f"all tasks wait at {self._now} ns")
            when, order, task = heapq.heappop(self._due)
            if self._sleeping.get(task) != order:
                continue  # woken earlier, or ended
            if when == NEVER:
                raise Deadlock(f"all tasks wait for ever at {self._now} ns")
            del self._sleeping[task]
            self._now = max(self._now, when)
            task.switch()
        return outcome[0]

    def wait(self, signal: Signal | None, until_ns: int) -> bool:
        assert signal is None or isinstance(signal, _GreenSignal)
        if signal is not None and signal.is_set():
            return True
        if until_ns <= self._now:
            return False
        if self._hub is None or greenlet.getcurrent() is self._hub:
            self._now = until_ns  # used without tasks, as unit tests do
            return False
        task = greenlet.getcurrent()
        self._schedule(task, until_ns)
        if signal is None:
            self._hub.switch()
            return False
        signal.waiting = task
        self._hub.switch()
        signal.waiting = None
        return signal.is_set()

    def wake(self, task: greenlet.greenlet) -> None:
        """Let a sleeping task run at the present time."""
        if task in self._sleeping:
            self._schedule(task, self._now)

    def spawn(self, name: str, function: Callable[[], None]) -> Task:
        task = Task(name, self.signal())
        self._schedule(greenlet.greenlet(lambda: task._run(function), parent=self._hub), self._now)
        return task

    def run_delay_ns(self) -> int:
        return 0

    def task_id(self) -> int:
        return id(greenlet.getcurrent())

    def _schedule(self, task: greenlet.greenlet, when: int) -> None:
        self._order += 1
        self._sleeping[task] = self._order
        heapq.heappush(self._due, (when, self._order, task))
