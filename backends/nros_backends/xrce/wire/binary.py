"""Bodies of the binary representation (clause 7.7.3, annex A): one value per kind of entity.

A body is a CDR buffer of its own, in the byte order of its submessage. There is no liveliness in it.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import Any

import msgspec

from nros_backends.xrce.wire.cdr import Reader, Writer
from nros_backends.xrce.wire.fields import read_object, write_object
from nros_backends.xrce.wire.ids import Kind, ObjectId


class Qos(enum.IntFlag):
    """``EndpointQosFlags``; what is not set is best effort, keep all, shared, volatile."""

    RELIABLE = 0x01
    KEEP_LAST = 0x02
    EXCLUSIVE = 0x04
    TRANSIENT_LOCAL = 0x08
    TRANSIENT = 0x10
    PERSISTENT = 0x20


class ParticipantBody(msgspec.Struct, frozen=True):
    """A participant; eProsima's client puts the name in ``qos_profile``."""

    domain_reference: str | None = None
    qos_profile: str | None = None


class TopicBody(msgspec.Struct, frozen=True):
    """A topic. ``type_name``: eProsima puts it in the place of the type identifier."""

    name: str
    type_reference: str | None = None
    type_name: str | None = None


class GroupBody(msgspec.Struct, frozen=True):
    """A publisher or a subscriber."""

    partitions: tuple[str, ...] | None = None
    group_data: bytes | None = None


class EndpointQos(msgspec.Struct, frozen=True):
    """What data writer and data reader share. ``deadline_ms`` and ``lifespan_ms``: u32 milliseconds."""

    flags: Qos = Qos(0)
    depth: int | None = None
    deadline_ms: int | None = None
    lifespan_ms: int | None = None
    user_data: bytes | None = None


class WriterBody(msgspec.Struct, frozen=True):
    """A data writer on the topic of an id."""

    topic: ObjectId
    qos: EndpointQos | None = None
    ownership_strength: int | None = None


class ReaderBody(msgspec.Struct, frozen=True):
    """A data reader on the topic of an id. ``time_filter``: u64, the unit is not specified."""

    topic: ObjectId
    qos: EndpointQos | None = None
    time_filter: int | None = None
    content_filter: str | None = None


class ServiceBody(msgspec.Struct, frozen=True):
    """A requester or a replier; eProsima's, the standard knows no services."""

    name: str
    request_type: str
    reply_type: str
    request_topic: str | None = None
    reply_topic: str | None = None


Body = ParticipantBody | TopicBody | GroupBody | WriterBody | ReaderBody | ServiceBody


def decode_binary(kind: Kind, body: bytes, little: bool = True) -> Body:
    """The body of an entity of ``kind``. Raises `Malformed`, also for a kind that has none here."""
    reader = Reader(body, little)
    if kind not in _READERS:
        raise reader.fail(f"object kind {kind.name} has no binary representation here")
    return _READERS[kind](reader)


def encode_binary(body: Body, little: bool = True) -> bytes:
    """The opposite of `decode_binary`. Raises `OverflowError` for numbers that have no room on the wire."""
    writer = Writer(little)
    _WRITERS[type(body)](writer, body)
    return bytes(writer.data)


def _optional_string(reader: Reader, what: str) -> str | None:
    return reader.string(what) if reader.boolean(f"has {what}") else None


def _optional_number(reader: Reader, size: int, what: str) -> int | None:
    return reader.unsigned(size, what) if reader.boolean(f"has {what}") else None


def _optional_octets(reader: Reader, what: str) -> bytes | None:
    return reader.sequence(what) if reader.boolean(f"has {what}") else None


def _put_string(writer: Writer, value: str | None) -> None:
    writer.boolean(value is not None)
    if value is not None:
        writer.string(value)


def _put_number(writer: Writer, size: int, value: int | None) -> None:
    writer.boolean(value is not None)
    if value is not None:
        writer.unsigned(size, value)


def _put_octets(writer: Writer, value: bytes | None) -> None:
    writer.boolean(value is not None)
    if value is not None:
        writer.sequence(value)


def _read_participant(reader: Reader) -> ParticipantBody:
    return ParticipantBody(_optional_string(reader, "domain reference"), _optional_string(reader, "QoS profile"))


def _write_participant(writer: Writer, body: ParticipantBody) -> None:
    _put_string(writer, body.domain_reference)
    _put_string(writer, body.qos_profile)


def _read_topic(reader: Reader) -> TopicBody:
    name = reader.string("topic name")
    return TopicBody(name, _optional_string(reader, "type reference"), _optional_string(reader, "type name"))


def _write_topic(writer: Writer, body: TopicBody) -> None:
    writer.string(body.name)
    _put_string(writer, body.type_reference)
    _put_string(writer, body.type_name)


def _read_group(reader: Reader) -> GroupBody:
    partitions = None
    if reader.boolean("has partitions"):
        partitions = tuple(reader.string("partition") for _ in range(reader.unsigned(4, "number of partitions")))
    return GroupBody(partitions, _optional_octets(reader, "group data"))


def _write_group(writer: Writer, body: GroupBody) -> None:
    writer.boolean(body.partitions is not None)
    if body.partitions is not None:
        writer.unsigned(4, len(body.partitions))
        for partition in body.partitions:
            writer.string(partition)
    _put_octets(writer, body.group_data)


def _read_qos(reader: Reader) -> EndpointQos:
    return EndpointQos(
        Qos(reader.unsigned(2, "QoS flags")),
        _optional_number(reader, 2, "history depth"),
        _optional_number(reader, 4, "deadline"),
        _optional_number(reader, 4, "lifespan"),
        _optional_octets(reader, "user data"),
    )


def _write_qos(writer: Writer, qos: EndpointQos) -> None:
    writer.unsigned(2, qos.flags)
    _put_number(writer, 2, qos.depth)
    _put_number(writer, 4, qos.deadline_ms)
    _put_number(writer, 4, qos.lifespan_ms)
    _put_octets(writer, qos.user_data)


def _read_writer(reader: Reader) -> WriterBody:
    topic = read_object(reader, "topic id")
    if not reader.boolean("has QoS"):
        return WriterBody(topic)
    return WriterBody(topic, _read_qos(reader), _optional_number(reader, 8, "ownership strength"))


def _write_writer(writer: Writer, body: WriterBody) -> None:
    write_object(writer, body.topic)
    writer.boolean(body.qos is not None)
    if body.qos is not None:
        _write_qos(writer, body.qos)
        _put_number(writer, 8, body.ownership_strength)


def _read_reader(reader: Reader) -> ReaderBody:
    topic = read_object(reader, "topic id")
    if not reader.boolean("has QoS"):
        return ReaderBody(topic)
    return ReaderBody(
        topic, _read_qos(reader), _optional_number(reader, 8, "time filter"), _optional_string(reader, "content filter")
    )


def _write_reader(writer: Writer, body: ReaderBody) -> None:
    write_object(writer, body.topic)
    writer.boolean(body.qos is not None)
    if body.qos is not None:
        _write_qos(writer, body.qos)
        _put_number(writer, 8, body.time_filter)
        _put_string(writer, body.content_filter)


def _read_service(reader: Reader) -> ServiceBody:
    return ServiceBody(
        reader.string("service name"),
        reader.string("request type"),
        reader.string("reply type"),
        _optional_string(reader, "request topic"),
        _optional_string(reader, "reply topic"),
    )


def _write_service(writer: Writer, body: ServiceBody) -> None:
    for text in (body.name, body.request_type, body.reply_type):
        writer.string(text)
    _put_string(writer, body.request_topic)
    _put_string(writer, body.reply_topic)


_READERS: dict[Kind, Callable[[Reader], Body]] = {
    Kind.PARTICIPANT: _read_participant,
    Kind.TOPIC: _read_topic,
    Kind.PUBLISHER: _read_group,
    Kind.SUBSCRIBER: _read_group,
    Kind.DATAWRITER: _read_writer,
    Kind.DATAREADER: _read_reader,
    Kind.REQUESTER: _read_service,
    Kind.REPLIER: _read_service,
}

# Any: each function takes the one type that it stands beside, which a dict cannot say.
_WRITERS: dict[type[Body], Callable[[Writer, Any], None]] = {
    ParticipantBody: _write_participant,
    TopicBody: _write_topic,
    GroupBody: _write_group,
    WriterBody: _write_writer,
    ReaderBody: _write_reader,
    ServiceBody: _write_service,
}
