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
from nros_conformance.rmw.clock import MS, NEVER
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import GapTracker, LivelinessTally, Source
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import History, QosProfile

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
        self._depth = None if qos.history is History.KEEP_ALL else qos.depth
        self._waiting: collections.deque[Received] = collections.deque()
        self._expires_ns = NEVER
        """No waiting sample expires before."""
        self._arrivals: collections.deque[tuple[int, Received]] = collections.deque()
        """What was taken from DDS, and when; `look` works it off."""
        self._sent_ns: int | None = None
        """When the sample accepted last was sent."""
        self._more = False
        self._dropped = 0
        """Taken by the application into too small a buffer, not yet counted."""
        self._message: tuple[MessageCallback, object] | None = None
        self._lock = threading.Lock()
        """Guards the reader, the arrivals and the queue; never held during a callback."""

    def has_data(self) -> bool | int:
        if self.closed:
            return ReturnCode.INVALID_ARGUMENT
        with self._lock:
            self._expire(self.session.clock.now_ns())
            return bool(self._waiting)

    def try_recv_raw(self, max_size: int) -> bytes | int:
        """The oldest sample. One larger than ``max_size`` is dropped and counted as lost (ROB-002)."""
        if self.closed or not isinstance(max_size, int) or max_size < 0:
            return ReturnCode.INVALID_ARGUMENT
        with self._lock:
            self._expire(self.session.clock.now_ns())
            if not self._waiting:
                return ReturnCode.NO_DATA
            payload = self._pop().payload
            assert payload is not None
            if len(payload) <= max_size:
                return payload
            self._dropped += 1
        self.session.note()
        return ReturnCode.BUFFER_TOO_SMALL

    def set_message_callback(self, callback: MessageCallback | None, context: object) -> int:
        if self.closed:
            return ReturnCode.INVALID_ARGUMENT
        with self.session.dispatching:
            self._message = None if callback is None else (callback, context)
            self._announce(self.session.clock.now_ns())
        return ReturnCode.OK

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
        if self.deadline is not None:
            self.deadline.update(now_ns)
        self.registry.poll()
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
            self._message = None
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
            self.last_ns = arrived_ns
            self._sent_ns = sample.sent_ns
            if self.deadline is not None:
                self.deadline.restart(arrived_ns)
            # Ready since it was sent, as far as the order of callbacks goes, but not before the last look.
            ready_ns = max(before_ns, min(sample.sent_ns, now_ns))
            self._gaps.sample(sample.publisher, sample.number, ready_ns)
            with self._lock:
                sample.waiting = True
                self._waiting.append(sample)
                self._expires_ns = min(self._expires_ns, sample.expires_ns)
                self._expire(now_ns)
                while self._depth is not None and len(self._waiting) > self._depth:
                    # History of before this subscription may not fit, but is not lost either (MSL-004).
                    self._gaps.losses.add(int(self._pop().sent_ns >= self.created_ns), ready_ns)
            self._announce(ready_ns)
        self._gaps.losses.add(self._dropped, now_ns)
        self._dropped = 0
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

    def _announce(self, ready_ns: int) -> None:
        """Queue a message callback for each waiting sample that has none yet."""
        if self._message is None:
            return
        for sample in tuple(self._waiting):
            if not sample.announced:
                sample.announced = True
                self.session.queue.push(ready_ns, lambda sample=sample: self._call_message(sample))  # type: ignore[misc]

    def _call_message(self, sample: Received) -> bool:
        """One callback per sample that can still be taken."""
        if self._message is None or not sample.waiting or sample.expires_ns <= self.session.clock.now_ns():
            return False
        callback, context = self._message
        callback(context)
        return True

    def _expire(self, now_ns: int) -> None:
        """Drop what has outlived its lifespan, which is not loss (MSL-006)."""
        if now_ns < self._expires_ns:
            return
        for sample in self._waiting:
            sample.waiting = sample.expires_ns > now_ns
        self._waiting = collections.deque(sample for sample in self._waiting if sample.waiting)
        self._expires_ns = min((sample.expires_ns for sample in self._waiting), default=NEVER)

    def _pop(self) -> Received:
        sample = self._waiting.popleft()
        sample.waiting = False
        return sample
