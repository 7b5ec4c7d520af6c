"""``spin``: drives nodes, and with them their messages and events, on the calling thread."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from datetime import timedelta

from nros_conformance.node.dispatcher import DataCallback, Dispatcher
from nros_conformance.node.errors import raise_for
from nros_conformance.node.node import Node
from nros_conformance.rmw.backend import Session, Subscription
from nros_conformance.rmw.clock import MS, NEVER, Clock, MonotonicClock
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.qos import milliseconds

TURN_MS = 1
"""How long one of several sessions may wait while the others have to; bounds what they add to a latency."""

SPIN_MS = 10
"""How long `Executor.spin` waits before it looks at its condition again."""

EVERY = timedelta(milliseconds=1)
"""How often an event loop looks at the middleware, as ``spin_async`` of nano-ros does."""


class Executor:
    """Drives nodes (or bare sessions). Callbacks run inside, on the thread that spins (DSP-002).

    An event callback counts as one against ``max_callbacks``, as a message callback does (DSP-008).
    Several sessions take turns of 1 ms in waiting, beginning with another one each spin.

    An exception of a callback comes out of the spin that called it, once, after the other callbacks
    of that drive; later events are delivered all the same.
    """

    def __init__(self, *driven: Node | Session, clock: Clock | None = None) -> None:
        if not driven:
            raise ValueError("an executor needs a node to drive")
        self._dispatchers = [one.dispatcher if isinstance(one, Node) else Dispatcher(one) for one in driven]
        self._next = 0
        nodes = [one for one in driven if isinstance(one, Node)]
        self.clock = clock or (nodes[0].clock if nodes else MonotonicClock())
        self.ran = 0
        """Callbacks of the last spin, messages and events together."""

    def spin_once(self, timeout: timedelta | int = 0, max_callbacks: int | None = None) -> int:
        """Wait for something to do, at most ``timeout``, and dispatch what is ready; at least looks once.

        ``timeout``: a timedelta (a fraction of 1 ms rounds up), or whole milliseconds as ``drive_io``
        takes them. At most ``max_callbacks`` run; what is left runs in later spins. The return code of
        ``drive_io``: OK, or the first failure; WOULD_BLOCK and nothing else from inside a callback
        (DSP-003). Raises what a callback raised.
        """
        timeout_ms = _timeout_ms(timeout)
        if any(dispatcher.driving for dispatcher in self._dispatchers):
            return int(ReturnCode.WOULD_BLOCK)
        self.ran = 0
        if len(self._dispatchers) == 1:
            return int(self._drive(self._dispatchers[0], timeout_ms, max_callbacks))
        return int(self._take_turns(timeout_ms, max_callbacks))

    def spin(
        self, duration: timedelta | int | None = None, *, until: Callable[[], bool] | None = None,
        max_callbacks: int | None = None,
    ) -> bool:  # fmt: skip
        """Spin for ``duration``, for ever without one, or until ``until()`` holds; whether it held.

        ``until`` is looked at before each `spin_once`, so at least every 10 ms. Raises `RmwError` when
        ``drive_io`` fails (a lost peer, CON-007), and what a callback raised.
        """
        end = NEVER if duration is None else self.clock.now_ns() + _timeout_ms(duration) * MS
        while until is None or not until():
            left = end - self.clock.now_ns()
            if left <= 0:
                return False
            raise_for(self.spin_once(min(SPIN_MS, -(-left // MS)), max_callbacks), "drive_io")
        return True

    async def spin_async(self, every: timedelta = EVERY, max_callbacks: int | None = None) -> None:
        """Spin on the thread of the event loop until cancelled; between two looks other tasks run.

        Raises as `spin` does, and may be called again afterwards. See `spinning`, which also ends the
        tasks that would wait for ever then.
        """
        from nros_conformance.node import aio  # asyncio costs start-up time that the player need not pay

        await aio.spin_async(self, every, max_callbacks)

    def spinning(
        self, every: timedelta = EVERY, max_callbacks: int | None = None
    ) -> AbstractAsyncContextManager[None]:  # fmt: skip
        """``async with executor.spinning():`` spins as `spin_async` does while the block runs.

        When spinning fails, the block is cancelled and the failure raised in its place: an await for an
        event that nobody can deliver any more does not hang.
        """
        from nros_conformance.node import aio

        return aio.spinning(self, every, max_callbacks)

    # For those who hold entities of the contract; with one session only.

    def add_subscription(self, subscription: Subscription, callback: DataCallback) -> None:
        """Have ``callback(data)`` called for every sample of this subscription."""
        self._only.add_subscription(subscription, callback)

    def remove_subscription(self, subscription: Subscription) -> None:
        """Stop taking its samples."""
        self._only.remove_subscription(subscription)

    def note_callback(self) -> None:
        """An event callback that was registered elsewhere ran: it counts against the cap of this spin."""
        self._only.note_callback()

    @property
    def _only(self) -> Dispatcher:
        (dispatcher,) = self._dispatchers
        return dispatcher

    def _take_turns(self, timeout_ms: int, max_callbacks: int | None) -> int:
        order = self._dispatchers[self._next :] + self._dispatchers[: self._next]
        self._next = (self._next + 1) % len(self._dispatchers)
        left_ms = max(timeout_ms, 0)
        while True:
            for dispatcher in order:
                cap = None if max_callbacks is None else max(max_callbacks - self.ran, 0)
                wait_ms = 0 if self.ran else min(TURN_MS, left_ms)
                left_ms -= wait_ms
                code = self._drive(dispatcher, wait_ms, cap)
                if code != ReturnCode.OK:
                    return code
            if self.ran or not left_ms:
                return ReturnCode.OK

    def _drive(self, dispatcher: Dispatcher, timeout_ms: int, max_callbacks: int | None) -> int:
        try:
            return dispatcher.drive(timeout_ms, max_callbacks)
        finally:
            self.ran += dispatcher.ran


def _timeout_ms(timeout: timedelta | int) -> int:
    if isinstance(timeout, timedelta):
        return milliseconds(timeout)
    if not isinstance(timeout, int):
        raise TypeError(f"a timeout is a timedelta or whole milliseconds, not {timeout!r}")
    return timeout
