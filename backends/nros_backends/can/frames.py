"""Cyphal/CAN v1.0 message frames: the 29-bit identifier, the tail byte, CRC and padding (Cyphal 1.0, 4.2)."""

from __future__ import annotations

import binascii
from typing import NamedTuple

MTU_CLASSIC, MTU_FD = 8, 64

SUBJECTS = 2**13
NODES = 2**7
TRANSFER_IDS = 2**5

SOT, EOT, TOGGLE, ID_MASK = 0x80, 0x40, 0x20, 0x1F
"""The tail byte: start and end of transfer, toggle (1 in the first frame), transfer-id."""

_RESERVED = 1 << 23 | 1 << 7
_SERVICE, _ANONYMOUS = 1 << 25, 1 << 24
_SET_BY_SENDERS = 3 << 21
_CRC_SIZE = 2
_FD_SIZES = (*range(9), 12, 16, 20, 24, 32, 48, 64)
"""Data lengths that a frame can have; a longer one of CAN FD is padded to the next."""

_FD_SIZE_OF = tuple(next(size for size in _FD_SIZES if size >= length) for length in range(MTU_FD + 1))


class MessageId(NamedTuple):
    """What a message identifier says."""

    priority: int
    subject: int
    node: int


def can_id(priority: int, subject: int, node: int) -> int:
    """The identifier of a message on ``subject`` (0 to 8191) from ``node`` (0 to 127), priority 0 (first) to 7."""
    return priority << 26 | _SET_BY_SENDERS | subject << 8 | node


def parse_id(identifier: int) -> MessageId | None:
    """The parts of a 29-bit identifier; None for services, anonymous nodes and anything reserved."""
    if identifier & (_SERVICE | _ANONYMOUS | _RESERVED) or identifier >> 29:
        return None
    return MessageId(identifier >> 26 & 7, identifier >> 8 & (SUBJECTS - 1), identifier & (NODES - 1))


def crc(data: bytes, value: int = 0xFFFF) -> int:
    """CRC-16/CCITT-FALSE, the transfer CRC; 0 over a payload with its own CRC behind it."""
    return binascii.crc_hqx(data, value)


def segment(payload: bytes, transfer_id: int, mtu: int) -> list[bytes]:
    """The data of the frames of one transfer, in order; ``mtu`` is `MTU_CLASSIC` or `MTU_FD`.

    On CAN FD the last frame is padded with zeros that the receiver cannot tell from payload.
    """
    room = mtu - 1
    tail = transfer_id & ID_MASK
    if len(payload) <= room:
        padding = bytes(_FD_SIZE_OF[len(payload) + 1] - len(payload) - 1)
        return [payload + padding + bytes((SOT | EOT | TOGGLE | tail,))]
    last = (len(payload) + _CRC_SIZE) % room or room
    body = payload + bytes(_FD_SIZE_OF[last + 1] - last - 1)
    body += crc(body).to_bytes(_CRC_SIZE, "big")
    frames = []
    toggle = TOGGLE
    for begin in range(0, len(body), room):
        ends = (SOT if begin == 0 else 0) | (EOT if begin + room >= len(body) else 0)
        frames.append(body[begin : begin + room] + bytes((ends | toggle | tail,)))
        toggle ^= TOGGLE
    return frames
