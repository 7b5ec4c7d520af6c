"""Payloads of the sixteen submessages and of unknown ones: which function reads and writes which."""

from __future__ import annotations

from nros_backends.xrce.wire import messages as m
from nros_backends.xrce.wire import requests, transfers
from nros_backends.xrce.wire.cdr import Reader, Writer

_READERS = {**requests.READERS, **transfers.READERS}
_WRITERS = {**requests.WRITERS, **transfers.WRITERS}


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
