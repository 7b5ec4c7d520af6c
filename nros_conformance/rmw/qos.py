"""QoS of the nano-ros boundary (``nros/rmw_entity.h``) and its standard profiles.

Durations are whole milliseconds (u32). 0 and ``INFINITE_MS`` both mean "no check" (QOS-003).
"""

from __future__ import annotations

import dataclasses
import enum
from datetime import timedelta

from nros_conformance.rmw.codes import ReturnCode, RmwError

INFINITE_MS = 2**32 - 1
DEPTH_MAX = 2**16 - 1


class Reliability(enum.IntEnum):
    """``reliability``, u8."""

    BEST_EFFORT = 0
    RELIABLE = 1


class Durability(enum.IntEnum):
    """``durability``, u8."""

    VOLATILE = 0
    TRANSIENT_LOCAL = 1


class History(enum.IntEnum):
    """``history``, u8."""

    KEEP_LAST = 0
    KEEP_ALL = 1


class Liveliness(enum.IntEnum):
    """``liveliness_kind``, u8."""

    NONE = 0
    AUTOMATIC = 1
    MANUAL_BY_TOPIC = 2
    MANUAL_BY_NODE = 3

    @property
    def is_manual(self) -> bool:
        """Whether the application itself has to assert."""
        return self >= Liveliness.MANUAL_BY_TOPIC

    @property
    def strength(self) -> int:
        """How much it offers, or asks for (DDS 1.4, 2.2.3.11): by topic more than by node, unlike its number.

        NONE is AUTOMATIC with an infinite lease.

        >>> Liveliness.MANUAL_BY_TOPIC.strength > Liveliness.MANUAL_BY_NODE.strength > Liveliness.AUTOMATIC.strength
        True
        """
        return _STRENGTH[self]


_STRENGTH = {Liveliness.NONE: 0, Liveliness.AUTOMATIC: 0, Liveliness.MANUAL_BY_NODE: 1, Liveliness.MANUAL_BY_TOPIC: 2}


def is_finite(duration_ms: int) -> bool:
    """Whether a QoS duration asks for a check at all: neither 0 nor ``INFINITE_MS``."""
    return duration_ms not in (0, INFINITE_MS)


@dataclasses.dataclass(frozen=True, slots=True)
class QosProfile:
    """One entity's QoS. The defaults are the standard profile ``DEFAULT``."""

    reliability: Reliability = Reliability.RELIABLE
    durability: Durability = Durability.VOLATILE
    history: History = History.KEEP_LAST
    depth: int = 10
    deadline_ms: int = 0
    lifespan_ms: int = 0
    liveliness: Liveliness = Liveliness.AUTOMATIC
    lease_ms: int = 0
    avoid_ros_namespace_conventions: bool = False

    @property
    def has_deadline(self) -> bool:
        """Whether it states a finite deadline."""
        return is_finite(self.deadline_ms)

    def check(self) -> None:
        """Raise `RmwError` INVALID_ARGUMENT for a value that the ABI cannot represent (QOS-003)."""
        if not 0 <= self.depth <= DEPTH_MAX:
            raise RmwError(ReturnCode.INVALID_ARGUMENT, f"depth {self.depth} does not fit u16")
        for name in ("deadline_ms", "lifespan_ms", "lease_ms"):
            value = getattr(self, name)
            if not 0 <= value <= INFINITE_MS:
                raise RmwError(ReturnCode.INVALID_ARGUMENT, f"{name} {value} does not fit u32")


def milliseconds(duration: timedelta | float) -> int:
    """A `timedelta`, or seconds, as ABI milliseconds; a fraction rounds up (QOS-003).

    >>> milliseconds(timedelta(microseconds=1500)), milliseconds(0.015)
    (2, 15)
    """
    exact = duration if isinstance(duration, timedelta) else timedelta(seconds=duration)
    return -(exact // timedelta(milliseconds=-1))


DEFAULT = QosProfile()
SENSOR_DATA = QosProfile(reliability=Reliability.BEST_EFFORT, depth=5)
SERVICES_DEFAULT = QosProfile()
PARAMETERS = QosProfile(depth=1000)
SYSTEM_DEFAULT = QosProfile(liveliness=Liveliness.NONE)

PROFILES = {
    "default": DEFAULT,
    "sensor_data": SENSOR_DATA,
    "services_default": SERVICES_DEFAULT,
    "parameters": PARAMETERS,
    "system_default": SYSTEM_DEFAULT,
}
