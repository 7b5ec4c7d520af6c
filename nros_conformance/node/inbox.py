"""Events that wait to be awaited."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Generic, TypeVar

from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import CountStatus, LivelinessChangedStatus

S = TypeVar("S", LivelinessChangedStatus, CountStatus)


class Inbox(Generic[S]):
    """Statuses in the order in which they came, each for exactly one await.

    Nothing is dropped, so it grows for as long as nobody awaits. The thread that drives may be
    another one than that of the event loop.
    """

    def __init__(self) -> None:
        self._statuses: deque[S] = deque()
        self._waiters: list[asyncio.Future[None]] = []
        self._closed = ""

    def put(self, status: S) -> None:
        """Add one; called by the driving thread."""
        self._statuses.append(status)
        self._wake()

    def close(self, reason: str) -> None:
        """No more will come: awaits raise, once what is here has been awaited."""
        self._closed = reason
        self._wake()

    async def next(self) -> S:
        """The oldest status. Cancelling loses nothing: it is taken in the very step that returns it.

        Raises `RmwError` INVALID_ARGUMENT when none is left and none can come.
        """
        while not self._statuses:
            if self._closed:
                raise RmwError(ReturnCode.INVALID_ARGUMENT, self._closed)
            waiter = asyncio.get_running_loop().create_future()
            self._waiters.append(waiter)
            try:
                # Looked at again: another thread that put something before it could see the waiter wakes nobody.
                if not self._statuses and not self._closed:
                    await waiter
            finally:
                self._waiters.remove(waiter)
        return self._statuses.popleft()

    def _wake(self) -> None:
        # All of them: each looks for itself, so a waiter that is cancelled meanwhile keeps nothing from the others.
        for waiter in tuple(self._waiters):
            waiter.get_loop().call_soon_threadsafe(_release, waiter)


def _release(waiter: asyncio.Future[None]) -> None:
    if not waiter.done():
        waiter.set_result(None)
