"""The sending end: a data writer at the agent."""

from __future__ import annotations

from nros_backends.xrce.ends import End
from nros_conformance.rmw.backend import Publisher
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import Reliability


class XrcePublisher(End, Publisher):
    """Samples go to the agent on the best-effort or on the reliable stream, as the QoS says."""

    missed_kind = EventKind.OFFERED_DEADLINE_MISSED

    def publish_raw(self, data: object) -> int:
        """OK: handed to the kernel, respectively taken over by the reliable stream.

        MESSAGE_TOO_LARGE: best effort and more than one datagram, or reliable and above `CAPACITY`;
        TIMEOUT: the reliable stream stays full; CONNECTION_FAILED: the agent is gone or does not know
        this session any more; INVALID_ARGUMENT. Nothing has been sent then.
        """
        if self.closed or not isinstance(data, bytes | bytearray | memoryview):
            return ReturnCode.INVALID_ARGUMENT
        code = self.session.send_sample(
            self.object_id, bytes(data), reliable=self.qos.reliability is Reliability.RELIABLE
        )
        if code == ReturnCode.OK:
            self.moved(self.session.clock.now_ns())
        return code

    def assert_liveliness(self) -> int:
        """OK without effect: manual liveliness is refused at creation."""
        return ReturnCode.INVALID_ARGUMENT if self.closed else ReturnCode.OK
