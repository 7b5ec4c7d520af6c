"""What both ends of a topic share in an adapter whose shim has a clock for deadlines."""

from __future__ import annotations

import abc
from collections.abc import Mapping

from nros_conformance.rmw.backend import Entity
from nros_conformance.rmw.clock import MS, NEVER, Clock
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import CountTracker, DeadlineClock, Source
from nros_conformance.rmw.dispatch import EventRegistry, ReadyQueue
from nros_conformance.rmw.events import EventCallback, EventKind
from nros_conformance.rmw.qos import INFINITE_MS, QosProfile


class ClockedEnd(Entity, abc.ABC):
    """Names, QoS, the registry of its events, and the clock of its deadline.

    ``missed`` counts missed deadlines; ``sources`` are those of its other events. The clock runs when the
    adapter starts it with `_time`, or when a registration states a deadline that the QoS does not.
    """

    missed_kind: EventKind | None
    """Which kind ``missed`` is; None for an end that has none."""

    def __init__(
        self, clock: Clock, queue: ReadyQueue, topic: str, type_name: str, qos: QosProfile,
        sources: Mapping[EventKind, Source],
    ) -> None:  # fmt: skip
        self.topic = topic
        self.type_name = type_name
        self.qos = qos
        self.missed = CountTracker()
        self.sources: dict[EventKind, Source] = dict(sources)
        if self.missed_kind is not None:
            self.sources[self.missed_kind] = self.missed
        self.registry = EventRegistry(queue, self.sources, qos_deadline_ms=qos.deadline_ms)
        self.deadline: DeadlineClock | None = None
        self.last_ns: int | None = None
        """When the last sample came, respectively went."""
        self._clock = clock

    @property
    def closed(self) -> bool:
        """Whether it has been destroyed."""
        return self.registry.closed

    def supports_event(self, kind: int) -> bool:
        return self.registry.supports(kind)

    def register_event(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        """As the contract says; an adapter with threads calls it under the lock that guards its events.

        The period of a later registration replaces that of an earlier one, as its callback does (REG-007); the
        total goes on (CNT-001).
        """
        if not isinstance(deadline_ms, int) or not 0 <= deadline_ms <= INFINITE_MS:
            return ReturnCode.INVALID_ARGUMENT
        code = self.registry.register(kind, deadline_ms, callback, context)
        if code == ReturnCode.OK and EventKind(kind).is_deadline and not self.qos.has_deadline:
            self._time(deadline_ms * MS)
        return code

    def next_due_ns(self) -> int:
        """When its deadline has to be looked at next."""
        return NEVER if self.deadline is None else self.deadline.next_due_ns

    def moved(self, at_ns: int) -> None:
        """A sample came, respectively went, at ``at_ns``: the period begins anew."""
        self.last_ns = at_ns
        if self.deadline is not None:
            self.deadline.restart(at_ns)

    def poll(self, now_ns: int) -> None:
        """Count the deadlines missed by ``now_ns``, and queue the callbacks of what has become ready."""
        if self.deadline is not None:
            self.deadline.update(now_ns)
        self.registry.poll()

    def _time(self, period_ns: int) -> None:
        """Start the clock, or change its period. Periods before that do not count."""
        now = self._clock.now_ns()
        if self.deadline is not None:
            self.deadline.update(now)
        self.deadline = DeadlineClock(period_ns)
        self.deadline.misses = self.missed
        if self.last_ns is not None:
            self.deadline.restart(self.last_ns + (now - self.last_ns) // period_ns * period_ns)
