"""What of a QoS profile the bus can honour; the rest is refused, never weakened (QOS-001, QOS-002)."""

from __future__ import annotations

import dataclasses

from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.qos import Durability, History, QosProfile, is_finite

QUEUE = 128
"""Slots of a topic: the largest power of two that ``o_queue``, u8, can state."""


def in_force(qos: QosProfile) -> QosProfile:
    """The profile as it will be honoured; a depth of 0 becomes PX4's default queue length, 1.

    Raises `RmwError` INVALID_ARGUMENT for values that the ABI cannot represent, INCOMPATIBLE_QOS for
    a policy that the bus does not have.
    """
    qos.check()
    refused = _refused(qos)
    if refused:
        raise RmwError(ReturnCode.INCOMPATIBLE_QOS, refused)
    return dataclasses.replace(qos, depth=max(qos.depth, 1))


def _refused(qos: QosProfile) -> str:
    """Why this profile cannot be honoured; empty if it can."""
    if qos.durability is not Durability.VOLATILE:
        return "durability TRANSIENT_LOCAL: a late subscription finds one sample, whatever the depth"
    if qos.history is not History.KEEP_LAST:
        return "history KEEP_ALL: the queue of a topic has a fixed length"
    if qos.depth > QUEUE:
        return f"depth {qos.depth}: the queue of a topic holds {QUEUE} samples"
    if is_finite(qos.deadline_ms):
        return f"deadline {qos.deadline_ms} ms: the bus has no rate"
    if is_finite(qos.lifespan_ms):
        return f"lifespan {qos.lifespan_ms} ms: samples do not expire"
    if qos.liveliness.is_manual:
        return f"liveliness {qos.liveliness.name}: the bus has no liveliness"
    if is_finite(qos.lease_ms):
        return f"lease {qos.lease_ms} ms: the bus has no liveliness"
    return ""
