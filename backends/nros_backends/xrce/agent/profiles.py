"""Profiles that REF may name: those of the agent whose conversations were recorded (its ``agent.refs``)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from nros_backends.xrce.agent.descriptions import Description, Endpoint, Participant, Topic, service
from nros_backends.xrce.agent.qos import READER, WRITER
from nros_backends.xrce.wire.ids import Kind

_SHAPE = Topic("Square", "ShapeType")
_SERVICE = service("shapetype_service", "request_type", "reply_type", READER)

PROFILES: Mapping[tuple[Kind, str], Description] = MappingProxyType(
    {
        (Kind.PARTICIPANT, "default_xrce_participant"): Participant("default_xrce_participant"),
        (Kind.TOPIC, "shapetype_topic"): _SHAPE,
        (Kind.DATAWRITER, "shapetype_data_writer"): Endpoint(_SHAPE, WRITER),
        (Kind.DATAREADER, "shapetype_data_reader"): Endpoint(_SHAPE, READER),
        (Kind.REQUESTER, "shapetype_requester"): _SERVICE,
        (Kind.REPLIER, "shapetype_replier"): _SERVICE,
    }
)
