"""What creating an entity checks first on every middleware that takes ROS 2's names and the whole QoS profile."""

from __future__ import annotations

import dataclasses
import re

from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.qos import Durability, History, Liveliness, QosProfile, Reliability, is_finite

NAME_MAX = 200
"""Characters of a name; what all DDS implementations and ROS 2 take."""

_TOPIC = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z_][A-Za-z0-9_]*)*", re.ASCII)
_TYPE = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(?:(?:/|::)[A-Za-z_][A-Za-z0-9_]*)*", re.ASCII)


def admit_names(topic: object, type_name: object, qos: QosProfile) -> QosProfile:
    """The profile with true members of the enumerations; a depth of 0 becomes 1, DDS' default.

    Raises `RmwError` TOPIC_NAME_INVALID, or INVALID_ARGUMENT for a value that the ABI does not have.
    """
    for what, name, pattern in (("topic", topic, _TOPIC), ("type", type_name, _TYPE)):
        if not isinstance(name, str) or len(name) > NAME_MAX or not pattern.fullmatch(name):
            raise RmwError(ReturnCode.TOPIC_NAME_INVALID, f"{name!r} is not a {what} name")
    qos.check()
    try:
        return dataclasses.replace(
            qos,
            reliability=Reliability(qos.reliability),
            durability=Durability(qos.durability),
            history=History(qos.history),
            liveliness=Liveliness(qos.liveliness),
            depth=max(qos.depth, 1),
        )
    except ValueError as error:
        raise RmwError(ReturnCode.INVALID_ARGUMENT, str(error)) from error


def refuse_short_lease(qos: QosProfile, min_lease_ms: int) -> None:
    """Raise `RmwError` INCOMPATIBLE_QOS for a finite lease that a healthy publisher could not keep."""
    if qos.liveliness is not Liveliness.NONE and is_finite(qos.lease_ms) and qos.lease_ms < min_lease_ms:
        raise RmwError(ReturnCode.INCOMPATIBLE_QOS, f"lease {qos.lease_ms} ms is below {min_lease_ms} ms")
