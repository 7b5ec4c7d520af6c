"""Faults: a `Tap` between a session and its bus, and malformed frames to go through it."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import can

from nros_backends.can.frames import EOT, SOT, SUBJECTS, TOGGLE, can_id, segment
from nros_backends.can.link import DATA_PRIORITY
from nros_backends.can.messages import ENDPOINT_SUBJECT, SIGN_SUBJECT, STATUS_SUBJECT
from nros_backends.can.policies import CAPACITY
from nros_backends.can.publisher import CanPublisher
from nros_backends.can.session import CanSession
from nros_backends.can.subscription import CanSubscription
from nros_backends.can.tap import Tap
from nros_conformance.rmw.codes import ReturnCode

_FOREIGN_NODE = 0
"""No session has this id."""


def inject(fault: str, arguments: Mapping[str, Any]) -> int:
    """`Backend.inject`."""
    match fault, arguments:
        case "lose", {"entity": CanPublisher() as publisher, "count": int(count), "publish": publish}:
            return _lose(publisher, count, publish)
        case "duplicate", {"entity": CanPublisher() as publisher, "count": int(count), "publish": publish}:
            return _duplicate(publisher, count, publish)
        case "preset", {"entity": CanPublisher() | CanSubscription() as entity, "count": int(count)}:
            with entity.session.lock:
                return entity.preset(arguments.get("kind"), count)
        case _, {"session": CanSession() as session}:
            return _of_session(fault, session, arguments)
    return ReturnCode.UNSUPPORTED


def _of_session(fault: str, session: CanSession, arguments: Mapping[str, Any]) -> int:
    tap = _tap(session)
    match fault, arguments:
        case "partition", _:
            tap.deaf = tap.mute = True
        case "block", {"direction": str(direction)}:
            tap.deaf, tap.mute = direction == "in", direction == "out"
        case "stall", _:
            tap.stalled = True
        case "delay", {"by_ns": int(by_ns)}:
            tap.delay_ns = by_ns
        case "bus_off", _:
            tap.bus_off()
        case "inject", {"count": int(count)}:
            tap.put(malformed(session, random.Random(arguments.get("seed", 0)), count))
        case "heal", _:
            tap.heal()
        case _:
            return ReturnCode.UNSUPPORTED
    return ReturnCode.OK


def _tap(session: CanSession) -> Tap:
    """The tap of a session, put in when it is needed first."""
    if not isinstance(session.link.bus, Tap):
        session.link.bus = Tap(session.link.bus, session.clock)
    return session.link.bus


def _identifier(publisher: CanPublisher) -> int:
    return can_id(DATA_PRIORITY, publisher.outlet.subject, publisher.session.node)


def _lose(publisher: CanPublisher, count: int, publish: Callable[[], int]) -> int:
    tap = _tap(publisher.session)
    tap.lost_id = _identifier(publisher)
    try:
        return min(publish() for _ in range(count))
    finally:
        tap.lost_id = None


def _duplicate(publisher: CanPublisher, count: int, publish: Callable[[], int]) -> int:
    tap = _tap(publisher.session)
    codes = []
    for _ in range(count):
        tap.copied_id = _identifier(publisher)
        try:
            codes.append(publish())
        finally:
            tap.copied_id = None
        copies, tap.copies = tap.copies, []
        for message in copies:
            tap.send(message)
    return min(codes)


def malformed(session: CanSession, chance: random.Random, count: int) -> Iterator[can.Message]:
    """``count`` frames that are no message of anybody: each kind in turn, with contents by ``chance``.

    Half of the kinds use the name and subject of a node that the session knows.
    """
    known = [
        (peer.node, port.subject)
        for peer in session.directory.peers.values()
        if peer.node != session.node
        for port in peer.ports.values()
    ] or [(_FOREIGN_NODE, 0)]
    tails = (ENDPOINT_SUBJECT, STATUS_SUBJECT, SIGN_SUBJECT)
    for index in range(count):
        node, subject = chance.choice(known)
        junk = chance.randbytes(7)
        tail = chance.randrange(32)
        whole = bytes((SOT | EOT | TOGGLE | tail,))
        ours = can_id(DATA_PRIORITY, subject, node)
        kinds: tuple[dict[str, Any], ...] = (
            {"arbitration_id": ours, "data": b""},
            {"arbitration_id": ours, "data": junk + bytes((SOT | EOT | tail,))},  # UAVCAN v0
            {"arbitration_id": ours, "data": junk + bytes((tail,))},  # the middle of nothing
            {"arbitration_id": ours, "data": junk + bytes((EOT | TOGGLE | tail,))},  # the end of nothing
            {"arbitration_id": ours, "data": segment(junk * 3, tail, 8)[0]},  # a beginning without an end
            {"arbitration_id": ours, "data": junk, "is_remote_frame": True},
            {"arbitration_id": ours & 0x7FF, "data": junk + whole, "is_extended_id": False},
            {"arbitration_id": ours | 1 << 7, "data": junk + whole},  # a reserved bit
            {"arbitration_id": ours | 1 << 25, "data": junk + whole},  # a service
            {"arbitration_id": ours | 1 << 24, "data": junk + whole},  # anonymous
            {"arbitration_id": chance.choice((0x04, 0x20)), "data": junk + b"\0", "is_error_frame": True},
            {"arbitration_id": can_id(7, chance.randrange(SUBJECTS), _FOREIGN_NODE), "data": junk + whole},
            {"arbitration_id": can_id(4, chance.choice(tails), node), "data": junk[:2] + whole},  # too short
            {"arbitration_id": can_id(4, ENDPOINT_SUBJECT, node), "data": b"\xff" + junk[:6] + whole},
            {"arbitration_id": ours, "data": bytes(63) + whole, "is_fd": True}
            if session.link.mtu == 8
            else {"arbitration_id": ours, "data": b"\xff\xff" + junk[:5] + whole, "is_fd": True},
        )
        yield can.Message(**kinds[index % len(kinds)], dlc=None, is_rx=True)
    # An endless transfer ends at the limit; its frames do not count, they are one packet that is too large.
    if count:
        node, subject = known[0]
        for data in segment(bytes(2 * CAPACITY), 0, 8)[:-1]:
            yield can.Message(arbitration_id=can_id(DATA_PRIORITY, subject, node), data=data, is_rx=True)
