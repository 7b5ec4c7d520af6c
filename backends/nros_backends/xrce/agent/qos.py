"""QoS of the agent's data writers and readers, and which pairs match (DDS 1.4, 2.2.3)."""

from __future__ import annotations

import enum
from fnmatch import fnmatchcase

import msgspec

HISTORY = 16
"""Samples kept where the client names no depth: as many as eProsima's agent keeps of a topic."""


class Durability(enum.IntEnum):
    """In the order of DDS: a writer may offer more than a reader requests."""

    VOLATILE = 0
    TRANSIENT_LOCAL = 1
    TRANSIENT = 2
    PERSISTENT = 3


class Liveliness(enum.IntEnum):
    """In the order of DDS. The agent matches by it; nothing of it is ever reported to a client."""

    AUTOMATIC = 0
    MANUAL_BY_PARTICIPANT = 1
    MANUAL_BY_TOPIC = 2


class EntityQos(msgspec.Struct, frozen=True):
    """QoS of a data writer or reader. Times in nanoseconds, None is infinite; ``depth`` None keeps all."""

    reliable: bool = True
    durability: Durability = Durability.VOLATILE
    depth: int | None = HISTORY
    deadline_ns: int | None = None
    lifespan_ns: int | None = None
    liveliness: Liveliness = Liveliness.AUTOMATIC
    lease_ns: int | None = None
    exclusive: bool = False


WRITER = EntityQos(reliable=True, durability=Durability.TRANSIENT_LOCAL)
"""A writer that says nothing: Fast DDS' defaults, which is what clients of eProsima's agent get."""
READER = EntityQos(reliable=False)
"""A reader that says nothing."""


def mismatch(offered: EntityQos, requested: EntityQos) -> str | None:
    """The first policy by which DDS would not match a writer and a reader; None: they match."""
    if requested.reliable and not offered.reliable:
        return "RELIABILITY"
    if offered.durability < requested.durability:
        return "DURABILITY"
    if _longer(offered.deadline_ns, requested.deadline_ns):
        return "DEADLINE"
    if offered.liveliness < requested.liveliness or _longer(offered.lease_ns, requested.lease_ns):
        return "LIVELINESS"
    if offered.exclusive != requested.exclusive:
        return "OWNERSHIP"
    return None


def _longer(offered: int | None, requested: int | None) -> bool:
    return requested is not None and (offered is None or offered > requested)


def share_partition(one: tuple[str, ...], other: tuple[str, ...]) -> bool:
    """Whether a publisher and a subscriber meet in a partition; none is the partition "" (2.2.3.13)."""
    return any(
        fnmatchcase(mine, theirs) or fnmatchcase(theirs, mine) for mine in one or ("",) for theirs in other or ("",)
    )
