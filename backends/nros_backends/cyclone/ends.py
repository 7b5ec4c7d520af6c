"""What publishers and subscriptions have in common: identity, events, a deadline given at registration.

All bookkeeping of events is done in `look`, which the session calls inside `drive_io`, under its
``dispatching`` lock, on the driving thread. Other threads only leave notes that `look` works off.
"""

from __future__ import annotations

import abc
import uuid
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader

from nros_conformance.rmw.backend import Entity
from nros_conformance.rmw.clock import MS, NEVER
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import CountTracker, DeadlineClock, Source
from nros_conformance.rmw.dispatch import EventRegistry
from nros_conformance.rmw.events import EventCallback, EventKind
from nros_conformance.rmw.qos import INFINITE_MS, QosProfile

if TYPE_CHECKING:
    from nros_backends.cyclone.session import CycloneSession

_U32 = 2**32


class End(Entity, abc.ABC):
    """One DDS endpoint. ``missed`` counts the deadlines that were missed, natively or by the shim's clock."""

    missed_kind: EventKind
    status_mask: int
    """The DDS statuses that `look` looks for, and that wake `drive_io`."""

    def __init__(
        self,
        session: CycloneSession,
        topic: str,
        type_name: str,
        qos: QosProfile,
        endpoint: DataWriter[Any] | DataReader[Any],
        sources: dict[EventKind, Source],
    ) -> None:
        self.session = session
        self.topic = topic
        self.type_name = type_name
        self.qos = qos
        self.endpoint: DataWriter[Any] | DataReader[Any] | None = endpoint
        self.guid: uuid.UUID = endpoint.get_guid()
        self.missed = CountTracker()
        self.registry = EventRegistry(
            session.queue, {**sources, self.missed_kind: self.missed}, qos_deadline_ms=qos.deadline_ms
        )
        self.deadline: DeadlineClock | None = None
        """The shim's clock, for a deadline that only the registration states."""
        self.last_ns: int | None = None
        """When the last sample came, respectively went."""

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

    def release(self) -> None:
        """Delete the DDS endpoint, which ends with its last reference."""
        self.endpoint = None

    @abc.abstractmethod
    def look(self, before_ns: int, now_ns: int) -> bool:
        """Find what has happened since ``before_ns``, and queue callbacks; whether new samples came."""

    @abc.abstractmethod
    def knows(self, guid: uuid.UUID) -> bool:
        """Whether DDS has matched it with the endpoint of this GUID."""

    @abc.abstractmethod
    def matched(self) -> int:
        """How many endpoints DDS has matched it with."""

    def next_due_ns(self) -> int:
        """When the shim's deadline clock has to be looked at next."""
        return NEVER if self.deadline is None else self.deadline.next_due_ns

    def _time(self, period_ns: int) -> None:
        """Start the shim's clock, or change its period. Periods before the registration do not count."""
        now = self.session.clock.now_ns()
        if self.deadline is not None:
            self.deadline.update(now)
        self.deadline = DeadlineClock(period_ns)
        self.deadline.misses = self.missed
        if self.last_ns is not None:
            self.deadline.restart(self.last_ns + (now - self.last_ns) // period_ns * period_ns)


def count_to(tracker: CountTracker, total: int, at_ns: int) -> None:
    """Bring a tracker to a total that DDS reports (u32, wrapping)."""
    tracker.add((total - tracker.total) % _U32, at_ns)


def handles_of(matched: Callable[[], list[int]]) -> list[int]:
    """The handles that the binding's call lists; none when one was added between its count and its list."""
    try:
        return matched()
    except IndexError:
        return []
