"""Samples that say who sent them: run, publisher, sequence number and the step that published.

The bytes are a serialized ``sequence<octet>`` (CDR, little endian), because some backends parse what
they carry: encapsulation header, length, then the octets.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

_CDR_LE = b"\x00\x01\x00\x00"
_LENGTH = struct.Struct("<I")
_BODY = struct.Struct("<4sQHHI")
_MAGIC = b"nros"
_HEAD = len(_CDR_LE) + _LENGTH.size
MIN_SIZE = _HEAD + _BODY.size
"""Bytes of the smallest sample that carries an identity."""


class Identity(NamedTuple):
    """``publisher`` and ``label`` are positions in the stage's lists of names."""

    run: int
    publisher: int
    label: int
    sequence: int


def encode(identity: Identity, size: int = MIN_SIZE) -> bytes:
    """A sample of ``size`` bytes, at least `MIN_SIZE`."""
    body = _BODY.pack(_MAGIC, *identity).ljust(size - _HEAD, b"\0")
    return _CDR_LE + _LENGTH.pack(len(body)) + body


def decode(data: bytes) -> Identity | None:
    """Who sent it; None for a sample that is not ours."""
    if len(data) < MIN_SIZE:
        return None
    magic, *fields = _BODY.unpack_from(data, _HEAD)
    return Identity(*fields) if magic == _MAGIC else None
