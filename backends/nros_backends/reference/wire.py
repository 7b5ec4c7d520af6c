"""Samples as packets, and packets that nobody should understand."""

from __future__ import annotations

import random
import struct
from collections.abc import Iterator
from typing import NamedTuple

MAGIC = b"RF"
_HEAD = struct.Struct("<2sBqII")
LARGEST = 2**20
"""Bytes of the largest sample."""


class Frame(NamedTuple):
    """A sample on the wire; ``publisher`` -1 is somebody who numbers nothing."""

    publisher: int
    sequence: int
    data: bytes


def encode(frame: Frame) -> bytes:
    """The frame as bytes: magic, version, publisher, sequence number, length, data."""
    return _HEAD.pack(MAGIC, 1, frame.publisher, frame.sequence, len(frame.data)) + frame.data


def decode(packet: bytes) -> Frame | None:
    """The frame of a packet; None for what is malformed, truncated, foreign or too long (ROB-001)."""
    if len(packet) < _HEAD.size:
        return None
    magic, version, publisher, sequence, length = _HEAD.unpack_from(packet)
    data = packet[_HEAD.size :]
    if (magic, version) != (MAGIC, 1) or length > LARGEST or length != len(data):
        return None
    return Frame(publisher, sequence, data)


def malformed(publisher: int, count: int, seed: int) -> Iterator[bytes]:
    """Packets that nobody should understand, in the name of this publisher where they name one."""
    dice = random.Random(seed)
    for number in range(count):
        body = dice.randbytes(dice.randrange(64))
        whole = encode(Frame(publisher, dice.getrandbits(32), body))
        yield (
            whole[: dice.randrange(len(whole))],  # cut off
            whole + b"\0" * dice.randrange(1, 9),  # too long
            b"XX" + whole[2:],  # somebody else's protocol
            _HEAD.pack(MAGIC, 1, publisher, number, 2**31) + body,  # two gigabytes, it says
            _HEAD.pack(MAGIC, 9, publisher, number, len(body)) + body,  # a later version
            body,
            b"",
        )[number % 7]
