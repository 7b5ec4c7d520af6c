"""Faults: of the link between a session and its agent (`proxy`), and of the adapter's counters.

They hit a node's link, so they last while its session is closed and opened anew. On a best-effort
stream an older message is discarded and a repeated one too, so a sample that is overtaken never
arrives, and one that is sent twice arrives once.
"""

from __future__ import annotations

import contextlib
import random
import socket
from collections.abc import Callable, Mapping
from typing import Any

from nros_backends.xrce.ends import End
from nros_backends.xrce.proxy import FREE, Rules
from nros_backends.xrce.publisher import XrcePublisher
from nros_backends.xrce.session import XrceSession
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.qos import Reliability

LOST = Rules(lost=True)

_RESEND: Mapping[str, Callable[[list[bytes]], list[bytes]]] = {
    "lose": lambda sent: [],
    "duplicate": lambda sent: [datagram for datagram in sent for _ in range(2)],
    "reorder": lambda sent: sent[-1:] + sent[:-1],
}


def inject(fault: str, arguments: Mapping[str, Any]) -> int:
    """`Backend.inject`."""
    match fault, arguments:
        case "lose" | "duplicate" | "reorder", {"entity": XrcePublisher() as publisher, "count": int(count)}:
            return _samples(publisher, count, arguments["publish"], _RESEND[fault])
        case "preset", {"entity": End() as end, "count": int(count), "kind": int(kind)} if kind == end.missed_kind:
            end.missed.preset(count)
            return ReturnCode.OK
        case "partition", {"session": XrceSession() as session}:
            return _rule(session, LOST, LOST)
        case "block", {"session": XrceSession() as session, "direction": str(direction)}:
            return _rule(session, LOST if direction == "out" else FREE, LOST if direction == "in" else FREE)
        case "delay", {"session": XrceSession() as session, "by_ns": int(by_ns)}:
            return _rule(session, Rules(late_ns=by_ns), FREE)
        case "stall", {"session": XrceSession() as session}:
            return _rule(session, Rules(held=True), FREE)
        case "heal", {"session": XrceSession() as session}:
            return _rule(session, FREE, FREE)
        case "inject", {"session": XrceSession() as session, "count": int(count)}:
            return _malformed(session, count, arguments.get("seed", 0))
    return ReturnCode.UNSUPPORTED


def _rule(session: XrceSession, out: Rules, into: Rules) -> int:
    session.attachment.link.rule(out, into)
    return ReturnCode.OK


def _samples(
    publisher: XrcePublisher, count: int, publish: Callable[[], int], resend: Callable[[list[bytes]], list[bytes]]
) -> int:
    """Publish, and have the datagrams lost, repeated or in another order. A reliable stream would repair it."""
    if publisher.closed:
        return ReturnCode.INVALID_ARGUMENT
    if publisher.qos.reliability is Reliability.RELIABLE:
        return ReturnCode.UNSUPPORTED
    proxy = publisher.session.attachment.proxy()
    with proxy.capturing() as sent:
        code = min(publish() for _ in range(count))
    for datagram in resend(sent):
        proxy.send_out(datagram)
    return code


def _malformed(session: XrceSession, count: int, seed: int) -> int:
    """Send what is no XRCE, or none of this session, to the client and to the agent.

    To the agent it goes from an endpoint without a session: from the client's own some of it would be
    requests of the session, as valid as any.
    """
    if session.closed:
        return ReturnCode.INVALID_ARGUMENT
    proxy = session.attachment.proxy()
    chance = random.Random(seed)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as foreign:
        foreign.setblocking(False)
        foreign.connect(session.attachment.link.agent)
        for number in range(count):
            datagram = malformed(chance, number)
            proxy.send_in(datagram)
            with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
                foreign.send(datagram)
    return ReturnCode.OK


def malformed(chance: random.Random, number: int) -> bytes:
    """One datagram that means nothing to a session 0x81: of ten sorts, in turn."""
    noise = chance.randbytes(chance.randrange(9, 400))
    stream = chance.choice((0x00, 0x01, 0x80))
    header = bytes((0x81, 0x00, 0, 0))
    match number % 10:
        case 0:
            return b""
        case 1:
            return header[: chance.randrange(1, 4)]
        case 2:  # another session's
            return bytes((0x82, stream, *chance.randbytes(2))) + noise
        case 3:  # a stream that was never opened
            return bytes((0x81, 0x7E, *chance.randbytes(2))) + noise
        case 4:  # a submessage longer than the datagram
            return header + bytes((9, 1)) + (40_000).to_bytes(2, "little") + noise
        case 5:  # DATA for a request that nobody made
            return header + bytes((9, 1, 12, 0, 0xFF, 0xF0, 0xFF, 0xF6)) + noise[:8]
        case 6:  # unknown submessages
            return header + bytes((0x40 + number % 64, 1, 4, 0)) + noise[:4]
        case 7:  # an ACKNACK about messages that were never sent, cut short
            return header + bytes((10, 1, 5, 0)) + noise[:3]
        case 8:  # a string without an end, in a CREATE
            return header + bytes((1, 1, 12, 0, 0, 10, 0, 0x11, 1, 1, 0, 0)) + b"\xff\xff\xff\x7f" + noise[:4]
    return bytes(9_000)
