"""The recorded conversations of eProsima's client and agent 3.0.1 (``data/README.md``)."""

from __future__ import annotations

import functools
import json
import zipfile
from pathlib import Path
from typing import NamedTuple

ARCHIVE = Path(__file__).parent / "data" / "conversations.zip"
NS_PER_MS = 1_000_000


class Datagram(NamedTuple):
    """``at_ns``: since the first of the file. ``peer``: which client endpoint. ``dropped``: sent, not delivered."""

    at_ns: int
    to_agent: bool
    payload: bytes
    note: str
    peer: int
    dropped: bool


class Event(NamedTuple):
    """Something done to the processes from outside."""

    at_ns: int
    text: str


class Conversation(NamedTuple):
    """One file."""

    name: str
    middleware: str
    events: tuple[Event, ...]
    datagrams: tuple[Datagram, ...]


@functools.cache
def conversations() -> dict[str, Conversation]:
    with zipfile.ZipFile(ARCHIVE) as archive:
        texts = {name.removesuffix(".jsonl"): archive.read(name).decode() for name in archive.namelist()}
    return {name: _conversation(name, text) for name, text in texts.items()}


def _conversation(name: str, text: str) -> Conversation:
    header, *lines = [json.loads(line) for line in text.splitlines()]
    return Conversation(
        name,
        header["agent_middleware"],
        tuple(Event(round(one["t_ms"] * NS_PER_MS), one["event"]) for one in header.get("events", ())),
        tuple(
            Datagram(
                round(line["t_ms"] * NS_PER_MS), line["dir"] == "c2a", bytes.fromhex(line["hex"]),
                line.get("note", ""), line.get("peer", 0), line.get("dropped", False),
            )
            for line in lines
        ),
    )  # fmt: skip
