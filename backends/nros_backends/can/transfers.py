"""From frames back to transfers, and the numbers of transfers beyond their five bits."""

from __future__ import annotations

from typing import NamedTuple

from nros_backends.can.frames import EOT, ID_MASK, SOT, TOGGLE, TRANSFER_IDS, crc

NUMBERS = 2**32
"""Transfers are counted modulo that; a multiple of `TRANSFER_IDS`, so that both wrap together."""

TRANSFER_ID_TIMEOUT_NS = 2_000_000_000
"""After that a repeated transfer-id is a new transfer and no duplicate (Cyphal 1.0, 4.1.2.4)."""


class Transfer(NamedTuple):
    """A complete transfer. On CAN FD the payload may carry padding at its end."""

    transfer_id: int
    payload: bytes


class Assembly:
    """Puts the frames of one subject and source node together. Keeps at most ``limit`` bytes of one transfer."""

    __slots__ = ("_limit", "_parts", "_size", "_toggle", "_transfer_id")

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._parts: list[bytes] | None = None
        self._size = 0
        self._toggle = 0
        self._transfer_id = 0

    def frame(self, data: bytes) -> Transfer | None:
        """Take in one frame; the transfer that it completes.

        Whatever belongs to no transfer is dropped: frames of UAVCAN v0 (first toggle 0), repeated frames,
        frames whose beginning was missed, transfers with a wrong CRC or beyond the limit.
        """
        if not data:
            return None
        tail, chunk = data[-1], data[:-1]
        if tail & SOT:
            self._parts = None
            if not tail & TOGGLE:
                return None
            if tail & EOT:
                return Transfer(tail & ID_MASK, chunk)
            if not chunk:
                return None
            self._parts, self._size = [], 0
            self._toggle, self._transfer_id = TOGGLE, tail & ID_MASK
        parts = self._parts
        if parts is None or not chunk or tail & ID_MASK != self._transfer_id or tail & TOGGLE != self._toggle:
            return None
        self._toggle ^= TOGGLE
        self._size += len(chunk)
        if self._size > self._limit:
            self._parts = None
            return None
        parts.append(chunk)
        if not tail & EOT:
            return None
        self._parts = None
        body = b"".join(parts)
        return Transfer(tail & ID_MASK, body[:-2]) if len(body) > 2 and not crc(body) else None


class Numbering:
    """Which transfers of one subject and source node have come, by number.

    A transfer tells the five lowest bits of its number, so up to 30 in a row that are missing are
    counted at once. The sender's own count, sent beside them (`status`), puts right what is more.
    """

    __slots__ = ("_counted", "_next", "_transfer_ns")

    def __init__(self, count: int | None = None) -> None:
        self._next = count
        self._counted = count is not None
        """Whether the sender tells its count."""
        self._transfer_ns = 0

    def transfer(self, transfer_id: int, at_ns: int) -> int | None:
        """How many transfers before this one are found missing; None for a repeated one.

        The very first one synchronises. Of a sender that does not tell its count an old transfer-id is
        taken for new after `TRANSFER_ID_TIMEOUT_NS`.
        """
        gap = 0 if self._next is None else (transfer_id - self._next) % TRANSFER_IDS
        if gap == TRANSFER_IDS - 1 and (self._counted or at_ns - self._transfer_ns < TRANSFER_ID_TIMEOUT_NS):
            return None
        self._next = (transfer_id + 1) if self._next is None else (self._next + gap + 1) % NUMBERS
        self._transfer_ns = at_ns
        return gap

    def status(self, count: int) -> int:
        """The sender has sent ``count`` transfers up to now; how many more are found missing."""
        missing = 0 if self._next is None or not self._counted else (count - self._next) % NUMBERS
        if missing >= NUMBERS // 2:
            return 0  # older than what has come since
        self._next, self._counted = count % NUMBERS, True
        return missing

    def rebase(self, count: int) -> None:
        """The sender goes on with another number; nothing is missing."""
        self._next, self._counted = count % NUMBERS, True
