"""The receiving end: a queue of the QoS' depth, and the books of who is alive and what was lost."""

from __future__ import annotations

import collections
from typing import TYPE_CHECKING

from nros_backends.can.ends import End
from nros_backends.can.peers import Remote
from nros_backends.can.policies import finite
from nros_conformance.rmw.backend import MessageCallback, Subscription
from nros_conformance.rmw.clock import MS, NEVER
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import CountTracker, LivelinessCounter, Source
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import History, QosProfile

if TYPE_CHECKING:
    from nros_backends.can.session import CanSession


class Sample:
    """One received sample."""

    __slots__ = ("announced", "at_ns", "expires_ns", "payload", "waiting")

    def __init__(self, payload: bytes, at_ns: int, expires_ns: int) -> None:
        self.payload = payload
        self.at_ns = at_ns
        self.expires_ns = expires_ns
        self.waiting = True
        """Whether it stands in the queue."""
        self.announced = False
        """Whether a message callback for it is queued, or has run."""


class CanSubscription(End, Subscription):
    """A subscription; it hears every publisher that it `meets`."""

    missed_kind = EventKind.REQUESTED_DEADLINE_MISSED
    is_reader = True

    def __init__(self, session: CanSession, number: int, names: tuple[str, str], qos: QosProfile) -> None:
        self.liveliness = LivelinessCounter()
        self.losses = CountTracker()
        sources: dict[EventKind, Source] = {
            EventKind.LIVELINESS_CHANGED: self.liveliness,
            EventKind.MESSAGE_LOST: self.losses,
        }
        super().__init__(session, number, names, qos, sources)
        self.created_ns = session.clock.now_ns()
        self._depth = None if qos.history is History.KEEP_ALL else qos.depth
        self._lifespan_ms = finite(qos.lifespan_ms)
        self._waiting: collections.deque[Sample] = collections.deque()
        self._expires_ns = NEVER
        """No waiting sample expires before."""
        self._message: tuple[MessageCallback, object] | None = None

    def has_data(self) -> bool | int:
        with self.session.lock:
            if self.closed:
                return ReturnCode.INVALID_ARGUMENT
            self._expire(self.session.clock.now_ns())
            return bool(self._waiting)

    def try_recv_raw(self, max_size: int) -> bytes | int:
        """The oldest sample. One larger than ``max_size`` is dropped and counted as lost (ROB-002)."""
        if not isinstance(max_size, int) or max_size < 0:
            return ReturnCode.INVALID_ARGUMENT
        with self.session.lock:
            if self.closed:
                return ReturnCode.INVALID_ARGUMENT
            now = self.session.clock.now_ns()
            self._expire(now)
            if not self._waiting:
                return ReturnCode.NO_DATA
            payload = self._pop().payload
            if len(payload) <= max_size:
                return payload
            self.losses.add(1, now)
            return ReturnCode.BUFFER_TOO_SMALL

    def set_message_callback(self, callback: MessageCallback | None, context: object) -> int:
        with self.session.lock:
            if self.closed:
                return ReturnCode.INVALID_ARGUMENT
            self._message = None if callback is None else (callback, context)
            for sample in self._waiting:
                self._announce(sample, self.session.clock.now_ns())
        return ReturnCode.OK

    def deliver(self, payload: bytes, at_ns: int, lifespan_ms: int) -> None:
        """A sample came at ``at_ns``; its publisher gives it ``lifespan_ms``, 0 for ever."""
        self.sample(at_ns)
        spans = [span for span in (lifespan_ms, self._lifespan_ms) if span]
        sample = Sample(payload, at_ns, at_ns + min(spans) * MS if spans else NEVER)
        self._waiting.append(sample)
        self._expires_ns = min(self._expires_ns, sample.expires_ns)
        self._expire(at_ns)
        while self._depth is not None and len(self._waiting) > self._depth:
            self._pop()
            self.losses.add(1, at_ns)
        self._announce(sample, at_ns)

    def came(self, remote: Remote, at_ns: int) -> None:
        """A publisher has become known."""
        self.liveliness.came(remote.key, at_ns)
        if not remote.alive:
            self.liveliness.fell_silent(remote.key, at_ns)

    def preset(self, kind: int | None, count: int) -> ReturnCode:
        """See `Backend.inject`; the number of its topic is the publisher's."""
        if kind == EventKind.LIVELINESS_CHANGED:
            self.liveliness.preset(count)
        elif kind == EventKind.MESSAGE_LOST:
            self.losses.preset(count)
        elif kind == self.missed_kind:
            self.missed.preset(count)
        else:
            return ReturnCode.UNSUPPORTED
        return ReturnCode.OK

    def release(self) -> None:
        self._message = None
        self._waiting.clear()

    def _announce(self, sample: Sample, at_ns: int) -> None:
        """Queue a message callback, once per sample."""
        if self._message is not None and not sample.announced and sample.waiting:
            sample.announced = True
            self.session.queue.push(at_ns, lambda: self._call_message(sample))

    def _call_message(self, sample: Sample) -> bool:
        """For a sample that can still be taken."""
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

    def _pop(self) -> Sample:
        sample = self._waiting.popleft()
        sample.waiting = False
        return sample
