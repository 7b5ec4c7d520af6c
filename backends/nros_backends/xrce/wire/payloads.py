"""Payloads of the sixteen submessages, each read and written by one function (clause 8.3.5)."""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import Any

from nros_backends.xrce.wire import messages as m
from nros_backends.xrce.wire.cdr import Reader, Writer
from nros_backends.xrce.wire.ids import Kind, ObjectId

REUSE = 0x02
REPLACE = 0x04
LAST = 0x02
FORMAT = 0x0E


class Id(enum.IntEnum):
    """Submessage ids."""

    CREATE_CLIENT = 0
    CREATE = 1
    GET_INFO = 2
    DELETE = 3
    STATUS_AGENT = 4
    STATUS = 5
    INFO = 6
    WRITE_DATA = 7
    READ_DATA = 8
    DATA = 9
    ACKNACK = 10
    HEARTBEAT = 11
    RESET = 12
    FRAGMENT = 13
    TIMESTAMP = 14
    TIMESTAMP_REPLY = 15


def read(identifier: int, flags: int, reader: Reader) -> m.Submessage:
    """The submessage of a payload. Raises `Malformed`; what follows the last field is ignored, as eProsima does."""
    if identifier not in _READERS:
        return m.Unknown(
            id=identifier, flags=flags & ~1, payload=reader.take(reader.remaining, "payload"), little=reader.little
        )
    return _READERS[identifier](reader, flags)


def write(submessage: m.Submessage, writer: Writer) -> tuple[int, int]:
    """Append the payload; the id and the flags (without bit 0). Raises `OverflowError` for what has no room."""
    if isinstance(submessage, m.Unknown):
        writer.put(submessage.payload)
        return submessage.id, submessage.flags
    identifier, function = _WRITERS[type(submessage)]
    return identifier, function(writer, submessage)


def read_object(reader: Reader, what: str = "object id") -> ObjectId:
    """An object id: two bytes, big-endian whatever the submessage's byte order."""
    raw = int.from_bytes(reader.take(2, what), "big")
    return ObjectId(raw >> 4, Kind(raw & 0xF))


def write_object(writer: Writer, value: ObjectId) -> None:
    """The opposite of `read_object`."""
    writer.put((value.number << 4 | value.kind).to_bytes(2, "big"))


def read_request(reader: Reader) -> tuple[int, ObjectId]:
    """Request id and object id (``BaseObjectRequest``), both big-endian."""
    return int.from_bytes(reader.take(2, "request id"), "big"), read_object(reader)


def _write_request(writer: Writer, request: int, value: ObjectId) -> None:
    writer.put(request.to_bytes(2, "big"))
    write_object(writer, value)


def _read_pair(reader: Reader, what: str) -> tuple[int, int]:
    first, second = reader.take(2, what)
    return first, second


def _read_create_client(reader: Reader, flags: int) -> m.CreateClient:
    cookie = reader.take(4, "cookie")
    version = _read_pair(reader, "version")
    vendor = _read_pair(reader, "vendor")
    key = int.from_bytes(reader.take(4, "client key"), "big")
    session = reader.take(1, "session id")[0]
    properties: list[tuple[str, str]] = []
    if reader.boolean("has_properties"):
        for _ in range(reader.unsigned(4, "number of properties")):
            properties.append((reader.string("property name"), reader.string("property value")))
    return m.CreateClient(
        key=key, session=session, mtu=reader.unsigned(2, "mtu"), properties=tuple(properties),
        cookie=cookie, version=version, vendor=vendor, little=reader.little,
    )  # fmt: skip


def _write_create_client(writer: Writer, value: m.CreateClient) -> int:
    writer.put(value.cookie + bytes(value.version) + bytes(value.vendor))
    writer.put(value.key.to_bytes(4, "big"))
    writer.put(bytes((value.session, bool(value.properties))))
    if value.properties:
        writer.unsigned(4, len(value.properties))
        for name, content in value.properties:
            writer.string(name)
            writer.string(content)
    writer.unsigned(2, value.mtu)
    return 0


def _read_create(reader: Reader, flags: int) -> m.Create:
    request, target = read_request(reader)
    raw_kind = reader.take(1, "kind")[0]
    if raw_kind > 0xF:
        raise reader.fail(f"object kind {raw_kind} does not exist")
    kind = Kind(raw_kind)
    form = reader.take(1, "representation format")[0]
    representation: m.Representation
    if form == 1:
        representation = m.Ref(reader.string("reference"))
    elif form == 2:
        representation = m.Xml(reader.string("XML"))
    elif form == 3:
        representation = m.Binary(reader.sequence("binary representation"))
    else:
        raise reader.fail(f"representation format {form} is none of 1 (REF), 2 (XML), 3 (BIN)")
    parent, domain = None, 0
    if kind is Kind.PARTICIPANT:
        domain = reader.signed(2, "domain id")
    else:
        parent = read_object(reader, "parent")
    return m.Create(
        request=request, object=target, kind=kind, representation=representation, parent=parent, domain=domain,
        reuse=bool(flags & REUSE), replace=bool(flags & REPLACE), little=reader.little,
    )  # fmt: skip


def _write_create(writer: Writer, value: m.Create) -> int:
    _write_request(writer, value.request, value.object)
    writer.put(bytes((value.kind,)))
    match value.representation:
        case m.Ref(name):
            writer.put(b"\x01")
            writer.string(name)
        case m.Xml(text):
            writer.put(b"\x02")
            writer.string(text)
        case m.Binary(body):
            writer.put(b"\x03")
            writer.sequence(body)
    if value.kind is Kind.PARTICIPANT:
        writer.signed(2, value.domain)
    else:
        write_object(writer, value.parent or ObjectId(0, Kind.INVALID))
    return value.reuse * REUSE | value.replace * REPLACE


def _read_get_info(reader: Reader, flags: int) -> m.GetInfo:
    request, target = read_request(reader)
    return m.GetInfo(request=request, object=target, mask=reader.unsigned(4, "info mask"), little=reader.little)


def _write_get_info(writer: Writer, value: m.GetInfo) -> int:
    _write_request(writer, value.request, value.object)
    writer.unsigned(4, value.mask)
    return 0


def _read_delete(reader: Reader, flags: int) -> m.Delete:
    request, target = read_request(reader)
    return m.Delete(request=request, object=target, little=reader.little)


def _write_delete(writer: Writer, value: m.Delete) -> int:
    _write_request(writer, value.request, value.object)
    return 0


def _read_status_agent(reader: Reader, flags: int) -> m.StatusAgent:
    status, implementation = _read_pair(reader, "result status")
    cookie, version, vendor = _read_agent(reader)
    return m.StatusAgent(
        status=status, implementation=implementation, cookie=cookie, version=version, vendor=vendor,
        little=reader.little,
    )  # fmt: skip


def _write_status_agent(writer: Writer, value: m.StatusAgent) -> int:
    writer.put(bytes((value.status, value.implementation)))
    _write_agent(writer, value)
    return 0


def _read_agent(reader: Reader) -> tuple[bytes, tuple[int, int], tuple[int, int]]:
    agent = reader.take(4, "cookie"), _read_pair(reader, "version"), _read_pair(reader, "vendor")
    if reader.boolean("has_properties"):
        raise reader.fail("an agent with properties is not supported")
    return agent


def _write_agent(writer: Writer, value: m.StatusAgent | m.AgentConfiguration) -> None:
    writer.put(value.cookie + bytes(value.version) + bytes(value.vendor) + b"\0")


def _read_status(reader: Reader, flags: int) -> m.StatusReply:
    request, target = read_request(reader)
    status, implementation = _read_pair(reader, "result status")
    return m.StatusReply(
        request=request, object=target, status=status, implementation=implementation, little=reader.little
    )


def _write_status(writer: Writer, value: m.StatusReply) -> int:
    _write_request(writer, value.request, value.object)
    writer.put(bytes((value.status, value.implementation)))
    return 0


def _read_info(reader: Reader, flags: int) -> m.Info:
    request, target = read_request(reader)
    status, implementation = _read_pair(reader, "result status")
    configuration = activity = None
    if reader.boolean("has configuration"):
        _expect_agent(reader)
        configuration = m.AgentConfiguration(*_read_agent(reader))
    if reader.boolean("has activity"):
        _expect_agent(reader)
        activity = m.AgentActivity(reader.signed(2, "availability"))
        if reader.unsigned(4, "number of locators"):
            raise reader.fail("locators in INFO are not supported")
    return m.Info(
        request=request, object=target, status=status, implementation=implementation,
        configuration=configuration, activity=activity, little=reader.little,
    )  # fmt: skip


def _expect_agent(reader: Reader) -> None:
    kind = reader.take(1, "kind")[0]
    if kind != Kind.AGENT:
        raise reader.fail(f"information about object kind {kind}, only that of an agent is supported")


def _write_info(writer: Writer, value: m.Info) -> int:
    _write_request(writer, value.request, value.object)
    writer.put(bytes((value.status, value.implementation)))
    writer.boolean(value.configuration is not None)
    if value.configuration is not None:
        writer.put(bytes((Kind.AGENT,)))
        _write_agent(writer, value.configuration)
    writer.boolean(value.activity is not None)
    if value.activity is not None:
        writer.put(bytes((Kind.AGENT,)))
        writer.signed(2, value.activity.availability)
        writer.unsigned(4, 0)
    return 0


def _read_sample(kind: type[Any]) -> Callable[[Reader, int], Any]:
    def read_sample(reader: Reader, flags: int) -> m.WriteData | m.Data:
        request, target = read_request(reader)
        data = reader.take(reader.remaining, "data")
        sample: m.WriteData | m.Data = kind(
            request=request, object=target, data=data, format=flags & FORMAT, little=reader.little
        )
        return sample

    return read_sample


def _write_sample(writer: Writer, value: m.WriteData | m.Data) -> int:
    _write_request(writer, value.request, value.object)
    writer.put(value.data)
    return value.format


def _read_read_data(reader: Reader, flags: int) -> m.ReadData:
    request, target = read_request(reader)
    stream = reader.take(1, "stream id")[0]
    form = reader.take(1, "data format")[0]
    content_filter = reader.string("content filter") if reader.boolean("has content filter") else None
    delivery = None
    if reader.boolean("has delivery control"):
        delivery = m.DeliveryControl(
            max_samples=reader.unsigned(2, "max_samples"),
            max_elapsed_s=reader.unsigned(2, "max_elapsed_time"),
            max_octets_per_s=reader.unsigned(2, "max_bytes_per_second"),
            min_pace_ms=reader.unsigned(2, "min_pace_period"),
        )
    return m.ReadData(
        request=request, object=target, stream=stream, format=form, content_filter=content_filter,
        delivery=delivery, little=reader.little,
    )  # fmt: skip


def _write_read_data(writer: Writer, value: m.ReadData) -> int:
    _write_request(writer, value.request, value.object)
    writer.put(bytes((value.stream, value.format)))
    writer.boolean(value.content_filter is not None)
    if value.content_filter is not None:
        writer.string(value.content_filter)
    writer.boolean(value.delivery is not None)
    if value.delivery is not None:
        writer.unsigned(2, value.delivery.max_samples)
        writer.unsigned(2, value.delivery.max_elapsed_s)
        writer.unsigned(2, value.delivery.max_octets_per_s)
        writer.unsigned(2, value.delivery.min_pace_ms)
    return 0


def _read_acknack(reader: Reader, flags: int) -> m.Acknack:
    first = reader.unsigned(2, "first_unacked")
    missing = int.from_bytes(reader.take(2, "nack bitmap"), "big")  # an array of octets
    return m.Acknack(first_unacked=first, missing=missing, stream=reader.take(1, "stream id")[0], little=reader.little)


def _write_acknack(writer: Writer, value: m.Acknack) -> int:
    writer.unsigned(2, value.first_unacked)
    writer.put(value.missing.to_bytes(2, "big") + bytes((value.stream,)))
    return 0


def _read_heartbeat(reader: Reader, flags: int) -> m.Heartbeat:
    return m.Heartbeat(
        first=reader.unsigned(2, "first"), last=reader.unsigned(2, "last"),
        stream=reader.take(1, "stream id")[0], little=reader.little,
    )  # fmt: skip


def _write_heartbeat(writer: Writer, value: m.Heartbeat) -> int:
    writer.unsigned(2, value.first)
    writer.unsigned(2, value.last)
    writer.put(bytes((value.stream,)))
    return 0


def _read_reset(reader: Reader, flags: int) -> m.Reset:
    return m.Reset(little=reader.little)


def _write_reset(writer: Writer, value: m.Reset) -> int:
    return 0


def _read_fragment(reader: Reader, flags: int) -> m.Fragment:
    return m.Fragment(data=reader.take(reader.remaining, "fragment"), last=bool(flags & LAST), little=reader.little)


def _write_fragment(writer: Writer, value: m.Fragment) -> int:
    writer.put(value.data)
    return value.last * LAST


def _read_time(reader: Reader, what: str) -> m.Time:
    return m.Time(reader.signed(4, f"{what} seconds"), reader.unsigned(4, f"{what} nanoseconds"))


def _write_time(writer: Writer, value: m.Time) -> None:
    writer.signed(4, value.seconds)
    writer.unsigned(4, value.nanoseconds)


def _read_timestamp(reader: Reader, flags: int) -> m.Timestamp:
    return m.Timestamp(transmit=_read_time(reader, "transmit"), little=reader.little)


def _write_timestamp(writer: Writer, value: m.Timestamp) -> int:
    _write_time(writer, value.transmit)
    return 0


def _read_timestamp_reply(reader: Reader, flags: int) -> m.TimestampReply:
    return m.TimestampReply(
        transmit=_read_time(reader, "transmit"), receive=_read_time(reader, "receive"),
        originate=_read_time(reader, "originate"), little=reader.little,
    )  # fmt: skip


def _write_timestamp_reply(writer: Writer, value: m.TimestampReply) -> int:
    for time in (value.transmit, value.receive, value.originate):
        _write_time(writer, time)
    return 0


_READERS: dict[int, Callable[[Reader, int], m.Submessage]] = {
    Id.CREATE_CLIENT: _read_create_client,
    Id.CREATE: _read_create,
    Id.GET_INFO: _read_get_info,
    Id.DELETE: _read_delete,
    Id.STATUS_AGENT: _read_status_agent,
    Id.STATUS: _read_status,
    Id.INFO: _read_info,
    Id.WRITE_DATA: _read_sample(m.WriteData),
    Id.READ_DATA: _read_read_data,
    Id.DATA: _read_sample(m.Data),
    Id.ACKNACK: _read_acknack,
    Id.HEARTBEAT: _read_heartbeat,
    Id.RESET: _read_reset,
    Id.FRAGMENT: _read_fragment,
    Id.TIMESTAMP: _read_timestamp,
    Id.TIMESTAMP_REPLY: _read_timestamp_reply,
}

# Any: each function takes the one type that it stands beside, which a dict cannot say.
_WRITERS: dict[type[m.Submessage], tuple[Id, Callable[[Writer, Any], int]]] = {
    m.CreateClient: (Id.CREATE_CLIENT, _write_create_client),
    m.Create: (Id.CREATE, _write_create),
    m.GetInfo: (Id.GET_INFO, _write_get_info),
    m.Delete: (Id.DELETE, _write_delete),
    m.StatusAgent: (Id.STATUS_AGENT, _write_status_agent),
    m.StatusReply: (Id.STATUS, _write_status),
    m.Info: (Id.INFO, _write_info),
    m.WriteData: (Id.WRITE_DATA, _write_sample),
    m.ReadData: (Id.READ_DATA, _write_read_data),
    m.Data: (Id.DATA, _write_sample),
    m.Acknack: (Id.ACKNACK, _write_acknack),
    m.Heartbeat: (Id.HEARTBEAT, _write_heartbeat),
    m.Reset: (Id.RESET, _write_reset),
    m.Fragment: (Id.FRAGMENT, _write_fragment),
    m.Timestamp: (Id.TIMESTAMP, _write_timestamp),
    m.TimestampReply: (Id.TIMESTAMP_REPLY, _write_timestamp_reply),
}
