"""The simulated link between sessions, and what can go wrong with it and with the processes at its ends."""

from __future__ import annotations

import dataclasses
import random
import struct
from collections.abc import Callable, Iterator
from typing import NamedTuple

MAGIC = b"RF"
_HEAD = struct.Struct("<2sBqII")
LARGEST = 2**20
"""Bytes of the largest sample."""


@dataclasses.dataclass(slots=True)
class Link:
    """How one session stands to the others."""

    out: bool = True
    inward: bool = True
    down: bool = False
    """Its process is frozen or dead: it calls nothing, and nothing reaches it."""
    stalled: bool = False
    delay_ns: int = 0
    held: list[tuple[int, Callable[[], None]]] = dataclasses.field(default_factory=list)
    """What is under way, with the time at which it arrives."""

    def heal(self) -> None:
        """All passes again; what was held back arrives now."""
        self.out = self.inward = True
        self.stalled, self.delay_ns = False, 0
        self.held = [(0, arrive) for _, arrive in self.held]


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
