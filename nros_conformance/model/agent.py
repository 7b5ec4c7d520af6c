"""The peer as a pure state machine: the clients that it knows, and those that it gives up.

As in `world`, actions go in with their time and what the peer does comes out. Times are nanoseconds. The hard
liveliness check is modelled on the Micro XRCE-DDS agent: once a client has been silent for its timeout it is
pinged three times, 200 ms apart, and removed 200 ms after the last one. Whatever is heard of a client counts as a
sign of life, so that nobody is pinged who sends data (CON-009).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Literal, NamedTuple

from nros_conformance.model.world import Id
from nros_conformance.rmw.clock import MS, NEVER

CHECKS = 3
"""Hard liveliness pings without an answer before a client is removed."""

CHECK_EVERY = 200 * MS


class Ruling(NamedTuple):
    """What the peer decides about a client: ``lost`` for as long as it is not heard, ``removed`` for good."""

    at_ns: int
    client: Id
    what: Literal["lost", "removed"]


@dataclasses.dataclass(slots=True)
class _Client:
    lease: int
    hard: int | None
    heard: int
    checks: int = 0
    """Pings since it was heard."""
    cut: int | None = None
    """Since when its link has been down."""
    lost: bool = False

    @property
    def due(self) -> int:
        """When the peer does something about it next."""
        if self.hard is not None:
            return self.heard + self.hard + self.checks * CHECK_EVERY
        if self.cut is None or self.lost:
            return NEVER
        return self.cut + self.lease


class Agent:
    """Clients by identity. ``answers(client)``: whether a ping reaches it and its answer comes back."""

    def __init__(self, answers: Callable[[Id], bool]) -> None:
        self.up = True
        self.checks = 0
        """Hard liveliness pings sent so far."""
        self.probes = 0
        """Pings of clients so far."""
        self._answers = answers
        self._clients: dict[Id, _Client] = {}

    def stop(self) -> None:
        """It ends, and what it knew with it."""
        self.up = False
        self._clients.clear()

    def start(self) -> None:
        """A new one, which knows nobody."""
        self.up = True

    def admit(self, client: Id, lease_ns: int, hard_ns: int | None, at_ns: int) -> None:
        """A session begins."""
        self._clients[client] = _Client(lease_ns, hard_ns, at_ns)

    def leave(self, client: Id) -> None:
        """A session ends in an orderly way."""
        self._clients.pop(client, None)

    def knows(self, client: Id) -> bool:
        """Whether this session exists here: after a restart it does not (CON-004)."""
        return client in self._clients

    def hears(self, client: Id, at_ns: int) -> None:
        """Anything came of a client."""
        if client in self._clients:
            self._clients[client].heard = at_ns
            self._clients[client].checks = 0

    def link(self, client: Id, up: bool, at_ns: int) -> bool:
        """The way from a client broke, or is back; whether the client was lost and is not any more."""
        known = self._clients.get(client)
        if known is None:
            return False
        if not up:
            known.cut = at_ns if known.cut is None else known.cut
            return False
        found, known.cut, known.lost = known.lost, None, False
        return found

    @property
    def next_due_ns(self) -> int:
        """When it does something by itself next; `NEVER` if nothing."""
        return min((client.due for client in self._clients.values()), default=NEVER)

    def advance(self, now_ns: int) -> Iterator[Ruling]:
        """Let time pass: pings, and clients given up by ``now_ns``, oldest first."""
        while (due := self.next_due_ns) <= now_ns:
            for id_, client in list(self._clients.items()):
                if client.due != due:
                    continue
                if client.hard is None:
                    client.lost = True
                    yield Ruling(due, id_, "lost")
                elif client.checks < CHECKS:
                    self._check(id_, client, due)
                else:
                    del self._clients[id_]
                    yield Ruling(due, id_, "removed")

    def _check(self, id_: Id, client: _Client, at_ns: int) -> None:
        client.checks += 1
        self.checks += 1
        if self._answers(id_):
            self.hears(id_, at_ns)
