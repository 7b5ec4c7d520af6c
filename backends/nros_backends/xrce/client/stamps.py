"""The kernel's stamps of arrival, as ``CLOCK_MONOTONIC`` has them.

Linux notes when a datagram came (``SO_TIMESTAMPNS``) by its wall clock. What that clock shows now is not asked
of the process, whose idea of the wall clock may be another one, but seen in the stamp of a datagram that goes from
a socket to itself. A step of the clock changes the difference; what came meanwhile cannot be placed then.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import sys
import time

from nros_conformance.rmw.clock import MS

ANCILLARY = socket.CMSG_SPACE(struct.calcsize("@ll"))
"""Octets for `stamp_of` that ``recvmsg`` is to be given."""

_SO_TIMESTAMPNS = 35
"""Linux' ``SO_TIMESTAMPNS_OLD``, which ``socket`` does not name; the ancillary message has the same number."""

_TIMESPEC = struct.Struct("@ll")
_NUMBER = struct.Struct("@Q")

_SLEW = 1_000
"""A wall clock may be slewed by one part in a thousand (NTP: one in two thousand); what is more is a step."""

_TRIES = 3
_SHARP_NS = MS // 4
"""A sending that takes longer places its stamp badly; it takes some 10 us unless the thread loses its core."""


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
        self._offset_ns: int | None = None
        self.compared_ns = 0
        """When `offset` was asked last."""
        self.offset()

    def offset(self) -> int | None:
        """Nanoseconds by which stamps since the last call were ahead of ``CLOCK_MONOTONIC``.

        None: there are no stamps here, or the clock was stepped since then.
        """
        former_ns, former_at_ns = self._offset_ns, self.compared_ns
        self._offset_ns = self._compare()
        self.compared_ns = time.monotonic_ns()
        if former_ns is None or self._offset_ns is None:
            return None
        allowed_ns = MS + (self.compared_ns - former_at_ns) // _SLEW
        return self._offset_ns if abs(self._offset_ns - former_ns) <= allowed_ns else None

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _compare(self) -> int | None:
        """A stamp minus the end of the sending that it falls into: late by the time of that at most."""
        best: tuple[int, int] | None = None
        for _ in range(_TRIES):
            self._number += 1
            begin_ns = time.monotonic_ns()
            with contextlib.suppress(BlockingIOError):
                self._socket.send(_NUMBER.pack(self._number))
            end_ns = time.monotonic_ns()
            stamp_ns = self._receive()
            if stamp_ns is None:
                continue
            took_ns = end_ns - begin_ns
            if best is None or took_ns < best[0]:
                best = (took_ns, stamp_ns - end_ns)
            if took_ns <= _SHARP_NS:
                break
        return None if best is None else best[1]

    def _receive(self) -> int | None:
        """The stamp of what was just sent. Loopback delivers within the sending; a busy kernel may be later."""
        with contextlib.suppress(BlockingIOError):
            while True:
                data, ancillary, _, _ = self._socket.recvmsg(_NUMBER.size, ANCILLARY)
                if _NUMBER.unpack(data)[0] == self._number:
                    return stamp_of(ancillary)
        return None
