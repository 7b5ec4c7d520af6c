"""The five status events and their payloads (``nros/rmw_event.h``)."""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import NamedTuple, TypeAlias


class Side(str, enum.Enum):
    """Which end of a topic an entity is."""

    PUBLISHER = "publisher"
    SUBSCRIPTION = "subscription"


class EventKind(enum.IntEnum):
    """Values as in the nano-ros headers. At the contract's border kinds are plain integers."""

    LIVELINESS_CHANGED = 0
    REQUESTED_DEADLINE_MISSED = 1
    MESSAGE_LOST = 2
    LIVELINESS_LOST = 3
    OFFERED_DEADLINE_MISSED = 4

    @property
    def label(self) -> str:
        """The name in suites, declarations and tables: ``RequestedDeadlineMissed``."""
        return self.name.title().replace("_", "")

    @property
    def words(self) -> str:
        """The name in prose: ``Requested deadline missed``."""
        return self.name.replace("_", " ").capitalize()

    @property
    def side(self) -> Side:
        """The side that may register this kind."""
        return Side.SUBSCRIPTION if self <= EventKind.MESSAGE_LOST else Side.PUBLISHER

    @property
    def is_deadline(self) -> bool:
        """Whether ``deadline_ms`` of the registration is consulted for this kind."""
        return self in (EventKind.REQUESTED_DEADLINE_MISSED, EventKind.OFFERED_DEADLINE_MISSED)


KIND_BY_LABEL = {kind.label: kind for kind in EventKind}


def kind_label(kind: int) -> str:
    """The label of a known kind, ``kind 255`` for any other integer."""
    try:
        return EventKind(kind).label
    except ValueError:
        return f"kind {kind}"


class LivelinessChangedStatus(NamedTuple):
    """Counts of publishers; changes are signed, against the previous callback (CNT-004)."""

    alive_count: int
    not_alive_count: int
    alive_count_change: int
    not_alive_count_change: int


class CountStatus(NamedTuple):
    """Occurrences over the entity's life, and since the previous callback (CNT-001, CNT-002)."""

    total_count: int
    total_count_change: int


EventStatus: TypeAlias = LivelinessChangedStatus | CountStatus
"""LivelinessChanged carries the first, the four other kinds the second."""

EventCallback: TypeAlias = Callable[[int, EventStatus, object], None]
"""``callback(kind, status, context)``, called inside ``drive_io`` on the driving thread."""


def late_callback(callback: EventCallback) -> EventCallback | None:
    """What takes the place of a callback that has been released, if it says: its attribute ``late``.

    For boundaries without unregister, where whoever was given a function can call it for ever. An adapter lets
    go of callback and context (LIF-003), and still tells of a call that comes too late (DSP-004). ``late`` must
    refer to neither of them; it gets an empty text as the context that it would have got.
    """
    late: EventCallback | None = getattr(callback, "late", None)
    return late
