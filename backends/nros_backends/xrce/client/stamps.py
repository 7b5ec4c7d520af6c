"""The kernel's stamps of arrival, as ``CLOCK_MONOTONIC`` has them.

Linux notes when a datagram came (``SO_TIMESTAMPNS``) by its wall clock. The process may have another idea of that
clock (libfaketime), so how far the two are apart is seen in the stamp of a datagram from a socket to itself: at
first, and whenever the clock of the process was stepped. Where that of the kernel was stepped as well, what came
meanwhile cannot be placed.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import sys
import time
from typing import NamedTuple

from nros_conformance.rmw.clock import MS

ANCILLARY = socket.CMSG_SPACE(struct.calcsize("@ll"))
"""Octets for `stamp_of` that ``recvmsg`` is to be given."""

_SO_TIMESTAMPNS = 35
"""Linux' ``SO_TIMESTAMPNS_OLD``, which ``socket`` does not name; the ancillary message has the same number."""

_TIMESPEC = struct.Struct("@ll")
_NUMBER = struct.Struct("@Q")

_SLEW = 1_000
"""A wall clock may be slewed by one part in a thousand (NTP: one in two thousand); what is more is a step."""

_GAP_NS = MS // 5
"""Between two datagrams that are to have stamps of their own."""

_TURN_ONS = 50
"""Linux turns its stamps on a moment after the first socket of the host has asked for them; how often to look."""

_TRIES = 3
_SHARP_NS = MS // 10
"""Between two looks at a clock it takes less than this, unless the thread has lost its core or the GIL."""


def ask_for_stamps(sock: socket.socket) -> None:
    """Have the kernel note arrivals, where it can."""
    if sys.platform == "linux":
        sock.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)


def stamp_of(ancillary: list[tuple[int, int, bytes]]) -> int | None:
    """The kernel's time of arrival, ns of its wall clock; None where it tells none."""
    for level, kind, value in ancillary:
        if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS and len(value) == _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack(value)
            return int(seconds) * 1_000 * MS + int(nanoseconds)
    return None


class _Bounds(NamedTuple):
    """What is known of a difference, ns."""

    low: int
    high: int

    def meets(self, other: _Bounds, slack_ns: int = 0) -> bool:
        return self.low <= other.high + slack_ns and other.low <= self.high + slack_ns

    def shifted(self, by_ns: int) -> _Bounds:
        return _Bounds(self.low + by_ns, self.high + by_ns)

    @property
    def width(self) -> int:
        return self.high - self.low


class KernelClock:
    """The wall clock of the kernel, seen from this process. It owns a socket."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind(("127.0.0.1", 0))
            self._socket.connect(self._socket.getsockname())
            self._socket.setblocking(False)
            ask_for_stamps(self._socket)
        except OSError:
            self._socket.close()
            raise
        self._number = 0
        self._await_stamps()
        self._process_ns, self._at_ns = _process_offset()
        self._ahead = self._compare()
        """By how much the kernel's clock is ahead of the process'; None: there are no stamps here."""

    def offset(self) -> int | None:
        """Nanoseconds by which stamps since the last call were ahead of ``CLOCK_MONOTONIC``.

        None: there are no stamps here, or the clock was stepped since then.
        """
        former_ns, former_at_ns = self._process_ns, self._at_ns
        self._process_ns, self._at_ns = _process_offset()
        if self._ahead is None:
            return None
        slack_ns = MS + (self._at_ns - former_at_ns) // _SLEW
        former = self._ahead
        if abs(self._process_ns - former_ns) > slack_ns:
            self._ahead = self._compare()
            if self._ahead is None:
                return None
            if not self._ahead.shifted(self._process_ns).meets(former.shifted(former_ns), slack_ns):
                return None
        elif former.width > _SHARP_NS:
            again = self._compare()
            if again is not None and again.meets(former):
                self._ahead = _Bounds(max(again.low, former.low), min(again.high, former.high))
        return self._process_ns + self._ahead.low

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _await_stamps(self) -> None:
        """Until arrivals are noted. What came before has the time of its reading, so that two have the same."""
        for _ in range(_TURN_ONS):
            with contextlib.suppress(BlockingIOError):  # one of them is not here yet
                self._socket.send(_NUMBER.pack(0))
                time.sleep(_GAP_NS / 1e9)
                self._socket.send(_NUMBER.pack(0))
                first, second = (stamp_of(self._socket.recvmsg(_NUMBER.size, ANCILLARY)[1]) for _ in range(2))
                if first is None or second is None or second - first >= _GAP_NS:
                    return

    def _compare(self) -> _Bounds | None:
        best: _Bounds | None = None
        for _ in range(_TRIES):
            self._number += 1
            begin_ns = time.time_ns()
            with contextlib.suppress(BlockingIOError):
                self._socket.send(_NUMBER.pack(self._number))
            end_ns = time.time_ns()
            stamp_ns = self._receive()
            if stamp_ns is None or end_ns < begin_ns:
                continue
            found = _Bounds(stamp_ns - end_ns, stamp_ns - begin_ns)
            if best is None or found.width < best.width:
                best = found
            if found.width <= _SHARP_NS:
                break
        return best

    def _receive(self) -> int | None:
        """The stamp of what was just sent. Loopback delivers within the sending; a busy kernel may be later."""
        with contextlib.suppress(BlockingIOError):
            while True:
                data, ancillary, _, _ = self._socket.recvmsg(_NUMBER.size, ANCILLARY)
                if _NUMBER.unpack(data)[0] == self._number:
                    return stamp_of(ancillary)
        return None


def _process_offset() -> tuple[int, int]:
    """The process' wall clock minus ``CLOCK_MONOTONIC``, and when that was."""
    best: tuple[int, int, int] | None = None
    for _ in range(_TRIES):
        begin_ns, wall_ns, end_ns = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        if best is None or end_ns - begin_ns < best[0]:
            best = (end_ns - begin_ns, wall_ns - end_ns, end_ns)
        if best[0] <= _SHARP_NS:
            break
    assert best is not None
    return best[1], best[2]
