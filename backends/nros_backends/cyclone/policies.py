"""Names and QoS: what is accepted, and how DDS is told.

- Every policy of the contract exists in DDS and is enforced there, except these two, which the shim
  enforces because only then its books balance:

  - *depth of a subscription*: the DDS reader keeps everything and the receive queue holds the depth, so
    that every sample pushed out of it is seen and counted (DDS reports none of them);
  - *lifespan*: expired samples that DDS removed by itself would look like a gap in the numbers, that
    is like loss (MSL-006).
- depth 0 becomes 1, DDS' default; `Entity.qos` says so.
- NONE is AUTOMATIC with an infinite lease: alive for as long as it is known.
- MANUAL_BY_NODE is DDS' MANUAL_BY_PARTICIPANT: a session is one node and one participant.
- A finite lease below `MIN_LEASE_MS` is refused: Cyclone announces AUTOMATIC liveliness once in 80 %
  of the lease, and the rest is all the time that a busy host has. At 20 ms one healthy publisher in ten
  was called lost within 5 s on an idle host (and then for good, see `backend`).
"""

from __future__ import annotations

from cyclonedds.qos import Policy, Qos
from cyclonedds.util import duration

from nros_conformance.rmw.admission import admit_names, refuse_short_lease
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.qos import Durability, History, Liveliness, QosProfile, Reliability, is_finite

MIN_LEASE_MS = 100

_BLOCKING_NS = 100 * MS
"""A reliable write waits at most that long for room in a full history, then answers TIMEOUT."""


def admit(topic: object, type_name: object, qos: QosProfile) -> QosProfile:
    """The QoS in force for an entity with these names.

    Raises `RmwError` TOPIC_NAME_INVALID, INVALID_ARGUMENT, INCOMPATIBLE_QOS.
    """
    qos = admit_names(topic, type_name, qos)
    refuse_short_lease(qos, MIN_LEASE_MS)
    return qos


def dds_topic(topic: str, qos: QosProfile) -> str:
    """The name in DDS: ROS 2's ``rt/`` in front, unless the QoS avoids that convention."""
    return topic if qos.avoid_ros_namespace_conventions else f"rt/{topic.removeprefix('/')}"


def writer_qos(qos: QosProfile) -> Qos:
    """A publisher's QoS in DDS. Late joiners get the same history (durability service) as others."""
    history = Policy.History.KeepAll if qos.history is History.KEEP_ALL else Policy.History.KeepLast(qos.depth)
    return Qos(
        *_common(qos),
        history,
        Policy.DurabilityService(0, history, -1, -1, -1),
    )


def reader_qos(qos: QosProfile) -> Qos:
    """A subscription's QoS in DDS; the receive queue holds the depth."""
    return Qos(*_common(qos), Policy.History.KeepAll, Policy.TypeConsistency.DisallowTypeCoercion())


def _common(qos: QosProfile) -> list[object]:
    return [
        Policy.Reliability.Reliable(_BLOCKING_NS)
        if qos.reliability is Reliability.RELIABLE
        else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal
        if qos.durability is Durability.TRANSIENT_LOCAL
        else Policy.Durability.Volatile,
        Policy.Deadline(_nanoseconds(qos.deadline_ms)),
        _liveliness(qos),
    ]


def _liveliness(qos: QosProfile) -> object:
    lease_ns = _nanoseconds(qos.lease_ms)
    match qos.liveliness:
        case Liveliness.MANUAL_BY_TOPIC:
            return Policy.Liveliness.ManualByTopic(lease_ns)
        case Liveliness.MANUAL_BY_NODE:
            return Policy.Liveliness.ManualByParticipant(lease_ns)
        case Liveliness.AUTOMATIC:
            return Policy.Liveliness.Automatic(lease_ns)
    return Policy.Liveliness.Automatic(duration(infinite=True))


def _nanoseconds(duration_ms: int) -> int:
    """A DDS duration: 0 and INFINITE_MS mean no check (C15), where DDS' own 0 is a period of zero."""
    return duration_ms * MS if is_finite(duration_ms) else duration(infinite=True)
