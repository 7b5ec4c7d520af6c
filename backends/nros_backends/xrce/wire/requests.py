"""Payloads of sessions and entities: what is asked for, and what is answered (clauses 8.3.5.1 to 8.3.5.7)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nros_backends.xrce.wire import messages as m
from nros_backends.xrce.wire.cdr import Reader, Writer
from nros_backends.xrce.wire.fields import read_object, read_pair, read_request, write_object, write_request
from nros_backends.xrce.wire.ids import Id, Kind, ObjectId

REUSE = 0x02
REPLACE = 0x04


def _read_create_client(reader: Reader, flags: int) -> m.CreateClient:
    cookie = reader.take(4, "cookie")
    version = read_pair(reader, "version")
    vendor = read_pair(reader, "vendor")
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
    write_request(writer, value.request, value.object)
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
    write_request(writer, value.request, value.object)
    writer.unsigned(4, value.mask)
    return 0


def _read_delete(reader: Reader, flags: int) -> m.Delete:
    request, target = read_request(reader)
    return m.Delete(request=request, object=target, little=reader.little)


def _write_delete(writer: Writer, value: m.Delete) -> int:
    write_request(writer, value.request, value.object)
    return 0


def _read_status_agent(reader: Reader, flags: int) -> m.StatusAgent:
    status, implementation = read_pair(reader, "result status")
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
    agent = reader.take(4, "cookie"), read_pair(reader, "version"), read_pair(reader, "vendor")
    if reader.boolean("has_properties"):
        raise reader.fail("an agent with properties is not supported")
    return agent


def _write_agent(writer: Writer, value: m.StatusAgent | m.AgentConfiguration) -> None:
    writer.put(value.cookie + bytes(value.version) + bytes(value.vendor) + b"\0")


def _read_status(reader: Reader, flags: int) -> m.StatusReply:
    request, target = read_request(reader)
    status, implementation = read_pair(reader, "result status")
    return m.StatusReply(
        request=request, object=target, status=status, implementation=implementation, little=reader.little
    )


def _write_status(writer: Writer, value: m.StatusReply) -> int:
    write_request(writer, value.request, value.object)
    writer.put(bytes((value.status, value.implementation)))
    return 0


def _read_info(reader: Reader, flags: int) -> m.Info:
    request, target = read_request(reader)
    status, implementation = read_pair(reader, "result status")
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
    write_request(writer, value.request, value.object)
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


READERS: dict[int, Callable[[Reader, int], m.Submessage]] = {
    Id.CREATE_CLIENT: _read_create_client,
    Id.CREATE: _read_create,
    Id.GET_INFO: _read_get_info,
    Id.DELETE: _read_delete,
    Id.STATUS_AGENT: _read_status_agent,
    Id.STATUS: _read_status,
    Id.INFO: _read_info,
}
"""By submessage id; also given the flags."""

# Any: each function takes the one type that it stands beside, which a dict cannot say.
WRITERS: dict[type[m.Submessage], tuple[Id, Callable[[Writer, Any], int]]] = {
    m.CreateClient: (Id.CREATE_CLIENT, _write_create_client),
    m.Create: (Id.CREATE, _write_create),
    m.GetInfo: (Id.GET_INFO, _write_get_info),
    m.Delete: (Id.DELETE, _write_delete),
    m.StatusAgent: (Id.STATUS_AGENT, _write_status_agent),
    m.StatusReply: (Id.STATUS, _write_status),
    m.Info: (Id.INFO, _write_info),
}
"""By type: the id, and the function, which returns the flags without bit 0."""
