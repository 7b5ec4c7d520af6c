"""Who drives a session: one `Session.drive_io` at a time, and none any more while it is being destroyed."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from nros_conformance.rmw.clock import MS, Clock
from nros_conformance.rmw.codes import ReturnCode


class Driving:
    """The arguments and the exclusion of `drive_io`, for adapters that write the loop themselves."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._driver: int | None = None

    @property
    def under_way(self) -> bool:
        """Whether somebody drives now."""
        return self._driver is not None

    def drive(self, timeout_ms: int, max_callbacks: int | None, loop: Callable[[int, int | None], object]) -> int:
        """Call ``loop(until_ns, max_callbacks)``: OK. A negative timeout is 0 (C10).

        INVALID_ARGUMENT for what is no number, or a negative cap; WOULD_BLOCK while another call is in progress,
        on another thread or further up on this one, as when a callback drives (DSP-003).
        """
        whole = isinstance(timeout_ms, int) and (max_callbacks is None or isinstance(max_callbacks, int))
        if not whole or (max_callbacks or 0) < 0:
            return ReturnCode.INVALID_ARGUMENT
        if not self._lock.acquire(blocking=False):
            return ReturnCode.WOULD_BLOCK
        self._driver = threading.get_ident()
        try:
            loop(self._clock.now_ns() + max(timeout_ms, 0) * MS, max_callbacks)
        finally:
            self._driver = None
            self._lock.release()
        return ReturnCode.OK

    @contextmanager
    def ended(self) -> Iterator[None]:
        """Without a driver: first waits for one on another thread to leave, which the loop has to do by itself.

        For `Session.destroy`. From a callback, on the driving thread itself, it waits for nobody.
        """
        outside = self._driver != threading.get_ident()
        if outside:
            self._lock.acquire()
        try:
            yield
        finally:
            if outside:
                self._lock.release()
