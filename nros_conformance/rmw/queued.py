"""A session, publisher and subscription for middleware that hands over samples on threads of its own.

That is how the clients of MQTT, zenoh, NATS and most brokers work: one call to publish, one to
subscribe with a function that is called for each sample. An adapter on these classes says how to open
and close the connection, how to send, and calls `QueuedSubscription.received`; queue, depth, dispatch,
caps, argument checks and the events that need no help from the middleware come from here.

Samples are stamped when `received` is called, on whatever thread, and take effect when the session's
thread looks: inside `drive_io`, `has_data` or `try_recv_raw`. So sources of events belong to one thread,
and are exact however rarely it looks.
"""

from __future__ import annotations

import abc
import dataclasses
import re
import threading
from collections import deque
from collections.abc import Collection, Hashable
from typing import TypeVar

from nros_conformance.rmw.backend import MessageCallback, Publisher, Session, Subscription
from nros_conformance.rmw.clock import MS, NEVER, Clock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.detection import GapTracker, LivelinessTally, Source
from nros_conformance.rmw.dispatch import ReadyQueue
from nros_conformance.rmw.driving import Driving
from nros_conformance.rmw.ends import ClockedEnd
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import QosProfile, is_finite
from nros_conformance.rmw.receive_queue import ReceiveQueue

_Q = TypeVar("_Q", bound="_QueuedEntity")
_NAME = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*", re.ASCII)


class QueuedSession(Session):
    """A session over one connection, which an adapter opens in its constructor and closes in `leave`."""

    publisher: type[QueuedPublisher]
    subscription: type[QueuedSubscription]
    unsupported: Collection[str] = ()
    """Policies that creation refuses, by the names of ``[qos] unsupported`` in ``backend.toml``."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.ready = ReadyQueue()
        self.wake = clock.signal()
        """Raised from any thread when there is something to look at."""
        self.entities: dict[_QueuedEntity, None] = {}
        self.closed = False
        self._driving = Driving(clock)

    def admit(self, topic: str, type_name: str, qos: QosProfile) -> None:
        """Refuse, by raising `RmwError`, what else cannot be created, such as a topic of another type."""

    def leave(self) -> None:
        """Close the connection: the last thing that a session does."""

    def create_publisher(self, topic: str, type_name: str, qos: QosProfile) -> Publisher:
        return self._entered(self.publisher(self, topic, type_name, self._admit(topic, type_name, qos)))

    def create_subscription(self, topic: str, type_name: str, qos: QosProfile) -> Subscription:
        return self._entered(self.subscription(self, topic, type_name, self._admit(topic, type_name, qos)))

    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        """Dispatch; waits for something to dispatch or to take for at most ``timeout_ms``.

        A sample ends the waiting once, when it arrives. A negative timeout is none (C10).
        """
        if self.closed:
            return ReturnCode.INVALID_ARGUMENT
        return self._driving.drive(timeout_ms, max_callbacks, self._drive)

    def ping(self, timeout_ms: int, attempts: int = 1) -> int:
        return ReturnCode.INVALID_ARGUMENT if self.closed else super().ping(timeout_ms, attempts)

    def destroy(self) -> int:
        if not self.closed:
            self.closed = True
            for entity in tuple(self.entities):
                entity.destroy()
            self.leave()
            self.wake.set()
        return ReturnCode.OK

    def _drive(self, until_ns: int, max_callbacks: int | None) -> None:
        while not self.closed:
            woken = self.wake.is_set()
            self.wake.clear()
            for entity in tuple(self.entities):
                entity.look()
            # The last look comes after the last wait: what fell due meanwhile belongs to this call (DSP-007).
            if self.ready.drain(max_callbacks) or woken or self.clock.now_ns() >= until_ns:
                return
            due_ns = min((entity.next_due_ns() for entity in self.entities), default=NEVER)
            self.clock.wait(self.wake, min(until_ns, due_ns))

    def _entered(self, entity: _Q) -> _Q:
        entity.enter()
        self.entities[entity] = None
        return entity

    def _admit(self, topic: str, type_name: str, qos: QosProfile) -> QosProfile:
        """The profile in force; a depth of 0 becomes 1. Raises `RmwError`."""
        if self.closed:
            raise RmwError(ReturnCode.INVALID_ARGUMENT, "the session is destroyed")
        if not _NAME.fullmatch(topic) or not type_name:
            raise RmwError(ReturnCode.TOPIC_NAME_INVALID, f"topic {topic!r}, type {type_name!r}")
        qos.check()
        for policy in self.unsupported:
            if asks_for(qos, policy):
                raise RmwError(ReturnCode.INCOMPATIBLE_QOS, f"{policy} is not supported")
        self.admit(topic, type_name, qos)
        return dataclasses.replace(qos, depth=max(qos.depth, 1))


class _QueuedEntity(ClockedEnd):
    """What both ends share: the sources of the events that it supports, and its place in the session."""

    events: Collection[EventKind] = ()
    """The kinds that it supports."""

    def __init__(self, session: QueuedSession, topic: str, type_name: str, qos: QosProfile) -> None:
        self.session = session
        self.missed_kind = next((kind for kind in self.events if kind.is_deadline), None)
        sources = {kind: self.source(kind) for kind in self.events if not kind.is_deadline}
        super().__init__(session.clock, session.ready, topic, type_name, qos, sources)
        if qos.has_deadline and self.missed_kind is not None:
            self._time(qos.deadline_ms * MS)

    def look(self) -> None:
        """On the session's thread: let time pass, and queue the callbacks of what became ready."""
        self.poll(self.session.clock.now_ns())

    def destroy(self) -> int:
        if not self.closed:
            self.registry.close()
            self.session.entities.pop(self, None)
            self.leave()
        return ReturnCode.OK

    def enter(self) -> None:
        """Make it known to the middleware, the last step of its creation; may raise `RmwError`."""

    def leave(self) -> None:
        """Release what the middleware holds for it; afterwards it hands over nothing more."""

    def source(self, kind: EventKind) -> Source:
        """The source of an event that is neither a deadline nor otherwise known here."""
        raise NotImplementedError(f"{type(self).__name__} has no source of {kind.label}")


class QueuedPublisher(_QueuedEntity, Publisher):
    """The sending end. An adapter writes `send`. Of the events, OfferedDeadlineMissed needs nothing else."""

    @abc.abstractmethod
    def send(self, data: bytes) -> int:
        """Hand one sample to the middleware: OK or a negative code."""

    def publish_raw(self, data: bytes) -> int:
        if self.closed or not isinstance(data, bytes | bytearray | memoryview):
            return ReturnCode.INVALID_ARGUMENT
        code = self.send(bytes(data))
        if code == ReturnCode.OK:
            self.moved(self.session.clock.now_ns())  # only a success begins the period anew (ODM-004)
        return code

    def assert_liveliness(self) -> int:
        return ReturnCode.INVALID_ARGUMENT if self.closed else super().assert_liveliness()


@dataclasses.dataclass(frozen=True, slots=True)
class _Arrival:
    at_ns: int
    data: bytes
    publisher: Hashable
    sequence: int | None


class QueuedSubscription(_QueuedEntity, Subscription):
    """The receiving end: the middleware calls `received`, from any thread.

    RequestedDeadlineMissed needs nothing else, MessageLost knows the overflow of the queue and, with
    sequence numbers, gaps on the wire; for LivelinessChanged call `living`.
    """

    def __init__(self, session: QueuedSession, topic: str, type_name: str, qos: QosProfile) -> None:
        self.losses = GapTracker()
        self.tally = LivelinessTally()
        self._lock = threading.Lock()
        self._arrivals: deque[_Arrival] = deque()
        self._living: deque[tuple[int, int, int]] = deque()
        super().__init__(session, topic, type_name, qos)
        self._waiting = ReceiveQueue(qos, self.registry, session.clock)

    def received(self, data: bytes, publisher: Hashable = None, sequence: int | None = None) -> None:
        """A sample has arrived. ``sequence`` numbers the samples of a ``publisher``, modulo 2**32.

        What is missing counts as lost; one that was overtaken is taken back, unless it was reported meanwhile.
        """
        with self._lock:  # the stamp and the queue together, or a look in between would miss what it is due
            self._arrivals.append(_Arrival(self.session.clock.now_ns(), data, publisher, sequence))
        self.session.wake.set()

    def living(self, alive: int, not_alive: int) -> None:
        """So many publishers are alive, respectively not alive, from now on. From any thread."""
        with self._lock:
            self._living.append((self.session.clock.now_ns(), alive, not_alive))
        self.session.wake.set()

    def source(self, kind: EventKind) -> Source:
        known: dict[EventKind, Source] = {
            EventKind.MESSAGE_LOST: self.losses.losses, EventKind.LIVELINESS_CHANGED: self.tally
        }  # fmt: skip
        return known[kind] if kind in known else super().source(kind)

    def look(self) -> None:
        with self._lock:
            arrivals, self._arrivals = self._arrivals, deque()
            living, self._living = self._living, deque()
            now_ns = self.session.clock.now_ns()
        for arrival in arrivals:
            self._arrived(arrival)
        for at_ns, alive, not_alive in living:
            self.tally.set(alive, not_alive, at_ns)
        self.poll(now_ns)

    def has_data(self) -> bool | int:
        self.look()
        return self._waiting.has_data()

    def try_recv_raw(self, max_size: int) -> bytes | int:
        """The oldest sample. One that is larger than ``max_size`` is dropped, and counts as lost (ROB-002)."""
        self.look()
        taken = self._waiting.try_recv_raw(max_size)
        self._lost(self._waiting.dropped(), self.session.clock.now_ns())
        return taken

    def set_message_callback(self, callback: MessageCallback | None, context: object) -> int:
        code = self._waiting.set_message_callback(callback, context)
        self.session.wake.set()
        return code

    def _arrived(self, arrival: _Arrival) -> None:
        self.moved(arrival.at_ns)
        if arrival.sequence is not None:
            self.losses.sample(arrival.publisher, arrival.sequence, arrival.at_ns)
        self._lost(self._waiting.put(arrival.data, arrival.at_ns), arrival.at_ns)

    def _lost(self, count: int, at_ns: int) -> None:
        if count:
            self.losses.losses.add(count, at_ns)
            self.session.wake.set()


def asks_for(qos: QosProfile, policy: str) -> bool:
    """Whether a profile asks for a policy, by its name in ``[qos] unsupported``.

    ``lifespan``, ``deadline``, ``lease``: a finite one. ``durability.transient_local``,
    ``liveliness.manual_by_node``...: that value. ``depth.above_128``: a larger depth.
    """
    name, _, which = policy.partition(".")
    if not which:
        return is_finite(getattr(qos, f"{name}_ms"))
    value = getattr(qos, name)
    if which.startswith("above_"):
        return bool(value > int(which.removeprefix("above_")))
    return bool(value.name.lower() == which)
