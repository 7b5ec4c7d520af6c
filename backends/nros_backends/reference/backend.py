"""`World` behind the contract: sessions share it, and are told what occurred when they are driven."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterable
from itertools import count
from typing import Any

from nros_backends.reference.link import LARGEST, Link, decode, malformed
from nros_conformance.model.world import Occurrence, Sample, Topic, World
from nros_conformance.rmw.backend import (
    Backend,
    Host,
    MessageCallback,
    Publisher,
    Session,
    SessionOptions,
    Subscription,
)
from nros_conformance.rmw.clock import MS, NEVER
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.detection import CountTracker, LivelinessTally
from nros_conformance.rmw.dispatch import EventRegistry, ReadyQueue
from nros_conformance.rmw.events import EventCallback, EventKind, Side
from nros_conformance.rmw.qos import QosProfile

CONNECTION_LEASE_MS = 500
"""As declared: how long a publisher without a lease of its own outlives a broken link."""

_NAME = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*", re.ASCII)


class ReferenceBackend(Backend):
    """One world for all sessions of a scenario.

    The types and small methods below are what a defective variant replaces.
    """

    world_type: type[World] = World

    def __init__(self, host: Host) -> None:
        super().__init__(host)
        self.clock = host.clock
        self.world = self.world_type()
        # On the real clock, where the control runs a planted defect, sessions are threads.
        self.lock = threading.RLock()
        self.ids = count()
        self.entities: dict[int, ReferencePublisher | ReferenceSubscription] = {}

    @property
    def session_type(self) -> type[ReferenceSession]:
        """What `create_session` makes."""
        return ReferenceSession

    def create_session(self, options: SessionOptions) -> ReferenceSession:
        return self.session_type(self, options)

    def await_matched(self, publisher: Publisher, subscription: Subscription, until_ns: int) -> bool:
        assert isinstance(publisher, ReferencePublisher)
        assert isinstance(subscription, ReferenceSubscription)
        with self.lock:
            return self.world.matched(publisher.id, subscription.id)

    def inject(self, fault: str, **arguments: Any) -> int:
        """All that the declaration lists; processes and their clocks are simulated too."""
        entity, session = arguments.get("entity"), arguments.get("session")
        if isinstance(session, ReferenceSession):
            with self.lock:
                return self._hit(fault, session, arguments)
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
        for subscription in self.heard_by(publisher):
            subscription.repeated(publisher.id, self.clock.now_ns())

    def _hit(self, fault: str, session: ReferenceSession, arguments: dict[str, Any]) -> int:
        link = session.link
        match fault:
            case "partition":
                link.out = link.inward = False
            case "block":
                link.out, link.inward = link.out and arguments["direction"] != "out", arguments["direction"] == "out"
            case "heal":
                link.heal()
                session.signal.set()
            case "crash" | "freeze":
                link.down = True
            case "thaw":
                link.down = False
            case "stall":
                link.stalled = True
            case "delay":
                link.delay_ns = arguments["by_ns"]
            case "clock_step":
                session.wall_clock_step_ns += arguments["by_ns"]
            case "inject":
                publisher = next((id_ for id_, one in self.entities.items() if one.side is Side.PUBLISHER), 0)
                for packet in malformed(publisher, arguments["count"], arguments["seed"]):
                    session.receive(packet)
        self.relink()
        return ReturnCode.OK

    def heard_by(self, publisher: ReferencePublisher) -> list[ReferenceSubscription]:
        """The subscriptions that a publisher reaches now."""
        return [
            entity
            for entity in self.entities.values()
            if isinstance(entity, ReferenceSubscription)
            and self.world.matched(publisher.id, entity.id)
            and self.reaches(publisher.session, entity.session)
        ]

    def reaches(self, sender: ReferenceSession, receiver: ReferenceSession) -> bool:
        """Whether what one session sends arrives at the other."""
        if sender.link.down or receiver.link.down:
            return False
        return sender is receiver or (sender.link.out and receiver.link.inward)

    def relink(self) -> None:
        """Have the world know who reaches whom."""
        now = self.clock.now_ns()
        pairs = [
            (one, other)
            for one in self.entities.values()
            if isinstance(one, ReferencePublisher)
            for other in self.entities.values()
            if isinstance(other, ReferenceSubscription)
        ]
        for publisher, subscription in pairs:
            if self.reaches(publisher.session, subscription.session):
                self.tell(self.world.restore(publisher.id, subscription.id, now))
            elif self.world.matched(publisher.id, subscription.id):
                lease = publisher.session.options.connection_lease_ms or CONNECTION_LEASE_MS
                self.tell(self.world.sever(publisher.id, subscription.id, lease, now))

    def tell(self, occurrences: Iterable[Occurrence]) -> None:
        """Hand occurrences to the entities that they concern, and wake their sessions."""
        for occurrence in occurrences:
            entity = self.entities.get(occurrence.entity)  # type: ignore[call-overload]
            if entity is not None:
                entity.occurred(occurrence)
                entity.session.signal.set()


class ReferenceSession(Session):
    """A session: its own ready queue over the shared world."""

    queue_type: type[ReadyQueue] = ReadyQueue

    def __init__(self, backend: ReferenceBackend, options: SessionOptions) -> None:
        self.backend = backend
        self.clock = backend.clock
        self.options = options
        self.queue = self.queue_type()
        self.link = Link()
        self.wall_clock_step_ns = 0
        """By how much the wall clock of its process was stepped; nothing looks at it (RDM-006)."""
        self.signal = self.clock.signal()
        self.entities: list[ReferencePublisher | ReferenceSubscription] = []
        self.destroyed = False

    @property
    def publisher_type(self) -> type[ReferencePublisher]:
        """What `create_publisher` makes."""
        return ReferencePublisher

    @property
    def subscription_type(self) -> type[ReferenceSubscription]:
        """What `create_subscription` makes."""
        return ReferenceSubscription

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
                return ReturnCode.OK
            now = self.clock.now_ns()
            if now >= until:
                return ReturnCode.OK
            self.clock.wait(self.signal, min(until, self.next_due_ns()))

    def poll(self) -> bool:
        """Let the world catch up with the clock; whether a callback is ready."""
        if self.link.down:
            return False  # a process that does not run
        with self.backend.lock:
            now = self.clock.now_ns()
            for arrival in [one for one in self.link.held if one[0] <= now]:
                self.link.held.remove(arrival)
                arrival[1]()
            self.backend.tell(self.backend.world.advance(now))
            for entity in self.entities:
                entity.registry.poll()
        return len(self.queue) > 0

    def next_due_ns(self) -> int:
        """When the world does something by itself next."""
        if self.link.down:
            return NEVER
        with self.backend.lock:
            return min([self.backend.world.next_due_ns, *(when for when, _ in self.link.held)])

    def receive(self, packet: bytes) -> None:
        """A packet that came from nobody known. What is no frame of ours is dropped (ROB-001)."""
        frame = decode(packet)
        assert frame is None, "nobody but the harness sends here, and it sends nothing valid"

    def destroy(self) -> int:
        for entity in list(self.entities):
            entity.destroy()
        self.destroyed = True
        self.signal.set()
        return ReturnCode.OK

    def admit(self, topic: str, type_name: str, qos: QosProfile) -> tuple[Topic, QosProfile]:
        """What identifies the topic, and the QoS in force. Raises `RmwError`."""
        if self.destroyed:
            raise RmwError(ReturnCode.INVALID_ARGUMENT, "the session is destroyed")
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
        with self.backend.lock:
            link, now = self.session.link, self.backend.clock.now_ns()
            if link.stalled or link.delay_ns:
                when = NEVER if link.stalled else now + link.delay_ns
                link.held.append((when, lambda: self.send(data)))
            else:
                self.send(data)
        return ReturnCode.OK

    def send(self, data: bytes) -> None:
        """Put a sample on the wire; with the lock held."""
        now = self.backend.clock.now_ns()
        self.backend.tell(self.backend.world.publish(self.id, data, now, lost=self.unheard))
        for subscription in self.backend.heard_by(self):
            subscription.arrived(self.id, now)

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
