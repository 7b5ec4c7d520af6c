"""The receiving end: a data reader at the agent, and the receive queue."""

from __future__ import annotations

from collections import deque

from nros_backends.xrce.ends import End
from nros_conformance.rmw.backend import MessageCallback, Subscription
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import EventKind


class _Sample:
    __slots__ = ("announced", "at_ns", "payload", "waiting")

    def __init__(self, payload: bytes, at_ns: int) -> None:
        self.payload = payload
        self.at_ns = at_ns
        self.waiting = True
        self.announced = False


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
        self._waiting: deque[_Sample] = deque()
        self._listening = False

    def has_data(self) -> bool | int:
        return ReturnCode.INVALID_ARGUMENT if self.closed else bool(self._waiting)

    def try_recv_raw(self, max_size: int) -> bytes | int:
        """The oldest sample. One larger than ``max_size`` is dropped and counted in ``too_large`` (ROB-002)."""
        if self.closed or not isinstance(max_size, int) or max_size < 0:
            return ReturnCode.INVALID_ARGUMENT
        if not self._waiting:
            return ReturnCode.NO_DATA
        payload = self._pop().payload
        if len(payload) > max_size:
            self.too_large += 1
            return ReturnCode.BUFFER_TOO_SMALL
        return payload

    def set_message_callback(self, callback: MessageCallback | None, context: object) -> int:
        code = self.registry.set_message_callback(callback, context)
        self._listening = code == ReturnCode.OK and callback is not None
        for sample in self._waiting:
            self._announce(sample)
        return code

    def arrived(self, payload: bytes, at_ns: int) -> None:
        """A sample came at ``at_ns``."""
        if self.closed:
            return
        self.moved(at_ns)
        sample = _Sample(payload, at_ns)
        self._waiting.append(sample)
        while len(self._waiting) > self.qos.depth:
            self._pop()
            self.dropped += 1
        self._announce(sample)

    def destroy(self) -> int:
        code = super().destroy()
        self._waiting.clear()
        return code

    def _announce(self, sample: _Sample) -> None:
        """Queue one message callback per sample that can still be taken when it runs."""
        if self._listening and sample.waiting and not sample.announced:
            sample.announced = True
            self.registry.message(sample.at_ns, lambda: sample.waiting)

    def _pop(self) -> _Sample:
        sample = self._waiting.popleft()
        sample.waiting = False
        return sample
