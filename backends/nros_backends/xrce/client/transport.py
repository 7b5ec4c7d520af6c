"""The client's UDP socket, and when a datagram arrived at it.

The kernel notes the arrival of every datagram (``SO_TIMESTAMPNS``), so a sample that waits in the
socket while nobody drives the session is not taken for a late one. It notes it by the wall clock;
`Transport` turns that into monotonic time, and where the wall clock was stepped meanwhile, or on other
systems than Linux, the time of reading stands in.
"""

from __future__ import annotations

import contextlib
import select
import socket
import struct
import sys
import time
from typing import NamedTuple

from nros_conformance.rmw.clock import MS

_SO_TIMESTAMPNS = 35
"""Linux' ``SO_TIMESTAMPNS_OLD``, which ``socket`` does not name; the ancillary message has the same number."""

_TIMESPEC = struct.Struct("@ll")
_DATAGRAM = 65_536
_ANCILLARY = socket.CMSG_SPACE(_TIMESPEC.size)

_RECEIVE_BUFFER = 2**20
"""Asked for; the kernel grants at most ``net.core.rmem_max``."""

_SLEW = 1_000
"""A wall clock may be slewed by one part in a thousand (NTP: one in two thousand); what is more is a step."""


class Arrived(NamedTuple):
    """A datagram and when it came, ``CLOCK_MONOTONIC`` ns."""

    data: bytes
    at_ns: int


def open_socket(agent: tuple[str, int]) -> socket.socket:
    """A UDP socket of its own endpoint, connected to the agent; raises OSError."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.connect(agent)
        prepare(sock)
    except OSError:
        sock.close()
        raise
    return sock


def prepare(sock: socket.socket) -> None:
    """What the client wants of its socket: no blocking, room, times of arrival."""
    sock.setblocking(False)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
    if sys.platform == "linux":
        sock.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)


class Transport:
    """Datagrams to and from one agent. It owns its socket."""

    def __init__(self, sock: socket.socket) -> None:
        self.socket = sock
        self._poll = select.poll()
        self._poll.register(sock, select.POLLIN)
        self.known_ns = time.monotonic_ns()
        """Up to when all arrivals are known: the socket had nothing more then."""
        self._offset_at_ns = self.known_ns
        self._offset_ns = time.time_ns() - self.known_ns

    def send(self, data: bytes) -> None:
        """Send one datagram. What the kernel has no room for, or no port takes, is lost, as UDP may lose it."""
        with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
            self.socket.send(data)

    def receive(self, limit: int) -> list[Arrived]:
        """What has arrived, at most ``limit`` datagrams, in that order; see `known_ns`."""
        taken: list[tuple[bytes, int | None]] = []
        before_ns, asked_ns = self.known_ns, time.monotonic_ns()
        while len(taken) < limit:
            asked_ns = time.monotonic_ns()
            try:
                data, ancillary, _, _ = self.socket.recvmsg(_DATAGRAM, _ANCILLARY)
            except BlockingIOError:
                break
            except ConnectionRefusedError:
                continue  # the agent's port is closed: the silence will show it
            taken.append((data, _stamp(ancillary)))
        now_ns = time.monotonic_ns()
        offset_ns = time.time_ns() - now_ns
        stepped = abs(offset_ns - self._offset_ns) > MS + (now_ns - self._offset_at_ns) // _SLEW
        self._offset_ns, self._offset_at_ns = offset_ns, now_ns
        arrived, floor_ns = [], before_ns
        for data, wall_ns in taken:
            at_ns = now_ns if wall_ns is None or stepped else wall_ns - offset_ns
            floor_ns = min(max(at_ns, floor_ns), now_ns)
            arrived.append(Arrived(data, floor_ns))
        self.known_ns = asked_ns if len(taken) < limit else floor_ns
        return arrived

    def wait(self, timeout_ns: int) -> bool:
        """Until a datagram is there, at most so long; whether one is."""
        return bool(self._poll.poll(max(timeout_ns, 0) / MS))

    def use(self, sock: socket.socket) -> None:
        """Go on with another socket, and leave the former one to the caller."""
        prepare(sock)
        self._poll.unregister(self.socket)
        self._poll.register(sock, select.POLLIN)
        self.socket = sock

    def close(self) -> None:
        """Close the socket."""
        self.socket.close()


def _stamp(ancillary: list[tuple[int, int, bytes]]) -> int | None:
    """The wall clock's time of arrival, ns; None where the kernel tells none."""
    for level, kind, value in ancillary:
        if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS and len(value) == _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack(value)
            return int(seconds) * 1_000 * MS + int(nanoseconds)
    return None
