"""Names and QoS: what is accepted, and who enforces it.

- *reliability*: the stream that samples travel on, in either direction (`client`).
- *depth of a subscription*: the receive queue of the adapter, which drops the oldest sample. 0 becomes 1.
- *deadline*: the client's clock, at either end.
- *durability*, *depth of a publisher*, *which pairs match*: the agent, which is told in binary form.

What nobody could enforce is refused with INCOMPATIBLE_QOS: KEEP_ALL (the windows of the streams hold
16 messages, and the agent says nothing of what it drops beyond), lifespan (samples carry no time), a
finite lease and manual liveliness (nobody is told when one expires).
"""

from __future__ import annotations

from nros_conformance.rmw.admission import admit_names
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.qos import History, QosProfile, is_finite


def admit(topic: object, type_name: object, qos: QosProfile) -> QosProfile:
    """The QoS in force for an entity with these names.

    Raises `RmwError` TOPIC_NAME_INVALID, INVALID_ARGUMENT, INCOMPATIBLE_QOS.
    """
    qos = admit_names(topic, type_name, qos)
    refused = {
        "history KEEP_ALL": qos.history is History.KEEP_ALL,
        f"lifespan {qos.lifespan_ms} ms": is_finite(qos.lifespan_ms),
        f"lease {qos.lease_ms} ms": is_finite(qos.lease_ms),
        f"liveliness {qos.liveliness.name}": qos.liveliness.is_manual,
    }
    for what, asked in refused.items():
        if asked:
            raise RmwError(ReturnCode.INCOMPATIBLE_QOS, f"XRCE cannot carry {what}")
    return qos


def dds_topic(topic: str, qos: QosProfile) -> str:
    """The name in DDS: ROS 2's ``rt/`` in front, unless the QoS avoids that convention."""
    return topic if qos.avoid_ros_namespace_conventions else f"rt/{topic.removeprefix('/')}"


def given_topic(name: str) -> str:
    """The opposite, for a topic that was given with its slash in front."""
    return f"/{name.removeprefix('rt/')}" if name.startswith("rt/") else name


def dds_type(type_name: str) -> str:
    """``std_msgs/msg/String`` as ROS 2 spells it in DDS: ``std_msgs::msg::dds_::String_``."""
    *namespace, name = type_name.replace("/", "::").split("::")
    return "::".join([*namespace, "dds_", f"{name}_"]) if namespace else name


def compatible(offered: QosProfile, requested: QosProfile) -> bool:
    """Whether an agent matches such a publisher with such a subscription (DDS 1.4, 2.2.3)."""
    return (
        offered.reliability >= requested.reliability
        and offered.durability >= requested.durability
        and (not requested.has_deadline or (offered.has_deadline and offered.deadline_ms <= requested.deadline_ms))
    )
