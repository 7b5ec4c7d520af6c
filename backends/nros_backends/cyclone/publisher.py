"""The sending end."""

from __future__ import annotations

import collections
import threading
import uuid
from typing import TYPE_CHECKING, Any

from cyclonedds.core import DDSStatus
from cyclonedds.pub import DataWriter

from nros_backends.cyclone.ends import End, count_to, handles_of
from nros_backends.cyclone.envelope import CAPACITY, encode
from nros_conformance.rmw.backend import Publisher
from nros_conformance.rmw.clock import MS, NEVER
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import CountTracker
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import Liveliness, QosProfile, Reliability, is_finite

if TYPE_CHECKING:
    from nros_backends.cyclone.session import CycloneSession


class CyclonePublisher(End, Publisher):
    """A DataWriter."""

    missed_kind = EventKind.OFFERED_DEADLINE_MISSED
    status_mask = DDSStatus.LivelinessLost | DDSStatus.OfferedDeadlineMissed

    def __init__(
        self, session: CycloneSession, topic: str, type_name: str, qos: QosProfile, writer: DataWriter[Any]
    ) -> None:
        self._lost = CountTracker()
        super().__init__(session, topic, type_name, qos, writer, {EventKind.LIVELINESS_LOST: self._lost})
        self._writer: DataWriter[Any] | None = writer
        self._lifespan_ns = qos.lifespan_ms * MS if is_finite(qos.lifespan_ms) else None
        self._number = 0
        self._sent: collections.deque[int] = collections.deque()
        """When samples went, for `look`; only the last of them as long as no clock of the shim runs."""
        self._writing = threading.Lock()

    def publish_raw(self, data: object) -> int:
        """OK; MESSAGE_TOO_LARGE above `CAPACITY`; TIMEOUT when a reliable history stays full; INVALID_ARGUMENT."""
        if not isinstance(data, bytes | bytearray | memoryview):
            return ReturnCode.INVALID_ARGUMENT
        payload = bytes(data)
        if len(payload) > CAPACITY:
            return ReturnCode.MESSAGE_TOO_LARGE
        clock = self.session.clock
        with self._writing:
            writer = self._writer
            if writer is None:
                return ReturnCode.INVALID_ARGUMENT
            now = clock.now_ns()
            expires = NEVER if self._lifespan_ns is None else now + self._lifespan_ns
            code = self.session.native.write(writer, encode(self.guid.bytes, self._number + 1, now, expires, payload))
            if code != ReturnCode.OK:
                return code  # the number is not used up: it would look like a loss
            self._number += 1
            if self.deadline is None:
                self._sent.clear()
            self._sent.append(clock.now_ns())
        if self.deadline is not None:
            self.session.note()
        return ReturnCode.OK

    def assert_liveliness(self) -> int:
        with self._writing:
            writer = self._writer
            if writer is None:
                return ReturnCode.INVALID_ARGUMENT
            if self.qos.liveliness is Liveliness.MANUAL_BY_TOPIC:
                return self.session.native.assert_liveliness(writer)
            if self.qos.liveliness is Liveliness.MANUAL_BY_NODE:
                return self.session.assert_node()
        return ReturnCode.OK

    def look(self, before_ns: int, now_ns: int) -> bool:
        writer = self._writer
        if writer is None:
            return False
        bits = self.session.native.status_changes(writer)
        if bits & DDSStatus.LivelinessLost:
            status = writer.get_liveliness_lost_status()  # type: ignore[no-untyped-call]
            count_to(self._lost, status.total_count, now_ns)
        if bits & DDSStatus.OfferedDeadlineMissed:
            status = writer.get_offered_deadline_missed_status()  # type: ignore[no-untyped-call]
            count_to(self.missed, status.total_count, now_ns)
        self._note_sent()
        self.poll(now_ns)
        return False

    def send_heartbeat(self) -> bool:
        """Harness: have matched readers see one, if they need it; False where it would be an assertion."""
        if self.qos.reliability is Reliability.BEST_EFFORT:
            return True
        with self._writing:
            writer = self._writer
            if writer is None or self.qos.liveliness.is_manual:
                return False
            return self.session.native.assert_liveliness(writer) == ReturnCode.OK

    def met(self) -> list[uuid.UUID]:
        writer = self._writer
        if writer is None:
            return []
        handles = handles_of(writer.get_matched_subscriptions)
        found = (writer.get_matched_subscription_data(handle) for handle in handles)
        return [end.key for end in found if end is not None]

    def matched(self) -> int:
        writer = self._writer
        return 0 if writer is None else len(handles_of(writer.get_matched_subscriptions))

    def _time(self, period_ns: int) -> None:
        self._note_sent()
        super()._time(period_ns)

    def _note_sent(self) -> None:
        while self._sent:
            self.moved(self._sent.popleft())

    def release(self) -> None:
        with self._writing:
            self._writer = None
        super().release()
