"""``spin_once``: messages and events of one session, with the callback cap (``max_callbacks_per_spin``)."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from nros_conformance.rmw.backend import Session, Subscription
from nros_conformance.rmw.codes import ReturnCode

DataCallback: TypeAlias = Callable[[bytes], None]

MAX_SAMPLE = 65536
"""Room for a received sample, bytes."""


class Executor:
    """Drives one session and dispatches its messages; events come out of ``drive_io`` by themselves.

    An event callback counts as one against the cap, as a message callback does (DSP-008). Where the
    backend queues messages with its events, they run in the order in which they became ready; where
    it cannot, messages are looked for after the drive.
    """

    def __init__(self, session: Session) -> None:
        self.session = session
        self._polled: list[tuple[Subscription, DataCallback]] = []
        self._ran = 0

    def add_subscription(self, subscription: Subscription, callback: DataCallback) -> None:
        """Have ``callback(data)`` called for every sample of this subscription."""

        def on_message(_context: object) -> None:
            self._ran += 1
            self._take(subscription, callback)

        if subscription.set_message_callback(on_message, None) != ReturnCode.OK:
            self._polled.append((subscription, callback))

    def note_callback(self) -> None:
        """An event callback ran: it counts against the cap of the spin in progress."""
        self._ran += 1

    def remove_subscription(self, subscription: Subscription) -> None:
        """Stop taking its samples."""
        subscription.set_message_callback(None, None)
        self._polled = [entry for entry in self._polled if entry[0] is not subscription]

    def spin_once(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        """Drive the session once; the return code of ``drive_io``."""
        self._ran = 0
        code = self.session.drive_io(timeout_ms, max_callbacks)
        for subscription, callback in self._polled:
            while (max_callbacks is None or self._ran < max_callbacks) and subscription.has_data() is True:
                self._ran += 1
                if not self._take(subscription, callback):
                    break
        return code

    @staticmethod
    def _take(subscription: Subscription, callback: DataCallback) -> bool:
        data = subscription.try_recv_raw(MAX_SAMPLE)
        if isinstance(data, bytes):
            callback(data)
            return True
        return False
