"""Spinning inside an asyncio event loop.

Event callbacks have to run on the thread that calls ``drive_io`` (DSP-002), and sessions are not to be
used from two threads at once. So the event loop's own thread drives, in short looks that do not wait
(``drive_io(0)``), and sleeps in between; callbacks, awaits and the application's calls then share one
thread, as in ``spin_async`` of nano-ros. A thread that waits in ``drive_io`` would save the looks, but
run the callbacks beside the loop, and publish, take and drive on one session from two threads.
The price is latency, up to ``every`` plus the loop's own, and the looks: one idle session with ``every`` = 1 ms
took 3 % of a core, with 5 ms 1 to 2 % (reference, uORB and Cyclone DDS, Python 3.11).

On a virtual clock the wait costs nothing and is done inside ``drive_io``; time of the loop itself, as of
``asyncio.sleep`` and timeouts, stays real.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import timedelta
from typing import TYPE_CHECKING

from nros_conformance.node.errors import raise_for

if TYPE_CHECKING:
    from nros_conformance.node.executor import Executor


async def spin_async(executor: Executor, every: timedelta, max_callbacks: int | None) -> None:
    """`Executor.spin_async`."""
    virtual = executor.clock.virtual
    while True:
        raise_for(executor.spin_once(every if virtual else 0, max_callbacks), "drive_io")
        # After callbacks more may be ready at once; the others get a turn all the same.
        await asyncio.sleep(0 if virtual or executor.ran else every.total_seconds())


@asynccontextmanager
async def spinning(executor: Executor, every: timedelta, max_callbacks: int | None) -> AsyncIterator[None]:
    """`Executor.spinning`."""
    spin = asyncio.create_task(spin_async(executor, every, max_callbacks), name="spin")
    block = _Block(spin)
    try:
        yield
    finally:
        block.leave()
        spin.cancel()
        await asyncio.wait([spin])
        block.settle()


class _Block:
    """The body of the ``async with``: cancelled when the spin fails, which then takes its place."""

    def __init__(self, spin: asyncio.Task[None]) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._task = task
        self._spin = spin
        self._left = False
        self._cancelled = False
        spin.add_done_callback(self._spin_ended)

    def leave(self) -> None:
        """The body is over: what happens to the spin from now on does not concern it."""
        self._left = True

    def settle(self) -> None:
        """Raise what the spin raised, unless somebody else has cancelled the task too."""
        elsewhere = False
        if self._cancelled and hasattr(self._task, "uncancel"):  # Python 3.11
            elsewhere = self._task.uncancel() > 0
        error = None if self._spin.cancelled() else self._spin.exception()
        if error is not None and not elsewhere:
            raise error

    def _spin_ended(self, spin: asyncio.Task[None]) -> None:
        if not self._left and not spin.cancelled():
            self._cancelled = True
            self._task.cancel()
