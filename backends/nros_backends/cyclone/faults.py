"""Faults: a session's DDS domain is made deaf, mute or both, and malformed datagrams are sent to its ports.

What is sent while mute (``dds_domain_set_deafmute``) is gone; a reliable writer sends it again afterwards as
long as its history holds it, so that only best-effort samples are lost for certain.
"""

from __future__ import annotations

import random
import socket
from collections.abc import Callable, Mapping
from typing import Any

from nros_backends.cyclone.ear import GROUP, unicast_ports
from nros_backends.cyclone.malformed import malformed
from nros_backends.cyclone.publisher import CyclonePublisher
from nros_backends.cyclone.session import CycloneSession
from nros_conformance.rmw.codes import ReturnCode

_ANNOUNCED_S = 1.0
"""A participant announces itself when it begins to exist, and then several times per lease."""

_NO_WRITER, _NO_READER = b"\0\xff\xfe\x03", b"\0\xff\xfe\x04"
"""Where nobody has been matched."""


def inject(fault: str, arguments: Mapping[str, Any]) -> int:
    """`Backend.inject`: ``lose``, ``partition``, ``block``, ``heal`` and ``inject``."""
    match fault, arguments:
        case "lose", {"entity": CyclonePublisher() as publisher, "count": int(count), "publish": publish}:
            return _lose(publisher, count, publish)
        case "partition", {"session": CycloneSession() as session}:
            return session.deafmute(deaf=True, mute=True)
        case "block", {"session": CycloneSession() as session, "direction": str(direction)}:
            return session.deafmute(deaf=direction == "in", mute=direction == "out")
        case "heal", {"session": CycloneSession() as session}:
            return session.deafmute(deaf=False, mute=False)
        case "inject", {"session": CycloneSession() as session, "count": int(count)}:
            return _malformed(session, count, random.Random(arguments.get("seed", 0)))
    return ReturnCode.UNSUPPORTED


def _lose(publisher: CyclonePublisher, count: int, publish: Callable[[], int]) -> int:
    code = publisher.session.deafmute(deaf=False, mute=True)
    if code != ReturnCode.OK:
        return code
    try:
        return min(publish() for _ in range(count))
    finally:
        publisher.session.deafmute(deaf=False, mute=False)


def _malformed(session: CycloneSession, count: int, chance: random.Random) -> int:
    """Send them to the ports that the session has announced, and to its network's multicast port."""
    if session.closed:
        return ReturnCode.INVALID_ARGUMENT
    ear, name = session.ear, session.guid.bytes[:12]
    announcement = None if ear is None else ear.announcement(name, _ANNOUNCED_S)
    if ear is None or announcement is None:
        return ReturnCode.UNSUPPORTED
    publishers = [end for end in session.ends if isinstance(end, CyclonePublisher)]
    writers = [guid.bytes for end in session.ends if end not in publishers for guid in end.met()]
    readers = [guid.bytes for end in publishers for guid in end.met()]
    addresses = [("127.0.0.1", port) for port in unicast_ports(announcement)] + [(GROUP, ear.port)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        for datagram in malformed(
            writers or [name + _NO_WRITER], readers or [name + _NO_READER], announcement, chance, count
        ):
            for address in addresses:
                sender.sendto(datagram, address)
    return ReturnCode.OK
