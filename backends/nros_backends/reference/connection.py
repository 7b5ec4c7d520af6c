"""The half of a session that faces the peer: ping, links that break, and what the session notices of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from nros_backends.reference.link import Link
from nros_conformance.rmw.backend import Session, SessionOptions
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import Side
from nros_conformance.rmw.qos import is_finite

if TYPE_CHECKING:
    from nros_backends.reference.backend import ReferenceBackend, ReferencePublisher, ReferenceSubscription

LEASE_MS = 1000
"""The connection lease that is declared."""

LOOK_NS = 10 * MS
"""How often a call that waits for the agent looks for it."""


class ConnectedSession(Session):
    """A session at the simulated agent. Each method is one behaviour that a defective variant can replace."""

    def __init__(self, backend: ReferenceBackend, options: SessionOptions) -> None:
        self.backend = backend
        self.clock = backend.clock
        self.options = options
        self.signal = self.clock.signal()
        self.entities: list[ReferencePublisher | ReferenceSubscription] = []
        self.id = next(backend.ids)
        self.link = Link((options.connection_lease_ms or LEASE_MS) * MS)
        self.lost = False
        """Whether this session has noticed that its peer is gone."""
        self.await_peer()
        with backend.lock:
            backend.sessions[self.id] = self  # type: ignore[assignment]
            hard = options.hard_liveliness_ms * MS or None
            backend.agent.admit(self.id, self.link.lease, hard, self.clock.now_ns())

    @property
    def connected(self) -> bool:
        """Whether what this session sends is heard by a peer that knows it, and answered."""
        return self.link.open and self.backend.agent.knows(self.id)

    def answers_checks(self) -> bool:
        """Whether a hard liveliness ping reaches it and its answer comes back."""
        return self.link.open and not self.link.down

    def ping(self, timeout_ms: int, attempts: int = 1) -> int:
        if self.id not in self.backend.sessions:
            return ReturnCode.INVALID_ARGUMENT
        for _ in range(max(attempts, 1)):
            if self.probe(max(timeout_ms, 0) * MS):
                return ReturnCode.OK
        return ReturnCode.TIMEOUT

    def probe(self, timeout_ns: int) -> bool:
        """One ping: whether its own answer came in time. One that knows the session has to answer."""
        with self.backend.lock:
            self.backend.advance()
            if self.link.out and self.backend.agent.up:
                self.backend.agent.probes += 1
                self.backend.agent.hears(self.id, self.clock.now_ns())
            answered = self.connected and self.link.delay <= timeout_ns
        self.clock.wait(None, self.clock.now_ns() + (self.link.delay if answered else timeout_ns))
        return answered

    def await_peer(self) -> None:
        """Return when the agent answers; raises CONNECTION_FAILED after a lease in which it did not (CON-006)."""
        until = self.clock.now_ns() + self.link.lease
        while not (self.backend.agent.up and self.link.open and not self.lost):
            if self.lost or self.clock.now_ns() >= until:
                raise RmwError(ReturnCode.CONNECTION_FAILED, "the agent does not answer")
            self.clock.wait(None, min(until, self.clock.now_ns() + LOOK_NS))
            with self.backend.lock:
                self.backend.advance()

    def suffer(self, fault: str, arguments: Mapping[str, Any]) -> int:
        """A fault of the link."""
        with self.backend.lock:
            self.backend.advance()
            match fault, arguments.get("direction"):
                case "partition" | "freeze" | "crash", _:  # nothing is heard of it, and nothing reaches it
                    self.link.out = self.link.in_ = False
                case "block", "out":
                    self.link.out = False
                case "block", _:
                    self.link.in_ = False
                case "delay", _:
                    self.link.delay = arguments["by_ns"]
                case "heal" | "thaw", _:
                    self.link.out = self.link.in_ = True
                    self.link.delay = 0
                case _:
                    return ReturnCode.UNSUPPORTED
            self.link_changed()
        return ReturnCode.OK

    def link_changed(self) -> None:
        """Something about the way to the agent, or about the agent, has changed."""
        now = self.clock.now_ns()
        self.backend.agent.link(self.id, self.link.out, now)
        if not self.link.out:
            self.expire_leases(now)
        if self.connected:
            self.backend.tell(one for entity in self.entities for one in self.backend.world.rejoin(entity.id, now))
            self.link.silent_since, self.link.noticed, self.lost = None, False, False
        elif self.link.open and self.backend.agent.up:
            self.link.noticed = True  # the peer answers, and does not know it
            self.given_up(now, for_good=True)
            self.lose()
        elif self.link.silent_since is None:
            self.link.silent_since = now

    def expire_leases(self, at_ns: int) -> None:
        """Publishers that nobody hears of any more are lost after their own lease, if that is the shorter one."""
        cut = self.link.cuts = self.link.cuts + 1
        for entity in self.entities:
            lease_ns = entity.qos.lease_ms * MS

            def expire(entity: ReferencePublisher | ReferenceSubscription = entity) -> None:
                if self.link.cuts == cut and not self.link.out and entity in self.entities:
                    self.backend.tell(self.backend.world.part(entity.id, self.clock.now_ns()))

            if entity.side is Side.PUBLISHER and is_finite(entity.qos.lease_ms) and lease_ns < self.link.lease:
                self.backend.later(at_ns + lease_ns, expire)

    @property
    def notices_ns(self) -> int:
        """When it will notice that its peer is gone."""
        return self.link.lost_ns

    def notice(self, now_ns: int) -> None:
        """Nothing has come from the peer for the connection lease."""
        if self.notices_ns <= now_ns:
            self.link.noticed = True
            self.given_up(now_ns)
            self.lose()

    def lose(self) -> None:
        """From now on calls answer CONNECTION_FAILED."""
        self.lost = True
        self.signal.set()

    def given_up(self, at_ns: int, *, for_good: bool = False) -> None:
        """Its entities are out of reach for the others."""
        for entity in self.entities:
            self.backend.tell(self.backend.world.part(entity.id, at_ns, for_good=for_good))

    @property
    def code(self) -> int:
        """What calls answer that find nothing else wrong."""
        return ReturnCode.CONNECTION_FAILED if self.lost else ReturnCode.OK
