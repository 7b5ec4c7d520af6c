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

from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import CountTracker, Source
from nros_conformance.rmw.ends import ClockedEnd
from nros_conformance.rmw.events import EventCallback, EventKind
from nros_conformance.rmw.qos import QosProfile

if TYPE_CHECKING:
    from nros_backends.cyclone.session import CycloneSession

_U32 = 2**32


class End(ClockedEnd):
    """One DDS endpoint. ``missed`` counts the deadlines that were missed, natively or by the shim's clock.

    That clock is for a deadline that only the registration states.
    """

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
        super().__init__(session.clock, session.queue, topic, type_name, qos, sources)
        self.endpoint: DataWriter[Any] | DataReader[Any] | None = endpoint
        self.guid: uuid.UUID = endpoint.get_guid()

    def register_event(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        with self.session.dispatching:
            code = super().register_event(kind, deadline_ms, callback, context)
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
    def met(self) -> list[uuid.UUID]:
        """The GUIDs of the endpoints that DDS has matched it with, as far as it still knows them."""

    @abc.abstractmethod
    def matched(self) -> int:
        """How many endpoints DDS has matched it with."""


def count_to(tracker: CountTracker, total: int, at_ns: int) -> None:
    """Bring a tracker to a total that DDS reports (u32, wrapping)."""
    tracker.add((total - tracker.total) % _U32, at_ns)


def handles_of(matched: Callable[[], list[int]]) -> list[int]:
    """The handles that the binding's call lists; none when one was added between its count and its list."""
    try:
        return matched()
    except IndexError:
        return []
