"""The client's UDP socket, and when a datagram arrived at it.

The kernel notes the arrival of every datagram, so a sample that waits in the socket while nobody drives the
session is not taken for a late one (`stamps`). Where its clock was stepped meanwhile, or on other systems than
Linux, the time of reading stands in.
"""

from __future__ import annotations

import contextlib
import select
import socket
import time
from typing import NamedTuple

from nros_backends.xrce.client.stamps import ANCILLARY, KernelClock, ask_for_stamps, stamp_of
from nros_conformance.rmw.clock import MS

_DATAGRAM = 65_536

_RECEIVE_BUFFER = 2**20
"""Asked for; the kernel grants at most ``net.core.rmem_max``."""


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
    ask_for_stamps(sock)


class Transport:
    """Datagrams to and from one agent. It owns its socket; raises OSError, and closes it then."""

    def __init__(self, sock: socket.socket) -> None:
        try:
            self._kernel = KernelClock()
        except OSError:
            sock.close()
            raise
        self.socket = sock
        self._poll = select.poll()
        self._poll.register(sock, select.POLLIN)
        self.known_ns = time.monotonic_ns()
        """Up to when all arrivals are known: the socket had nothing more then."""

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
                data, ancillary, _, _ = self.socket.recvmsg(_DATAGRAM, ANCILLARY)
            except BlockingIOError:
                break
            except ConnectionRefusedError:
                continue  # the agent's port is closed: the silence will show it
            taken.append((data, stamp_of(ancillary)))
        now_ns = time.monotonic_ns()
        offset_ns = self._kernel.offset()
        arrived, floor_ns = [], before_ns
        for data, stamp_ns in taken:
            at_ns = now_ns if stamp_ns is None or offset_ns is None else stamp_ns - offset_ns
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
        """Close the sockets."""
        self.socket.close()
        self._kernel.close()
