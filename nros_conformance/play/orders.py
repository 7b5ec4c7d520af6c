"""What the player and a session in a process of its own say to each other: one JSON object a message."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import msgspec
from msgspec import Struct

from nros_conformance.play.plan import Plan
from nros_conformance.trace.records import AnyRecord


class Cast(Struct, frozen=True, tag="cast"):
    """First: which session to host, of which play."""

    plan: Plan
    session: str
    run_tag: int
    start: int
    """When the play began, ns."""
    locator: str
    first_sequence: int
    """What its publishers count from: a process that takes over goes on beyond the numbers of the one before."""


class Order(Struct, frozen=True, tag="order"):
    """Do this at ``due``, on the session's thread, and answer `Done` with the same ``number``.

    ``step`` and ``fault`` are those of the script with this ``label``; ``connect``, ``create``, ``destroy`` and
    ``matched`` (of ``entity``) are the player's own; ``pause`` and ``resume`` the background drive; ``clock``
    sets the wall clock to ``ahead_ns`` ahead, at once and beside the session's thread; ``end`` ends the process.
    """

    number: int
    what: Literal["connect", "create", "step", "fault", "destroy", "matched", "pause", "resume", "clock", "end"]
    due: int
    label: str = ""
    index: int = 0
    entity: str = ""
    ahead_ns: int = 0


class Ready(Struct, frozen=True, tag="ready"):
    """The cast was taken in: what takes long from here on is the backend's doing, not that of a process that starts."""


class Done(Struct, frozen=True, tag="done"):
    """An order was carried out."""

    number: int
    begin: int
    end: int
    result: Any = None


class Noted(Struct, frozen=True, tag="noted"):
    """A record for the trace."""

    record: AnyRecord


class Failed(Struct, frozen=True, tag="failed"):
    """The play cannot go on: ``outcome`` and ``detail`` of its end."""

    outcome: str
    detail: str


ToSession: TypeAlias = Cast | Order
FromSession: TypeAlias = Ready | Done | Noted | Failed

_ENCODER = msgspec.json.Encoder()
_TO: msgspec.json.Decoder[ToSession] = msgspec.json.Decoder(ToSession)
_FROM: msgspec.json.Decoder[FromSession] = msgspec.json.Decoder(FromSession)


def encode(message: ToSession | FromSession) -> bytes:
    """One message."""
    return _ENCODER.encode(message)


def decode_order(data: bytes) -> ToSession:
    """What the player said."""
    return _TO.decode(data)


def decode_answer(data: bytes) -> FromSession:
    """What the session's process said."""
    return _FROM.decode(data)
