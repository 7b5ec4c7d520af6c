"""Between the sessions and the peer: links that break and heal, and the peer that is asked."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from nros_conformance.rmw.backend import Environment, Listed
from nros_conformance.rmw.clock import NEVER

if TYPE_CHECKING:
    from nros_backends.reference.backend import ReferenceBackend

ENDPOINT = "reference"


@dataclasses.dataclass(slots=True)
class Link:
    """The way between one session and the peer, and what the session knows of it. Times in ns."""

    lease: int
    out: bool = True
    in_: bool = True
    delay: int = 0
    """By how much what the session sends arrives later."""
    down: bool = False
    """Its process is frozen or dead: it calls nothing, and nothing reaches it."""
    stalled: bool = False
    """What it sends is held back."""
    silent_since: int | None = None
    """Since when nothing has come from the peer."""
    cuts: int = 0
    """How often the way out has been found broken."""
    noticed: bool = False
    """Whether that has lasted for the lease already."""

    @property
    def open(self) -> bool:
        """Whether something passes both ways."""
        return self.out and self.in_

    @property
    def lost_ns(self) -> int:
        """From when on the session knows that its peer is gone (CON-004, CON-007)."""
        return NEVER if self.silent_since is None or self.noticed else self.silent_since + self.lease


class ReferenceEnvironment(Environment):
    """The simulated agent of one backend. From the moment it is asked for, it runs when it is started."""

    def __init__(self, backend: ReferenceBackend) -> None:
        self._backend = backend
        backend.agent.stop()

    def start(self) -> None:
        with self._backend.lock:
            self._backend.agent.start()
            self._backend.peer_changed()

    def stop(self, *, kill: bool = False) -> None:
        with self._backend.lock:
            self._backend.agent.stop()
            self._backend.peer_changed()

    def endpoint(self) -> str:
        return ENDPOINT

    def entities(self) -> Sequence[Listed] | None:
        with self._backend.lock:
            return [
                Listed(entity.side, entity.topic)
                for entity in self._backend.entities.values()
                if self._backend.agent.knows(entity.session.id)
            ]

    def counts(self) -> Mapping[str, int]:
        with self._backend.lock:
            self._backend.advance()
            return {"checks": self._backend.agent.checks, "probes": self._backend.agent.probes}


@dataclasses.dataclass(order=True, slots=True)
class Delayed:
    """Something that arrives later."""

    at_ns: int
    order: int
    arrive: Callable[[], None] = dataclasses.field(compare=False)
