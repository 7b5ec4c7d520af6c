"""What publishers and subscriptions have in common: identity, events, deadlines on the shim's clock.

All bookkeeping of events is done in `look`, which the session calls inside `drive_io`, under its ``dispatching``
lock, on the driving thread. Other threads only leave notes that it works off.
"""

from __future__ import annotations

import abc
from typing import TYPE_CHECKING

from nros_backends.zenoh.keys import Token
from nros_conformance.rmw.backend import Entity
from nros_conformance.rmw.clock import MS, NEVER
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import CountTracker, DeadlineClock, LivelinessTally, Source
from nros_conformance.rmw.dispatch import EventRegistry
from nros_conformance.rmw.events import EventCallback, EventKind
from nros_conformance.rmw.qos import INFINITE_MS

if TYPE_CHECKING:
    from nros_backends.zenoh.session import ZenohSession


class End(Entity, abc.ABC):
    """One entity: ``token`` is how the others see it, ``number`` its own number within the session."""

    missed_kind: EventKind

    def __init__(
        self, session: ZenohSession, topic: str, type_name: str, token: Token, sources: dict[EventKind, Source]
    ) -> None:
        self.session = session
        self.topic = topic
        self.type_name = type_name
        self.token = token
        self.qos = token.qos
        self.number = 0
        self.missed = CountTracker()
        """Missed deadlines."""
        self._sources: dict[EventKind, Source] = {**sources, self.missed_kind: self.missed}
        self.registry = EventRegistry(session.queue, self._sources, qos_deadline_ms=self.qos.deadline_ms)
        self.deadline: DeadlineClock | None = None
        self.last_ns: int | None = None
        """When the last sample came, respectively went."""
        if self.qos.has_deadline:
            self._time(self.qos.deadline_ms * MS)

    @property
    def closed(self) -> bool:
        """Whether it has been destroyed."""
        return self.registry.closed

    def supports_event(self, kind: int) -> bool:
        return self.registry.supports(kind)

    def register_event(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        if not isinstance(deadline_ms, int) or not 0 <= deadline_ms <= INFINITE_MS:
            return ReturnCode.INVALID_ARGUMENT
        with self.session.dispatching:
            code = self.registry.register(kind, deadline_ms, callback, context)
            if code == ReturnCode.OK and EventKind(kind).is_deadline and not self.qos.has_deadline:
                self._time(deadline_ms * MS)
        self.session.note()
        return code

    def destroy(self) -> int:
        """OK; INVALID_ARGUMENT, and no harm, the second time."""
        with self.session.dispatching:
            if self.closed:
                return ReturnCode.INVALID_ARGUMENT
            self.registry.close()
            self.session.forget(self)
        self.release()
        return ReturnCode.OK

    def preset(self, kind: int, count: int) -> int:
        """The fault ``preset`` for the total of an event; INVALID_ARGUMENT for one that it does not have."""
        with self.session.dispatching:
            source = self._sources.get(EventKind(kind))
            if self.closed or not isinstance(source, CountTracker | LivelinessTally):
                return ReturnCode.INVALID_ARGUMENT
            source.preset(count)
        return ReturnCode.OK

    @abc.abstractmethod
    def release(self) -> None:
        """Give back what it has declared in zenoh."""

    @abc.abstractmethod
    def look(self, now_ns: int) -> None:
        """Find what has happened by ``now_ns``, and queue callbacks."""

    @abc.abstractmethod
    def meets(self, other: Token) -> bool:
        """Whether that is a counterpart whose QoS goes with its own."""

    def next_due_ns(self) -> int:
        """When it has to be looked at again."""
        return NEVER if self.deadline is None else self.deadline.next_due_ns

    def _shares_topic(self, other: Token) -> bool:
        return other.topic == self.token.topic and other.type_name == self.token.type_name

    def _time(self, period_ns: int) -> None:
        """Start the deadline clock, or change its period. Periods before that do not count."""
        now = self.session.clock.now_ns()
        if self.deadline is not None:
            self.deadline.update(now)
        self.deadline = DeadlineClock(period_ns)
        self.deadline.misses = self.missed
        if self.last_ns is not None:
            self.deadline.restart(self.last_ns + (now - self.last_ns) // period_ns * period_ns)
