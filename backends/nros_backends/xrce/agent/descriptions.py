"""What an entity is to be, whichever of the three representations said so."""

from __future__ import annotations

import msgspec

from nros_backends.xrce.agent.qos import EntityQos
from nros_backends.xrce.wire.ids import ObjectId


class Refused(Exception):
    """A representation from which no entity can be made; the text says why."""


class Participant(msgspec.Struct, frozen=True):
    """``domain``: i16 of CREATE, not of the representation."""

    name: str = ""
    domain: int = 0


class Topic(msgspec.Struct, frozen=True):
    """A topic by name and type."""

    name: str
    type: str


class Group(msgspec.Struct, frozen=True):
    """A publisher or a subscriber."""

    partitions: tuple[str, ...] = ()


class Endpoint(msgspec.Struct, frozen=True):
    """A data writer or reader on a topic of its own client: by id (BIN) or by name and type (XML, REF)."""

    topic: ObjectId | Topic
    qos: EntityQos


class Service(msgspec.Struct, frozen=True):
    """A requester or a replier. ``reader``: QoS of the end that gets the replies, respectively the requests."""

    request: Topic
    reply: Topic
    reader: EntityQos


def service(
    name: str, request_type: str, reply_type: str, reader: EntityQos, request: str = "", reply: str = ""
) -> Service:
    """A service whose topics, where they have no names, are called after it."""
    return Service(
        Topic(request or f"{name}_Request", request_type), Topic(reply or f"{name}_Reply", reply_type), reader
    )


Description = Participant | Topic | Group | Endpoint | Service
