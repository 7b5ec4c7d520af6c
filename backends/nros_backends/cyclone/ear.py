"""What the participants of a network announce of themselves on its multicast port: real datagrams, and locators.

DDSI-RTPS 2.3, 8.5.3: a participant announces itself (SPDP) as soon as it exists, and again and again.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import time

GROUP = "239.255.0.1"
"""Of RTPS' discovery (9.6.1.4.1)."""

_LOOPBACK = socket.inet_aton("127.0.0.1")
_KEPT = 256
"""Announcements; those of other networks may come by the same port."""

_HEADER_SIZE = 20
_SUBMESSAGE = struct.Struct("<BBH")
_DATA = 0x15
_BEFORE_PARAMETERS = 24
"""Of a DATA without inline QoS: its own fields, and the encapsulation of what it carries."""
_SENTINEL = 0x0001
_UNICAST_LOCATORS = (0x0031, 0x0032)
_LOCATOR = struct.Struct("<iI12x4s")
_UDP4 = 1


class Ear:
    """A member of the group of one network, which says nothing."""

    def __init__(self, port: int) -> None:
        self.port = port
        self._heard: dict[bytes, bytes] = {}
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._socket.bind((GROUP, port))
        self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(GROUP) + _LOOPBACK)
        self._socket.setblocking(False)

    def announcement(self, prefix: bytes, limit_s: float) -> bytes | None:
        """The last announcement of the participant with this GUID prefix, awaited if there was none so far."""
        until = time.monotonic() + limit_s
        while True:
            with contextlib.suppress(BlockingIOError):
                while True:
                    datagram = self._socket.recv(65_535)
                    if parameters(datagram) is not None:
                        self._heard.pop(datagram[8:_HEADER_SIZE], None)
                        self._heard[datagram[8:_HEADER_SIZE]] = datagram
                        if len(self._heard) > _KEPT:
                            del self._heard[next(iter(self._heard))]
            if prefix in self._heard or time.monotonic() >= until:
                return self._heard.get(prefix)
            time.sleep(0.001)

    def close(self) -> None:
        """Leave the group."""
        self._socket.close()


def parameters(datagram: bytes) -> int | None:
    """Where the parameter list of an announcement begins; None in a datagram that is none."""
    place = _HEADER_SIZE
    while place + _SUBMESSAGE.size <= len(datagram):
        kind, _, length = _SUBMESSAGE.unpack_from(datagram, place)
        if kind == _DATA:
            begin = place + _SUBMESSAGE.size + _BEFORE_PARAMETERS
            return begin if begin <= len(datagram) else None
        place += _SUBMESSAGE.size + length
    return None


def unicast_ports(datagram: bytes) -> list[int]:
    """The UDP ports at which the announcing participant says that it listens."""
    place, ports = parameters(datagram), []
    while place is not None and place + 4 <= len(datagram):
        name, length = struct.unpack_from("<HH", datagram, place)
        if name == _SENTINEL:
            break
        if name in _UNICAST_LOCATORS and length == _LOCATOR.size:
            kind, port, _ = _LOCATOR.unpack_from(datagram, place + 4)
            ports += [port] if kind == _UDP4 else []
        place += 4 + length
    return list(dict.fromkeys(ports))
