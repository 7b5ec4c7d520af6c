"""What travels beside a sample: number, source time and publisher, as rmw_zenoh writes it.

33 bytes, little-endian: number (i64, the first sample is 1), source time (i64, ns since the Unix epoch), length
of the gid (u8, 16), gid. nano-ros may append the CRC-32 of the payload; rmw_zenoh before mid 2025 put a
length-prefixed name in front of each field.
"""

from __future__ import annotations

import struct
import zlib
from typing import NamedTuple

GID_SIZE = 16

_POSITIONAL = struct.Struct(f"<qqB{GID_SIZE}s")
_LABELLED = struct.Struct(f"<16sq17sq11sB{GID_SIZE}s")
_LABELS = (b"\x0fsequence_number", b"\x10source_timestamp", b"\x0asource_gid")
_CRC = struct.Struct("<I")

_ABSURD = 2**56
"""No publisher gets that far; a number of that size that is small when read big-endian was written so."""


class Attachment(NamedTuple):
    """What a sample says about itself."""

    number: int
    source_ns: int
    gid: bytes


def encode(attachment: Attachment) -> bytes:
    """The positional layout."""
    return _POSITIONAL.pack(attachment.number, attachment.source_ns, GID_SIZE, attachment.gid)


def decode(data: bytes | None, payload: bytes) -> Attachment | None:
    """None when it carries no usable number: missing, cut short, of another layout, or not of this payload."""
    if data is None:
        return None
    if len(data) == _LABELLED.size:
        name, number, time, source_ns, source, length, gid = _LABELLED.unpack(data)
        if (name, time, source) != _LABELS:
            return None
    elif len(data) in (_POSITIONAL.size, _POSITIONAL.size + _CRC.size):
        number, source_ns, length, gid = _POSITIONAL.unpack_from(data)
        if len(data) > _POSITIONAL.size and _CRC.unpack_from(data, _POSITIONAL.size)[0] != zlib.crc32(payload):
            return None
    else:
        return None
    if length != GID_SIZE or (number >= _ABSURD and _swapped(number) < 2**32):
        return None
    return Attachment(number, source_ns, gid)


def find_number(frame: bytes, gid: bytes) -> int | None:
    """The number of the first sample of this publisher within wire bytes."""
    at = frame.find(bytes([GID_SIZE]) + gid)
    return int.from_bytes(frame[at - 16 : at - 8], "little", signed=True) if at >= 16 else None


def _swapped(number: int) -> int:
    return int.from_bytes(number.to_bytes(8, "little"), "big")
