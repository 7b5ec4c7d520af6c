"""`World` behind the contract: sessions share it, and are told what occurred when they are driven."""

from __future__ import annotations

import heapq
import re
import threading
from collections.abc import Callable, Iterable
from itertools import count
from typing import Any

from nros_backends.reference.connection import ConnectedSession
from nros_backends.reference.link import Delayed, ReferenceEnvironment
from nros_backends.reference.wire import LARGEST, decode, malformed
from nros_conformance.model.agent import Agent
from nros_conformance.model.world import Occurrence, Sample, Topic, World
from nros_conformance.rmw.backend import (
    Backend,
    Host,
    MessageCallback,
    Publisher,
    SessionOptions,
    Subscription,
)
from nros_conformance.rmw.clock import MS, NEVER
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.detection import CountTracker, LivelinessTally
from nros_conformance.rmw.dispatch import EventRegistry, ReadyQueue
from nros_conformance.rmw.events import EventCallback, EventKind, Side
from nros_conformance.rmw.qos import QosProfile

_NAME = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*", re.ASCII)


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


class ReferenceSession(ConnectedSession):
    """A session: its own ready queue over the shared world."""

    queue_type: type[ReadyQueue] = ReadyQueue

    def __init__(self, backend: ReferenceBackend, options: SessionOptions) -> None:
        self.queue = self.queue_type()
        self.held: list[Callable[[], None]] = []
        """What is sent while the link is stalled."""
        self.wall_clock_step_ns = 0
        """By how much the wall clock of its process was stepped; nothing looks at it (RDM-006)."""
        self.destroyed = False
        super().__init__(backend, options)

    @property
    def publisher_type(self) -> type[ReferencePublisher]:
        """What `create_publisher` makes."""
        return ReferencePublisher

    @property
    def subscription_type(self) -> type[ReferenceSubscription]:
        """What `create_subscription` makes."""
        return ReferenceSubscription

    def hit(self, fault: str, arguments: dict[str, Any]) -> int:
        """A fault of its link, or of its process."""
        with self.backend.lock:
            self.backend.advance()
            match fault:
                case "crash" | "freeze" | "thaw":
                    self.link.down = fault != "thaw"
                    self.backend.silence(self)
                case "stall":
                    self.link.stalled = True
                case "clock_step":
                    self.wall_clock_step_ns += arguments["by_ns"]
                case "inject":
                    entities = self.backend.entities.items()
                    publisher = next((id_ for id_, one in entities if one.side is Side.PUBLISHER), 0)
                    for packet in malformed(publisher, arguments["count"], arguments["seed"]):
                        self.receive(packet)
                case _:
                    code = self.suffer(fault, arguments)
                    if fault == "heal":
                        self.link.stalled = False
                        held, self.held = self.held, []
                        for send in held:
                            send()
                    return code
        return ReturnCode.OK

    def receive(self, packet: bytes) -> None:
        """A packet that came from nobody known. What is no frame of ours is dropped (ROB-001)."""
        frame = decode(packet)
        assert frame is None, "nobody but the harness sends here, and it sends nothing valid"

    def create_publisher(self, topic: str, type_name: str, qos: QosProfile) -> ReferencePublisher:
        key, qos = self.admit(topic, type_name, qos)
        return self.publisher_type(self, key, topic, type_name, qos)

    def create_subscription(self, topic: str, type_name: str, qos: QosProfile) -> ReferenceSubscription:
        key, qos = self.admit(topic, type_name, qos)
        return self.subscription_type(self, key, topic, type_name, qos)

    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        if self.destroyed:
            return ReturnCode.INVALID_ARGUMENT
        if self.queue.busy:
            return ReturnCode.WOULD_BLOCK
        until = self.clock.now_ns() + max(timeout_ms, 0) * MS
        while True:
            self.signal.clear()
            if self.poll():
                self.queue.drain(max_callbacks)
                return self.code
            now = self.clock.now_ns()
            if now >= until or self.lost:
                return self.code
            self.clock.wait(self.signal, min(until, self.next_due_ns()))

    def poll(self) -> bool:
        """Let the world catch up with the clock; whether a callback is ready."""
        if self.link.down:
            return False  # a process that does not run
        with self.backend.lock:
            self.backend.advance()
            for entity in self.entities:
                entity.registry.poll()
        return len(self.queue) > 0

    def next_due_ns(self) -> int:
        """When something happens by itself next."""
        if self.link.down:
            return NEVER
        with self.backend.lock:
            return self.backend.next_due_ns

    def destroy(self) -> int:
        for entity in list(self.entities):
            entity.destroy()
        with self.backend.lock:
            code = ReturnCode.OK if self.connected else ReturnCode.TIMEOUT  # all is released nevertheless (C22)
            self.backend.agent.leave(self.id)
            self.backend.sessions.pop(self.id, None)
        self.destroyed = True
        self.signal.set()
        return code

    def admit(self, topic: str, type_name: str, qos: QosProfile) -> tuple[Topic, QosProfile]:
        """What identifies the topic, and the QoS in force. Raises `RmwError`."""
        if self.destroyed:
            raise RmwError(ReturnCode.INVALID_ARGUMENT, "the session is destroyed")
        self.await_peer()
        qos.check()
        if not _NAME.fullmatch(topic) or not type_name:
            raise RmwError(ReturnCode.TOPIC_NAME_INVALID, f"topic {topic!r}, type {type_name!r}")
        for entity in self.backend.entities.values():
            if (entity.key[0], entity.topic) == (self.options.domain_id, topic) and entity.type_name != type_name:
                raise RmwError(ReturnCode.TOPIC_NAME_INVALID, f"{topic} has the type {entity.type_name}")
        return (self.options.domain_id, topic, type_name), qos


class _Entity:
    """What both ends share: an identity in the world, and a registry over count and liveliness sources."""

    side: Side
    registry_type: type[EventRegistry] = EventRegistry
    tracker_type: type[CountTracker] = CountTracker
    tally_type: type[LivelinessTally] = LivelinessTally

    def __init__(self, session: ReferenceSession, key: Topic, topic: str, type_name: str, qos: QosProfile) -> None:
        self.session = session
        self.backend = session.backend
        self.key = key
        self.topic = topic
        self.type_name = type_name
        self.qos = qos
        self.id = next(self.backend.ids)
        self.sources: dict[EventKind, LivelinessTally | CountTracker] = {
            kind: self.tally_type() if kind is EventKind.LIVELINESS_CHANGED else self.tracker_type()
            for kind in EventKind
            if kind.side is self.side
        }
        self.registry = self.registry_type(session.queue, self.sources, qos_deadline_ms=qos.deadline_ms)
        self.destroyed = False
        self.backend.entities[self.id] = self  # type: ignore[assignment]
        session.entities.append(self)  # type: ignore[arg-type]

    def occurred(self, occurrence: Occurrence) -> None:
        """Note it for the next callback."""
        source = self.sources[occurrence.kind]
        if isinstance(source, LivelinessTally):
            source.add(occurrence.change[0], occurrence.change[1], occurrence.at_ns)
        else:
            source.add(occurrence.change[0], occurrence.at_ns)

    def preset(self, kind: int | None, count: int) -> int:
        """See `Backend.inject`."""
        with self.backend.lock:
            if kind is None:
                self.backend.world.preset(self.id, count)
            else:
                self.sources[EventKind(kind)].preset(count)
        return ReturnCode.OK

    def supports_event(self, kind: int) -> bool:
        return self.registry.supports(kind)

    def register_event(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        code = self.registry.register(kind, deadline_ms, callback, context)
        if code == ReturnCode.OK and EventKind(kind).is_deadline and not self.qos.has_deadline:
            with self.backend.lock:
                self.backend.world.set_deadline(self.id, deadline_ms)
        self.session.signal.set()
        return code

    def destroy(self) -> int:
        if self.destroyed:
            return ReturnCode.INVALID_ARGUMENT
        self.destroyed = True
        self.registry.close()
        with self.backend.lock:
            self.leave(self.backend.clock.now_ns())
            del self.backend.entities[self.id]
        self.session.entities.remove(self)  # type: ignore[arg-type]
        return ReturnCode.OK

    def leave(self, now_ns: int) -> None:
        """Take it out of the world."""
        raise AssertionError


class ReferencePublisher(_Entity, Publisher):
    """The sending end."""

    side = Side.PUBLISHER
    unheard = False
    """Whether the wire loses what it publishes."""

    def __init__(self, session: ReferenceSession, key: Topic, topic: str, type_name: str, qos: QosProfile) -> None:
        super().__init__(session, key, topic, type_name, qos)
        with self.backend.lock:
            now = self.backend.clock.now_ns()
            node = (session.options.domain_id, session.options.node_name)
            self.backend.tell(self.backend.world.create_publisher(self.id, key, node, qos, now))

    def publish_raw(self, data: bytes) -> int:
        if self.destroyed:
            return ReturnCode.INVALID_ARGUMENT
        if len(data) > LARGEST:
            return ReturnCode.MESSAGE_TOO_LARGE
        if self.session.lost:
            return ReturnCode.CONNECTION_FAILED
        with self.backend.lock:
            self.backend.advance()
            now = self.backend.clock.now_ns()
            if self.session.link.stalled:
                self.session.held.append(lambda: self.send(data))
            elif self.session.link.delay:
                self.backend.later(now + self.session.link.delay, lambda: self.send(data))
            else:
                self.send(data)
        return ReturnCode.OK

    def send(self, data: bytes) -> None:
        """What was published comes to the agent, and from there to whom it reaches."""
        if self.destroyed:
            return
        now = self.backend.clock.now_ns()
        heard = self.session.link.out and self.backend.agent.knows(self.session.id)
        if heard:
            self.backend.agent.hears(self.session.id, now)
        listeners = [one for one in self.backend.entities.values() if isinstance(one, ReferenceSubscription)]
        deaf = {one.id for one in listeners if not one.session.link.in_}
        lost = self.unheard or not heard
        self.backend.tell(self.backend.world.publish(self.id, data, now, lost=lost, deaf=deaf))
        for one in listeners:
            if self.backend.world.matched(self.id, one.id):
                one.arrived(self.id, now)

    def assert_liveliness(self) -> int:
        if self.destroyed:
            return ReturnCode.INVALID_ARGUMENT
        with self.backend.lock:
            self.backend.tell(self.backend.world.assert_liveliness(self.id, self.backend.clock.now_ns()))
        return ReturnCode.OK

    def leave(self, now_ns: int) -> None:
        self.backend.tell(self.backend.world.destroy_publisher(self.id, now_ns))


class ReferenceSubscription(_Entity, Subscription):
    """The receiving end."""

    side = Side.SUBSCRIPTION

    def __init__(self, session: ReferenceSession, key: Topic, topic: str, type_name: str, qos: QosProfile) -> None:
        super().__init__(session, key, topic, type_name, qos)
        with self.backend.lock:
            now = self.backend.clock.now_ns()
            self.backend.tell(self.backend.world.create_subscription(self.id, key, qos, now))

    def has_data(self) -> bool | int:
        if self.destroyed:
            return ReturnCode.INVALID_ARGUMENT
        with self.backend.lock:
            return self.backend.world.peek(self.id, self.backend.clock.now_ns()) is not None

    def arrived(self, publisher: int, now_ns: int) -> None:
        """Announce what a publisher has just sent, to be taken as long as it waits."""
        sample = self.backend.world.newest(self.id, publisher)
        if sample is not None:
            self.registry.message(now_ns, lambda: self._waits(sample))
            self.session.signal.set()

    def repeated(self, publisher: int, now_ns: int) -> None:
        """The newest sample of a publisher came once more: known already, so nothing comes of it (MSL-004)."""

    def _waits(self, sample: Sample) -> bool:
        with self.backend.lock:
            return self.backend.world.waits(self.id, sample, self.backend.clock.now_ns())

    def try_recv_raw(self, max_size: int) -> bytes | int:
        if self.destroyed or max_size < 0:
            return ReturnCode.INVALID_ARGUMENT
        with self.backend.lock:
            sample = self.backend.world.peek(self.id, self.backend.clock.now_ns())
            if sample is None:
                return ReturnCode.NO_DATA
            self.backend.world.take(self.id, self.backend.clock.now_ns())
        return sample.data if len(sample.data) <= max_size else ReturnCode.BUFFER_TOO_SMALL

    def set_message_callback(self, callback: MessageCallback | None, context: object) -> int:
        return self.registry.set_message_callback(callback, context)

    def leave(self, now_ns: int) -> None:
        self.backend.tell(self.backend.world.destroy_subscription(self.id, now_ns))
