"""Names and QoS: what is accepted, and which pairs belong together.

- RELIABLE is what the bus gives: a frame is repeated by the controller until at least one node has
  acknowledged it. What a receiver has no room for is lost all the same, and MessageLost says so.
- TRANSIENT_LOCAL is refused: a message goes to all nodes, so history for one of them does not exist.
- The lifespan is enforced by the subscription, counted from reception; the shorter one of both ends.
- depth 0 becomes 1; `Entity.qos` says so.
- A finite lease below `MIN_LEASE_MS` is refused: AUTOMATIC liveliness is a heartbeat sent in a quarter of
  the lease, and the rest is all the time that a busy host has.
"""

from __future__ import annotations

from nros_backends.can.messages import Endpoint
from nros_conformance.rmw.admission import admit_names, refuse_short_lease
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.qos import Durability, QosProfile, is_finite

MIN_LEASE_MS = 100

CAPACITY = 4096
"""Bytes of the largest payload: 586 frames of classic CAN, 0.1 s on a bus of 1 Mbit/s."""


def admit(topic: object, type_name: object, qos: QosProfile) -> QosProfile:
    """The QoS in force for an entity with these names.

    Raises `RmwError` TOPIC_NAME_INVALID, INVALID_ARGUMENT, INCOMPATIBLE_QOS.
    """
    qos = admit_names(topic, type_name, qos)
    if qos.durability is Durability.TRANSIENT_LOCAL:
        raise RmwError(ReturnCode.INCOMPATIBLE_QOS, "transient-local: a bus has no history for one node")
    refuse_short_lease(qos, MIN_LEASE_MS)
    return qos


def finite(duration_ms: int) -> int:
    """A duration of the QoS with one spelling for no check: 0."""
    return duration_ms if is_finite(duration_ms) else 0


def compatible(writer: Endpoint, reader: Endpoint) -> bool:
    """Whether a publisher and a subscription of one topic and type belong together: offered, at least as asked."""
    return (
        writer.reliability >= reader.reliability
        and writer.durability >= reader.durability
        and writer.liveliness.strength >= reader.liveliness.strength
        and _within(writer.deadline_ms, reader.deadline_ms)
        and _within(writer.lease_ms, reader.lease_ms)
    )


def _within(offered_ms: int, asked_ms: int) -> bool:
    return not asked_ms or 0 < offered_ms <= asked_ms
