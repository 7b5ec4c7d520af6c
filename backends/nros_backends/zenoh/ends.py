"""What publishers and subscriptions have in common: identity, events, deadlines on the shim's clock.

All bookkeeping of events is done in `look`, which the session calls inside `drive_io`, under its ``dispatching``
lock, on the driving thread. Other threads only leave notes that it works off.
"""

from __future__ import annotations

import abc
from typing import TYPE_CHECKING

from nros_backends.zenoh.keys import Token
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import CountTracker, LivelinessTally, Source
from nros_conformance.rmw.ends import ClockedEnd
from nros_conformance.rmw.events import EventCallback, EventKind

if TYPE_CHECKING:
    from nros_backends.zenoh.session import ZenohSession


class End(ClockedEnd):
    """One entity: ``token`` is how the others see it, ``number`` its own number within the session."""

    def __init__(
        self, session: ZenohSession, topic: str, type_name: str, token: Token, sources: dict[EventKind, Source]
    ) -> None:
        self.session = session
        super().__init__(session.clock, session.queue, topic, type_name, token.qos, sources)
        self.token = token
        self.number = 0
        if self.qos.has_deadline:
            self._time(self.qos.deadline_ms * MS)

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

    def preset(self, kind: int, count: int) -> int:
        """The fault ``preset`` for the total of an event; INVALID_ARGUMENT for one that it does not have."""
        with self.session.dispatching:
            source = self.sources.get(EventKind(kind))
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

    def _shares_topic(self, other: Token) -> bool:
        return other.topic == self.token.topic and other.type_name == self.token.type_name
