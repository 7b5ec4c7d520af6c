"""`World` behind the contract: sessions share it, and are told what occurred when they are driven."""

from __future__ import annotations

import heapq
import threading
from collections.abc import Callable, Iterable
from itertools import count
from typing import Any

from nros_backends.reference.entities import ReferencePublisher, ReferenceSubscription
from nros_backends.reference.link import Delayed, ReferenceEnvironment
from nros_backends.reference.session import ReferenceSession
from nros_conformance.model.agent import Agent
from nros_conformance.model.world import Occurrence, World
from nros_conformance.rmw.backend import Backend, Host, Publisher, SessionOptions, Subscription
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import Side

__all__ = ["ReferenceBackend", "ReferencePublisher", "ReferenceSession", "ReferenceSubscription"]


class ReferenceBackend(Backend):
    """One world, and one agent, for all sessions of a scenario. Without `environment` the agent is always there.

    The types and small methods below are what a defective variant replaces.
    """

    world_type: type[World] = World
    agent_type: type[Agent] = Agent

    def __init__(self, host: Host) -> None:
        super().__init__(host)
        self.clock = host.clock
        self.world = self.world_type()
        # On the real clock, where the control runs a planted defect, sessions are threads.
        self.lock = threading.RLock()
        self.ids = count()
        self.entities: dict[int, ReferencePublisher | ReferenceSubscription] = {}
        self.sessions: dict[int, ReferenceSession] = {}
        self.agent = self.agent_type(lambda client: client in self.sessions and self.sessions[client].answers_checks())
        self.delayed: list[Delayed] = []

    @property
    def session_type(self) -> type[ReferenceSession]:
        """What `create_session` makes."""
        return ReferenceSession

    def create_session(self, options: SessionOptions) -> ReferenceSession:
        return self.session_type(self, options)

    def environment(self) -> ReferenceEnvironment:
        return ReferenceEnvironment(self)

    def ping(self, options: SessionOptions, timeout_ms: int, attempts: int = 1) -> int:
        for _ in range(max(attempts, 1)):
            with self.lock:
                self.agent.probes += self.agent.up
                if self.agent.up:
                    return ReturnCode.OK
            self.clock.wait(None, self.clock.now_ns() + max(timeout_ms, 0) * MS)
        return ReturnCode.TIMEOUT

    def await_matched(self, publisher: Publisher, subscription: Subscription, until_ns: int) -> bool:
        assert isinstance(publisher, ReferencePublisher)
        assert isinstance(subscription, ReferenceSubscription)
        with self.lock:
            return self.world.matched(publisher.id, subscription.id)

    def inject(self, fault: str, **arguments: Any) -> int:
        """All that the declaration lists; processes and their clocks are simulated too."""
        session = arguments.get("session")
        if isinstance(session, ReferenceSession):
            return session.hit(fault, arguments)
        entity = arguments.get("entity")
        if fault == "preset" and isinstance(entity, ReferencePublisher | ReferenceSubscription):
            return entity.preset(arguments["kind"], arguments["count"])
        if isinstance(entity, ReferencePublisher):
            entity.unheard = fault == "lose"
            try:
                codes = []
                for _ in range(arguments["count"]):
                    codes.append(arguments["publish"]())
                    if fault == "duplicate":
                        self._again(entity)
                return int(min(codes))
            finally:
                entity.unheard = False
        return ReturnCode.UNSUPPORTED

    def _again(self, publisher: ReferencePublisher) -> None:
        """What it sent last arrives once more. Reordering shows nowhere: the link puts samples in order."""
        for entity in self.entities.values():
            if isinstance(entity, ReferenceSubscription) and self.world.matched(publisher.id, entity.id):
                entity.repeated(publisher.id, self.clock.now_ns())

    def silence(self, session: ReferenceSession) -> None:
        """A process has stopped, or goes on: have the world know whom its publishers reach."""
        now = self.clock.now_ns()
        for publisher in [one for one in self.entities.values() if one.side is Side.PUBLISHER]:
            for subscription in [one for one in self.entities.values() if one.side is Side.SUBSCRIPTION]:
                if session not in (publisher.session, subscription.session):
                    continue
                if publisher.session.link.down or subscription.session.link.down:
                    if self.world.matched(publisher.id, subscription.id):
                        self.tell(
                            self.world.sever(publisher.id, subscription.id, publisher.session.link.lease // MS, now)
                        )
                else:
                    self.tell(self.world.restore(publisher.id, subscription.id, now))

    def advance(self) -> None:
        """Let the world, the agent and the links catch up with the clock, in the order of what is due."""
        now = self.clock.now_ns()
        while (due := self.next_due_ns) <= now:
            self.tell(self.world.advance(due))
            while self.delayed and self.delayed[0].at_ns <= due:
                heapq.heappop(self.delayed).arrive()
            for ruling in self.agent.advance(due):
                self.sessions[ruling.client].given_up(ruling.at_ns, for_good=ruling.what == "removed")  # type: ignore[index]
            for session in list(self.sessions.values()):
                session.notice(due)
        self.tell(self.world.advance(now))

    @property
    def next_due_ns(self) -> int:
        """When something happens by itself next."""
        return min(
            self.world.next_due_ns,
            self.agent.next_due_ns,
            *(delayed.at_ns for delayed in self.delayed[:1]),
            *(session.notices_ns for session in self.sessions.values()),
        )

    def later(self, at_ns: int, arrive: Callable[[], None]) -> None:
        """Have something happen then."""
        heapq.heappush(self.delayed, Delayed(at_ns, next(self.ids), arrive))

    def peer_changed(self) -> None:
        """The agent went, or a new one came: the sessions of before are unknown to it."""
        self.advance()
        for session in list(self.sessions.values()):
            session.link_changed()
            session.signal.set()

    def tell(self, occurrences: Iterable[Occurrence]) -> None:
        """Hand occurrences to the entities that they concern, and wake their sessions."""
        for occurrence in occurrences:
            entity = self.entities.get(occurrence.entity)  # type: ignore[call-overload]
            if entity is not None:
                entity.occurred(occurrence)
                entity.session.signal.set()
