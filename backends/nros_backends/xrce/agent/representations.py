"""REF, XML and BIN to what they describe."""

from __future__ import annotations

from collections.abc import Mapping

from nros_backends.xrce.agent.descriptions import Description, Endpoint, Group, Participant, Refused, Topic, service
from nros_backends.xrce.agent.qos import HISTORY, READER, WRITER, Durability, EntityQos
from nros_backends.xrce.agent.xml import parse
from nros_backends.xrce.wire.binary import (
    Body,
    EndpointQos,
    GroupBody,
    ParticipantBody,
    Qos,
    ReaderBody,
    ServiceBody,
    TopicBody,
    WriterBody,
    decode_binary,
)
from nros_backends.xrce.wire.ids import Kind
from nros_backends.xrce.wire.messages import Binary, Create, Ref, Xml

MS = 1_000_000
_SERVICE_READER = EntityQos(reliable=True)
"""What eProsima's agent takes for services in binary form; whatever else the client asks for is not in it."""


def describe(create: Create, profiles: Mapping[tuple[Kind, str], Description]) -> Description:
    """What CREATE asks for. Raises `Refused`, and `Malformed` for a binary body that is not one."""
    match create.representation:
        case Ref(name):
            description = profiles.get((create.kind, name))
            if description is None:
                raise Refused(f"no {create.kind.name} profile {name!r}")
        case Xml(text):
            description = parse(create.kind, text)
        case Binary(body):
            description = _of_binary(create.kind, decode_binary(create.kind, body, create.little))
    if isinstance(description, Participant):
        return Participant(description.name, create.domain)
    return description


def _of_binary(kind: Kind, body: Body) -> Description:
    match body:
        case ParticipantBody():
            return Participant(body.qos_profile or "")
        case TopicBody():
            return Topic(body.name, body.type_name or body.type_reference or "")
        case GroupBody():
            return Group(body.partitions or ())
        case WriterBody():
            return Endpoint(body.topic, _qos(body.qos, WRITER))
        case ReaderBody():
            return Endpoint(body.topic, _qos(body.qos, READER))
        case ServiceBody():
            return service(
                body.name, body.request_type, body.reply_type, _SERVICE_READER, body.request_topic or "",
                body.reply_topic or "",
            )  # fmt: skip


def _qos(qos: EndpointQos | None, default: EntityQos) -> EntityQos:
    if qos is None:
        return default
    durability = Durability.VOLATILE
    for flag, value in (
        (Qos.TRANSIENT_LOCAL, Durability.TRANSIENT_LOCAL),
        (Qos.TRANSIENT, Durability.TRANSIENT),
        (Qos.PERSISTENT, Durability.PERSISTENT),
    ):
        if flag in qos.flags:
            durability = value
    return EntityQos(
        reliable=Qos.RELIABLE in qos.flags,
        durability=durability,
        depth=(qos.depth or HISTORY) if Qos.KEEP_LAST in qos.flags else None,
        # 0 is how eProsima's client writes "none"
        deadline_ns=qos.deadline_ms * MS if qos.deadline_ms else None,
        lifespan_ns=qos.lifespan_ms * MS if qos.lifespan_ms else None,
        exclusive=Qos.EXCLUSIVE in qos.flags,
    )
