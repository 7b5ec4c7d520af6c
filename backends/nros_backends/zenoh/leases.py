"""MANUAL liveliness: a lease on the shim's clock for each publisher, and a thread that watches over them.

The thread is there because MANUAL liveliness exists to find an application that hangs, which then does not call
`drive_io` either. It withdraws tokens and counts; it calls nothing of the application's.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from nros_conformance.rmw.clock import NEVER, Clock
from nros_conformance.rmw.detection import CountTracker


class ManualLease:
    """When a publisher has to assert next. Creation is its first assertion; its loss is counted once."""

    def __init__(self, lease_ns: int, now_ns: int) -> None:
        self.lost = CountTracker()
        self._lease_ns = lease_ns
        self._asserted_ns = now_ns
        self._expired = False

    @property
    def due_ns(self) -> int:
        """When it expires; `NEVER` after that, and for an infinite lease."""
        return NEVER if self._expired or self._lease_ns == NEVER else self._asserted_ns + self._lease_ns

    def renew(self, now_ns: int) -> bool:
        """An assertion; whether the lease had expired."""
        self.update(now_ns)
        returned, self._expired, self._asserted_ns = self._expired, False, now_ns
        return returned

    def update(self, now_ns: int) -> bool:
        """Whether it has expired since the last look."""
        due = self.due_ns
        if now_ns < due:
            return False
        self._expired = True
        self.lost.add(1, due)
        return True


class Watch:
    """A thread that calls ``look()`` when it is due; ``look`` returns when it is due next, ns."""

    def __init__(self, clock: Clock, look: Callable[[], int]) -> None:
        self._clock = clock
        self._look = look
        self._changed = threading.Condition()
        self._again = False
        self._stopped = False
        self._thread = threading.Thread(target=self._run, name="zenoh-leases", daemon=True)
        self._thread.start()

    def nudge(self) -> None:
        """There is a new lease."""
        with self._changed:
            self._again = True
            self._changed.notify()

    def stop(self) -> None:
        """End the thread and wait for it."""
        with self._changed:
            self._stopped = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            due = self._look()
            with self._changed:
                if not self._again and not self._stopped:
                    left = (due - self._clock.now_ns()) / 1e9
                    self._changed.wait(min(max(left, 0), threading.TIMEOUT_MAX))
                self._again = False
                if self._stopped:
                    return
