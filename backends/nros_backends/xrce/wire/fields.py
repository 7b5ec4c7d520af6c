"""Fields that several submessages share."""

from __future__ import annotations

from nros_backends.xrce.wire.cdr import Reader, Writer
from nros_backends.xrce.wire.ids import Kind, ObjectId


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


def write_request(writer: Writer, request: int, value: ObjectId) -> None:
    """The opposite of `read_request`."""
    writer.put(request.to_bytes(2, "big"))
    write_object(writer, value)


def read_pair(reader: Reader, what: str) -> tuple[int, int]:
    """Two octets, such as a version."""
    first, second = reader.take(2, what)
    return first, second
