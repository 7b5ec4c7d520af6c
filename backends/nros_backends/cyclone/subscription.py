"""The receiving end: samples go from DDS into a queue of the QoS' depth, and are counted on the way."""

from __future__ import annotations

import collections
import threading
import uuid
from typing import TYPE_CHECKING, Any

from cyclonedds.core import DDSStatus
from cyclonedds.sub import DataReader

from nros_backends.cyclone.ends import End, count_to, handles_of
from nros_backends.cyclone.envelope import Received
from nros_conformance.rmw.backend import MessageCallback, Subscription
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import GapTracker, LivelinessTally, Source
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import QosProfile
from nros_conformance.rmw.receive_queue import ReceiveQueue

if TYPE_CHECKING:
    from nros_backends.cyclone.session import CycloneSession

_BATCH = 256
"""Samples per call to DDS; a millisecond's work."""

_NUMBERS = 2**64


class CycloneSubscription(End, Subscription):
    """A DataReader and a receive queue."""

    missed_kind = EventKind.REQUESTED_DEADLINE_MISSED
    status_mask = DDSStatus.DataAvailable | DDSStatus.LivelinessChanged | DDSStatus.RequestedDeadlineMissed

    def __init__(
        self, session: CycloneSession, topic: str, type_name: str, qos: QosProfile, reader: DataReader[Any]
    ) -> None:
        self._alive = LivelinessTally()
        self._gaps = GapTracker(_NUMBERS)
        sources: dict[EventKind, Source] = {
            EventKind.LIVELINESS_CHANGED: self._alive,
            EventKind.MESSAGE_LOST: self._gaps.losses,
        }
        super().__init__(session, topic, type_name, qos, reader, sources)
        self.reader: DataReader[Any] | None = reader
        self.created_ns = session.clock.now_ns()
        self._waiting = ReceiveQueue(qos, self.registry, session.clock)
        self._arrivals: collections.deque[tuple[int, Received]] = collections.deque()
        """What was taken from DDS, and when; `look` works it off."""
        self._sent_ns: int | None = None
        """When the sample accepted last was sent."""
        self._more = False
        self._lock = threading.Lock()
        """Guards the reader and the arrivals; never held during a callback."""

    def has_data(self) -> bool | int:
        return self._waiting.has_data()

    def try_recv_raw(self, max_size: int) -> bytes | int:
        """The oldest sample. One larger than ``max_size`` is dropped and counted as lost (ROB-002)."""
        taken = self._waiting.try_recv_raw(max_size)
        if taken == ReturnCode.BUFFER_TOO_SMALL:
            self.session.note()
        return taken

    def set_message_callback(self, callback: MessageCallback | None, context: object) -> int:
        with self.session.dispatching:
            return self._waiting.set_message_callback(callback, context)

    def fetch(self) -> bool:
        """Take what DDS has received; whether there was anything. Any thread.

        The time of reception is when the taking call has returned: never before the sample came.
        """
        with self._lock:
            if self.reader is None:
                return False
            taken = self.reader.take(_BATCH)
            now = self.session.clock.now_ns()
            self._more = len(taken) == _BATCH
            if self._more:
                self.session.note()  # DDS says so only once
            valid = [(now, sample) for sample in taken if isinstance(sample, Received) and sample.payload is not None]
            self._arrivals.extend(valid)
            return bool(valid)

    def look(self, before_ns: int, now_ns: int) -> bool:
        reader = self.reader
        if reader is None:
            return False
        bits = self.session.native.status_changes(reader)
        if bits & DDSStatus.LivelinessChanged:
            status = reader.get_liveliness_changed_status()  # type: ignore[no-untyped-call]
            # A publisher comes before its messages do, and goes after them.
            came = status.alive_count > self._alive.alive
            self._alive.set(status.alive_count, status.not_alive_count, before_ns if came else now_ns)
        if bits & DDSStatus.DataAvailable or self._more:
            self.fetch()
        if bits & DDSStatus.RequestedDeadlineMissed:
            total = reader.get_requested_deadline_missed_status().total_count  # type: ignore[no-untyped-call]
            count_to(self.missed, total, max(before_ns, min(self._first_due_ns(now_ns), now_ns)))
        fresh = self._accept(before_ns, now_ns)
        self.poll(now_ns)
        return fresh or self._more

    def met(self) -> list[uuid.UUID]:
        reader = self.reader
        if reader is None:
            return []
        handles = handles_of(reader.get_matched_publications)
        found = (reader.get_matched_publication_data(handle) for handle in handles)
        return [end.key for end in found if end is not None]

    def matched(self) -> int:
        reader = self.reader
        return 0 if reader is None else len(handles_of(reader.get_matched_publications))

    def release(self) -> None:
        with self._lock:
            self.reader = None
            self._arrivals.clear()
        self._waiting.clear()
        super().release()

    def _time(self, period_ns: int) -> None:
        super()._time(period_ns)
        self.session.receive_at_once(self)

    def _accept(self, before_ns: int, now_ns: int) -> bool:
        """Work off the arrivals: deadline clock, numbers, queue, message callbacks."""
        fresh = False
        while self._arrivals:
            fresh = True
            arrived_ns, sample = self._arrivals.popleft()
            self.moved(arrived_ns)
            self._sent_ns = sample.sent_ns
            # Ready since it was sent, as far as the order of callbacks goes, but not before the last look.
            ready_ns = max(before_ns, min(sample.sent_ns, now_ns))
            self._gaps.sample(sample.publisher, sample.number, ready_ns)
            assert sample.payload is not None
            lost = self._waiting.put(
                sample.payload, ready_ns, expires_ns=sample.expires_ns, history=sample.sent_ns < self.created_ns,
                now_ns=now_ns,
            )  # fmt: skip
            self._gaps.losses.add(lost, ready_ns)
        self._gaps.losses.add(self._waiting.dropped(), now_ns)
        return fresh

    def _first_due_ns(self, now_ns: int) -> int:
        """When the first of the misses that DDS has counted was due: for the order of callbacks only."""
        period_ns = self.qos.deadline_ms * MS
        latest_ns = self._sent_ns
        for _, sample in tuple(self._arrivals):
            if latest_ns is not None and sample.sent_ns - latest_ns > period_ns:
                break
            latest_ns = sample.sent_ns
        return now_ns if latest_ns is None else latest_ns + period_ns
