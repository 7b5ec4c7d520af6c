"""The receiving end: a data reader at the agent, and the receive queue."""

from __future__ import annotations

from nros_backends.xrce.ends import End
from nros_conformance.rmw.backend import MessageCallback, Subscription
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.receive_queue import ReceiveQueue


class XrceSubscription(End, Subscription):
    """The queue keeps the newest samples, as many as the QoS' depth.

    Which samples were lost it cannot say, so MessageLost is refused; ``dropped`` and ``too_large`` count
    those that this end itself gave up: pushed out of the full queue, and taken into too small a buffer.
    """

    missed_kind = EventKind.REQUESTED_DEADLINE_MISSED

    dropped = 0
    too_large = 0
    request = 0
    """Of the READ_DATA that it gets its samples by."""

    def __init__(self, *arguments: object) -> None:
        super().__init__(*arguments)  # type: ignore[arg-type]
        self._waiting = ReceiveQueue(self.qos, self.registry, self.session.clock)

    def has_data(self) -> bool | int:
        return self._waiting.has_data()

    def try_recv_raw(self, max_size: int) -> bytes | int:
        """The oldest sample. One larger than ``max_size`` is dropped and counted in ``too_large`` (ROB-002)."""
        taken = self._waiting.try_recv_raw(max_size)
        self.too_large += self._waiting.dropped()
        return taken

    def set_message_callback(self, callback: MessageCallback | None, context: object) -> int:
        return self._waiting.set_message_callback(callback, context)

    def arrived(self, payload: bytes, at_ns: int) -> None:
        """A sample came at ``at_ns``."""
        if self.closed:
            return
        self.moved(at_ns)
        self.dropped += self._waiting.put(payload, at_ns)

    def destroy(self) -> int:
        code = super().destroy()
        self._waiting.clear()
        return code
