"""The receiving end: a queue of the QoS' depth, and the books of who is alive and what was lost."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nros_backends.can.ends import End
from nros_backends.can.peers import Remote
from nros_backends.can.policies import finite
from nros_conformance.rmw.backend import MessageCallback, Subscription
from nros_conformance.rmw.clock import MS, NEVER
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import CountTracker, LivelinessCounter, Source
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import QosProfile
from nros_conformance.rmw.receive_queue import ReceiveQueue

if TYPE_CHECKING:
    from nros_backends.can.session import CanSession


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
        self._lifespan_ms = finite(qos.lifespan_ms)
        self._waiting = ReceiveQueue(qos, self.registry, session.clock)

    def has_data(self) -> bool | int:
        with self.session.lock:
            return self._waiting.has_data()

    def try_recv_raw(self, max_size: int) -> bytes | int:
        """The oldest sample. One larger than ``max_size`` is dropped and counted as lost (ROB-002)."""
        with self.session.lock:
            taken = self._waiting.try_recv_raw(max_size)
            self.losses.add(self._waiting.dropped(), self.session.clock.now_ns())
            return taken

    def set_message_callback(self, callback: MessageCallback | None, context: object) -> int:
        with self.session.lock:
            return self._waiting.set_message_callback(callback, context)

    def deliver(self, payload: bytes, at_ns: int, lifespan_ms: int) -> None:
        """A sample came at ``at_ns``; its publisher gives it ``lifespan_ms``, 0 for ever."""
        self.moved(at_ns)
        spans = [span for span in (lifespan_ms, self._lifespan_ms) if span]
        expires_ns = at_ns + min(spans) * MS if spans else NEVER
        self.losses.add(self._waiting.put(payload, at_ns, expires_ns=expires_ns), at_ns)

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
        self._waiting.clear()
