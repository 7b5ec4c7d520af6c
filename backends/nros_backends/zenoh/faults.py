"""Faults: what the proxies do to frames, what a publisher puts twice or late, and malformed input."""

from __future__ import annotations

import contextlib
import random
import socket
import struct
from collections.abc import Callable, Mapping
from typing import Any

from nros_backends.zenoh import keys
from nros_backends.zenoh.attachment import find_number
from nros_backends.zenoh.config import tcp_address
from nros_backends.zenoh.ends import End
from nros_backends.zenoh.network import Network
from nros_backends.zenoh.publisher import ZenohPublisher
from nros_backends.zenoh.session import ZenohSession
from nros_conformance.rmw.codes import ReturnCode

WIRE_FAULTS = frozenset({"lose", "reorder", "partition", "block", "delay", "stall", "heal"})
"""Those that take proxies."""


class Faults:
    """`Backend.inject`. ``sessions`` are those of the backend."""

    def __init__(self, network: Network, sessions: Callable[[], list[ZenohSession]]) -> None:
        self._network = network
        self._sessions = sessions

    def inject(self, fault: str, arguments: Mapping[str, Any]) -> int:
        """OK, or why not: UNSUPPORTED where a connection does not pass a proxy of this process."""
        match fault, arguments:
            case "lose", {"entity": ZenohPublisher() as publisher, "count": int(count), "publish": publish}:
                return self._lose(publisher, count, publish)
            case "duplicate", {"entity": ZenohPublisher() as publisher, "count": int(count), "publish": publish}:
                publisher.repeat = 2
                try:
                    return _worst(publish, count)
                finally:
                    publisher.repeat = 1
            case "reorder", {"entity": ZenohPublisher() as publisher, "count": int(count), "publish": publish}:
                return self._reorder(publisher, count, publish)
            case "preset", {"entity": End() as end, "kind": int(kind), "count": int(count)}:
                return end.preset(kind, count)
            case "preset", {"entity": End() as end, "kind": None, "count": int(count)}:
                return self._preset(end, count)
            case _, {"session": ZenohSession() as session}:
                return self._on_wire(fault, session, arguments)
        return ReturnCode.UNSUPPORTED

    def _on_wire(self, fault: str, session: ZenohSession, arguments: Mapping[str, Any]) -> int:
        if fault == "inject":
            return self._malformed(session, arguments["count"], random.Random(arguments["seed"]))
        if not self._network.whole(session):
            return ReturnCode.UNSUPPORTED
        match fault, arguments:
            case "heal", _:
                self._network.release(session)
                return ReturnCode.OK
            case "partition", _:
                for sent, received in self._network.flows(session):
                    sent.held = received.held = True
                return ReturnCode.OK
            case "block", {"direction": str(direction)}:
                for sent, received in self._network.flows(session):
                    (sent if direction == "out" else received).held = True
                return ReturnCode.OK
            case "delay", {"by_ns": int(by_ns)}:
                for sent, received in self._network.flows(session):
                    sent.delay_ns = received.delay_ns = by_ns
                return ReturnCode.OK
            case "stall", _:
                for _, received in self._network.flows(session):
                    received.halve = True
                return ReturnCode.OK
        return ReturnCode.UNSUPPORTED

    def _lose(self, publisher: ZenohPublisher, count: int, publish: Callable[[], int]) -> int:
        if not self._network.whole(publisher.session):
            return ReturnCode.UNSUPPORTED
        numbers = range(publisher.next_number, publisher.next_number + count)
        gid = publisher.token.gid

        def wanted(frame: bytes) -> bool:
            return find_number(frame, gid) in numbers

        # They stay: the frames may still be on their way, and no later one has these numbers.
        for sent, _ in self._network.flows(publisher.session):
            sent.filters = (*sent.filters, wanted)
        return _worst(publish, count)

    def _reorder(self, publisher: ZenohPublisher, count: int, publish: Callable[[], int]) -> int:
        """The proxies let go of all at once: on a busy host putting one after the other takes its time."""
        flows = [sent for sent, _ in self._network.flows(publisher.session)]
        publisher.reorder = []
        try:
            return _worst(publish, count)
        finally:
            for sent in flows:
                sent.held = True
            publisher.flush()
            self._network.release(publisher.session)

    def _preset(self, end: End, count: int) -> int:
        """The numbers of all publishers of the topic, at both ends."""
        sessions = [session for session in self._sessions() if session.domain == end.session.domain]
        publishers = [
            publisher
            for session in sessions
            for publisher in session.publishers()
            if publisher.token.topic == end.token.topic
        ]
        if end.closed or not publishers:
            return ReturnCode.INVALID_ARGUMENT
        for publisher in publishers:
            publisher.next_number = count + 1
            for session in sessions:
                for subscription in session.subscriptions():
                    subscription.follow(publisher.token.gid, count)
        return ReturnCode.OK

    def _malformed(self, session: ZenohSession, count: int, chance: random.Random) -> int:
        """Bytes that are no zenoh at its port, or the router's, and samples and tokens that are none of rmw's."""
        addresses = [("127.0.0.1", port) for port in self._network.ports(session)]
        router = tcp_address(session.locator)
        for address in addresses or ([router] if router else []):
            for _ in range(count):
                _garbage(address, chance)
        foreign = self._network.join(self, session.locator, session.lease_ms).session
        try:
            for subscription in session.subscriptions():
                data_key = keys.data_key(session.domain, subscription.topic, subscription.type_name)
                for _ in range(count):
                    foreign.put(data_key, chance.randbytes(chance.randrange(64)), attachment=_attachment(chance))
                foreign.delete(data_key)
                foreign.put(data_key, b"without an attachment")
            for _ in range(count):
                token = foreign.liveliness().declare_token(_token(session.domain, chance))
                token.undeclare()
        finally:
            self._network.leave(self)
        return ReturnCode.OK


def _worst(publish: Callable[[], int], count: int) -> int:
    """Publish so often; OK, or the worst answer."""
    return min(publish() for _ in range(count))


def _garbage(address: tuple[str, int], chance: random.Random) -> None:
    """A connection of somebody who does not speak zenoh: random frames, or a length without its bytes."""
    body = chance.randbytes(chance.randrange(1, 200))
    length = chance.choice([len(body), 0, 0xFFFF, chance.randrange(0x10000)])
    with contextlib.suppress(OSError), socket.create_connection(address, timeout=1.0) as connection:
        connection.sendall(struct.pack("<H", length) + body)


def _attachment(chance: random.Random) -> bytes:
    """Any length but those that are one."""
    return chance.randbytes(chance.choice([0, 1, 8, 16, 17, 32, 34, 36, 38, 64, 76, 78, 200]))


def _token(domain: int, chance: random.Random) -> str:
    """A token with too few or too many fields, an unknown kind, or numbers that are none."""
    words = [str(domain), *(f"x{chance.randrange(2**32):x}" for _ in range(chance.randrange(1, 16)))]
    if len(words) > 4 and chance.random() < 0.5:
        words[4] = chance.choice(["MP", "MS", "NN", "SS", "XX"])
    return "/".join([keys.TOKENS, *words])
