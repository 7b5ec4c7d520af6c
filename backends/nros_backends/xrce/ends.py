"""What publishers and subscriptions have in common: their objects at the agent, events, the deadline clock."""

from __future__ import annotations

import abc
from typing import TYPE_CHECKING

from nros_conformance.rmw.backend import Entity
from nros_conformance.rmw.clock import MS, NEVER
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import CountTracker, DeadlineClock
from nros_conformance.rmw.dispatch import EventRegistry
from nros_conformance.rmw.events import EventCallback, EventKind
from nros_conformance.rmw.qos import INFINITE_MS, QosProfile

if TYPE_CHECKING:
    from nros_backends.xrce.session import XrceSession
    from nros_backends.xrce.wire.ids import ObjectId


class End(Entity, abc.ABC):
    """One data writer or data reader. ``missed`` counts missed deadlines, by the client's clock."""

    missed_kind: EventKind

    def __init__(self, session: XrceSession, topic: str, type_name: str, qos: QosProfile, object_id: ObjectId) -> None:
        self.session = session
        self.topic = topic
        self.type_name = type_name
        self.qos = qos
        self.object_id = object_id
        self.missed = CountTracker()
        self.registry = EventRegistry(session.queue, {self.missed_kind: self.missed}, qos_deadline_ms=qos.deadline_ms)
        self.deadline: DeadlineClock | None = None
        self.last_ns: int | None = None
        """When the last sample came, respectively went."""
        if qos.has_deadline:
            self._time(qos.deadline_ms * MS)

    @property
    def closed(self) -> bool:
        """Whether it has been destroyed."""
        return self.registry.closed

    def supports_event(self, kind: int) -> bool:
        return self.registry.supports(kind)

    def register_event(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        if not isinstance(deadline_ms, int) or not 0 <= deadline_ms <= INFINITE_MS:
            return ReturnCode.INVALID_ARGUMENT
        code = self.registry.register(kind, deadline_ms, callback, context)
        if code == ReturnCode.OK and not self.qos.has_deadline:
            self._time(deadline_ms * MS)
        return code

    def destroy(self) -> int:
        """OK; TIMEOUT when the agent did not confirm; INVALID_ARGUMENT, and no harm, the second time."""
        if self.closed:
            return ReturnCode.INVALID_ARGUMENT
        self.registry.close()
        return self.session.remove(self)

    def moved(self, at_ns: int) -> None:
        """A sample came, respectively went."""
        self.last_ns = at_ns
        if self.deadline is not None:
            self.deadline.restart(at_ns)

    def look(self, known_ns: int) -> None:
        """Find what has happened up to ``known_ns``, and queue callbacks."""
        if self.deadline is not None:
            self.deadline.update(known_ns)
        self.registry.poll()

    def next_due_ns(self) -> int:
        """When `look` finds something by itself."""
        return NEVER if self.deadline is None else self.deadline.next_due_ns

    def _time(self, period_ns: int) -> None:
        """Start the clock, or change its period. Periods before that do not count."""
        now_ns = self.session.clock.now_ns()
        if self.deadline is not None:
            self.deadline.update(now_ns)
        self.deadline = DeadlineClock(period_ns)
        self.deadline.misses = self.missed
        if self.last_ns is not None:
            self.deadline.restart(self.last_ns + (now_ns - self.last_ns) // period_ns * period_ns)
