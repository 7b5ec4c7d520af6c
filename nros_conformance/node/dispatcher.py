"""The callbacks of one session: messages and events under one cap (``max_callbacks_per_spin``)."""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Callable
from typing import TypeAlias, TypeVar

from nros_conformance.node.errors import raise_for
from nros_conformance.rmw.backend import Session, Subscription
from nros_conformance.rmw.codes import ReturnCode

DataCallback: TypeAlias = Callable[[bytes], None]
"""``callback(data)``: one serialized sample."""

MAX_SAMPLE = 65536
"""Room for a received sample unless the subscription asks for more, bytes."""

_T = TypeVar("_T")


@dataclasses.dataclass(frozen=True, slots=True)
class _Polled:
    """A subscription whose backend cannot announce messages."""

    subscription: Subscription
    take: Callable[[], bool]


class Dispatcher:
    """Drives one session. ``ran``: callbacks of the last drive, messages and events together (DSP-008).

    Where the backend queues messages with its events, they run in the order in which they became
    ready; where it cannot, messages are looked for after ``drive_io``, as far as the cap leaves room.

    What a callback raises never passes through the middleware, which may not be written in Python: it
    is kept, the rest of the drive goes on, and `drive` raises it (DSP-012).
    """

    def __init__(self, session: Session) -> None:
        self.session = session
        self.ran = 0
        self._polled: list[_Polled] = []
        self._raised: deque[Exception] = deque()
        self.driving = False

    def add_subscription(
        self, subscription: Subscription, callback: DataCallback, max_size: int = MAX_SAMPLE
    ) -> None:  # fmt: skip
        """Have ``callback(data)`` called for every sample; ``max_size``: room for one, bytes."""

        def take() -> bool:
            return self._take(subscription, callback, max_size)

        def on_message(_context: object) -> None:
            self.ran += 1
            take()

        if subscription.set_message_callback(on_message, None) != ReturnCode.OK:
            self._polled.append(_Polled(subscription, take))

    def remove_subscription(self, subscription: Subscription) -> None:
        """Stop taking its samples."""
        subscription.set_message_callback(None, None)
        self._polled = [polled for polled in self._polled if polled.subscription is not subscription]

    def note_callback(self) -> None:
        """An event callback runs: it counts against the cap of the drive in progress."""
        self.ran += 1

    def call(self, callback: Callable[[_T], None], argument: _T) -> None:
        """Call back; an exception waits until the drive is over."""
        try:
            callback(argument)
        except Exception as error:
            self._raised.append(error)

    def drive(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        """Drive the session once, at most ``timeout_ms``; the return code of ``drive_io``.

        Not to be called from inside a callback, when ``driving`` is true (DSP-003). Raises what a callback
        raised; of several exceptions one, and each of the others in a drive of its own, in their order.
        Raises `RmwError` BUFFER_TOO_SMALL for a sample beyond ``max_size``.
        """
        self.driving = True
        try:
            code = self._drive(timeout_ms, max_callbacks)
        finally:
            self.driving = False
        if self._raised:
            raise self._raised.popleft()
        return code

    def _drive(self, timeout_ms: int, max_callbacks: int | None) -> int:
        self.ran = 0
        if self._raised or any(polled.subscription.has_data() is True for polled in self._polled):
            timeout_ms = 0  # something is left to do from last time
        code = self.session.drive_io(timeout_ms, max_callbacks)
        for polled in tuple(self._polled):
            while (max_callbacks is None or self.ran < max_callbacks) and polled.subscription.has_data() is True:
                self.ran += 1
                if not polled.take():
                    break
        return code

    def _take(self, subscription: Subscription, callback: DataCallback, max_size: int) -> bool:
        data = subscription.try_recv_raw(max_size)
        if isinstance(data, bytes):
            self.call(callback, data)
            return True
        if data != ReturnCode.NO_DATA:  # taken by somebody else, or expired since
            self.call(lambda code: raise_for(code, f"receiving from {subscription.topic}"), data)
        return False
