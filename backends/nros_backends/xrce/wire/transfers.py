"""Payloads of samples, streams and clocks (clauses 8.3.5.8 to 8.3.5.16)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nros_backends.xrce.wire import messages as m
from nros_backends.xrce.wire.cdr import Reader, Writer
from nros_backends.xrce.wire.fields import read_request, write_request
from nros_backends.xrce.wire.ids import Id

LAST = 0x02
FORMAT = 0x0E


def _read_sample(kind: type[Any]) -> Callable[[Reader, int], Any]:
    def read(reader: Reader, flags: int) -> m.WriteData | m.Data:
        request, target = read_request(reader)
        data = reader.take(reader.remaining, "data")
        sample: m.WriteData | m.Data = kind(
            request=request, object=target, data=data, format=flags & FORMAT, little=reader.little
        )
        return sample

    return read


def _write_sample(writer: Writer, value: m.WriteData | m.Data) -> int:
    write_request(writer, value.request, value.object)
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
    write_request(writer, value.request, value.object)
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


READERS: dict[int, Callable[[Reader, int], m.Submessage]] = {
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
"""By submessage id; also given the flags."""

# Any: each function takes the one type that it stands beside, which a dict cannot say.
WRITERS: dict[type[m.Submessage], tuple[Id, Callable[[Writer, Any], int]]] = {
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
"""By type: the id, and the function, which returns the flags without bit 0."""
