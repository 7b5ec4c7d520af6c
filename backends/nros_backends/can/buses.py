"""Which bus a session gets: python-can's own kinds, one of them bound to loopback, or a ready-made one.

Without options it is ``virtual``, python-can's bus in memory, or, when a play has sessions in several
processes, ``udp_multicast`` on loopback. Options: ``interface``, ``channel`` and whatever else the
interface's constructor takes (``bitrate``, ``port``...); ``fd``: "true" for CAN FD; ``subjects``:
``topic=1234,other=77``, Cyphal subjects fixed by hand; ``node``: the id of the first session.
"""

from __future__ import annotations

import dataclasses
import errno
import socket
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import can
from can.interfaces.udp_multicast.bus import SO_TIMESTAMPNS, GeneralPurposeUdpMulticastBus, UdpMulticastBus
from can.interfaces.virtual import VirtualBus

from nros_backends.can.frames import MTU_CLASSIC, MTU_FD
from nros_conformance.rmw.backend import Host
from nros_conformance.rmw.codes import ReturnCode, RmwError

DOMAINS = 2
"""A scenario's own domain and its neighbour."""

_RECEIVE_BUFFER = 2**22
"""Bytes asked of the kernel; the default drops frames of a burst after 256 datagrams."""

_GROUP = "239.74.163.{}"
_GROUPS = range(10, 250)
_DEFAULT_PORTS = range(43113, 43115)
_REMEDIES = {
    errno.EAFNOSUPPORT: "the kernel has no CAN sockets here; try: sudo modprobe -a can_raw vcan",
    errno.ENODEV: "try: sudo ip link add dev {channel} type vcan && sudo ip link set {channel} up",
    errno.ENETDOWN: "try: sudo ip link set {channel} up",
}
"""For socketcan."""

_OURS = ("virtual", "udp_multicast")
"""Interfaces that need nothing of the machine."""

_OWN_OPTIONS = frozenset({"fd", "subjects", "interface", "channel", "node"})


@dataclasses.dataclass(frozen=True, slots=True)
class Wiring:
    """A bus, and what has to be known of it."""

    bus: can.BusABC
    mtu: int
    echoes: bool = False
    """Whether it hands out what was sent by itself."""
    monotonic: bool = False
    """Whether time stamps are those of the sending session's clock."""


class LoopbackMulticastBus(UdpMulticastBus):
    """``udp_multicast`` that neither joins nor sends on any interface but loopback."""

    def __init__(self, channel: str, port: int, fd: bool = True) -> None:
        can.BusABC.__init__(self, channel)
        self.channel_info = f"{channel}:{port} on loopback"
        self._multicast = _LoopbackSocket(channel, port, 0)
        self._can_protocol = can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20


class _LoopbackSocket(GeneralPurposeUdpMulticastBus):
    def _create_socket(self, address_family: socket.AddressFamily) -> socket.socket:
        loopback = socket.inet_aton("127.0.0.1")
        made = socket.socket(address_family, socket.SOCK_DGRAM)
        try:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
            made.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
            self.timestamp_nanosecond = True
            made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, struct.pack("@I", self.hop_limit))
            made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, loopback)
            # To the group, not to any address: other groups may use the port as well.
            made.bind((self.group, self.port))
            made.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(self.group) + loopback)
        except OSError as error:
            made.close()
            raise can.CanInitializationError(f"{self.group}:{self.port} on loopback: {error}") from error
        return made


class Buses:
    """Opens the buses of one play: sessions of one domain meet, others do not."""

    def __init__(self, host: Host, ready: can.BusABC | None = None) -> None:
        self._host = host
        self._ready = ready
        options = dict(host.options)
        self.fd = flag(options.pop("fd", "false"), "fd")
        self.interface = options.pop("interface", "udp_multicast" if host.processes else "virtual")
        self._channel = options.pop("channel", "")
        self._rest = {name: _plain(value) for name, value in options.items() if name not in _OWN_OPTIONS}
        self._token = f"nros-conformance {id(self):x}"

    @property
    def scratch(self) -> Path | None:
        """Where sessions of several processes keep apart, None when all live in this one."""
        return self._host.scratch if self._host.processes else None

    def check(self) -> None:
        """Whether a bus of the machine is there, before anything is played on it. Raises `RmwError` as `open`."""
        if self._ready is None and self.interface not in _OURS:
            self.open(0).bus.shutdown()

    def open(self, domain: int) -> Wiring:
        """A new bus object. Raises `RmwError` CONNECTION_FAILED, INVALID_CONFIG."""
        mtu = MTU_FD if self.fd else MTU_CLASSIC
        if self._ready is not None:
            bus, self._ready = self._ready, None  # the next session needs one of its own
            return Wiring(bus, mtu, echoes=isinstance(bus, UdpMulticastBus))
        try:
            if self.interface == "virtual":
                channel = f"{self._channel or self._token} {domain}"
                return Wiring(VirtualBus(channel, preserve_timestamps=True), mtu, monotonic=True)
            if self.interface == "udp_multicast":
                group, port = self.address(domain)
                return Wiring(LoopbackMulticastBus(group, port, self.fd), mtu, echoes=True)
            arguments: dict[str, Any] = {**self._rest, "fd": self.fd}
            made = can.Bus(channel=self._channel_of(domain) or None, interface=self.interface, **arguments)
            return Wiring(made, mtu, echoes=isinstance(made, UdpMulticastBus))
        except (can.CanError, OSError, ValueError, TypeError) as error:
            raise RmwError(ReturnCode.CONNECTION_FAILED, f"{self.interface}: {error}{self._remedy(error)}") from error

    def _channel_of(self, domain: int) -> str:
        """One channel for each domain. Raises `RmwError` INVALID_CONFIG for a domain without."""
        channels = self._channel.split(",")
        if domain >= len(channels):
            what = f"{self.interface}: no channel for domain {domain}; give one for each, such as channel=can0,can1"
            raise RmwError(ReturnCode.INVALID_CONFIG, what)
        return channels[domain]

    def _remedy(self, error: Exception) -> str:
        """What brings the interface, where that is known."""
        remedy = _REMEDIES.get(getattr(error, "errno", None) or 0) if self.interface == "socketcan" else None
        return f"; {remedy.format(channel=self._channel.partition(',')[0] or 'vcan0')}" if remedy else ""

    def address(self, domain: int) -> tuple[str, int]:
        """Group and port on loopback: unique for this play and domain."""
        host = self._host
        ports = host.ports if len(host.ports) else _DEFAULT_PORTS
        place = host.network * DOMAINS + domain
        port = self._rest.get("port", ports[place % len(ports)])
        return self._channel or _GROUP.format(_GROUPS[place % len(_GROUPS)]), int(port)


def flag(text: str, name: str) -> bool:
    """An option that is "true" or "false". Raises `RmwError` INVALID_CONFIG."""
    if text not in ("true", "false"):
        raise RmwError(ReturnCode.INVALID_CONFIG, f'{name} is {text!r}: give "true" or "false"')
    return text == "true"


def subject_table(options: Mapping[str, str]) -> dict[str, int]:
    """Subjects fixed by hand, by topic. Raises `RmwError` INVALID_CONFIG, also when two topics share one."""
    table: dict[str, int] = {}
    for entry in filter(None, options.get("subjects", "").split(",")):
        topic, _, number = entry.strip().partition("=")
        if not number.isdecimal() or int(number) > SUBJECT_MAX:
            raise RmwError(
                ReturnCode.INVALID_CONFIG, f"subjects: {entry.strip()!r} is not topic=subject, 0 to {SUBJECT_MAX}"
            )
        other = next((one for one, subject in table.items() if subject == int(number)), None)
        if other is not None:
            raise RmwError(ReturnCode.INVALID_CONFIG, f"subjects: {other!r} and {topic!r} share subject {number}")
        table[topic.removeprefix("/")] = int(number)
    return table


SUBJECT_MAX = 6140
"""The free range (0 to 6143) without what `messages` takes of it."""


def _plain(text: str) -> str | int:
    return int(text) if text.isdecimal() else text
