"""A session: one node on the bus, and the loop that drives it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping

from nros_backends.can.buses import Wiring
from nros_backends.can.directory import Directory
from nros_backends.can.ends import End
from nros_backends.can.herald import Herald
from nros_backends.can.link import Frame, Link
from nros_backends.can.messages import Sign, SignKind, digest
from nros_backends.can.policies import admit
from nros_backends.can.publisher import CanPublisher
from nros_backends.can.subscription import CanSubscription
from nros_conformance.rmw.backend import Publisher, Session, Subscription
from nros_conformance.rmw.clock import MS, NEVER, Clock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.dispatch import ReadyQueue
from nros_conformance.rmw.driving import Driving
from nros_conformance.rmw.qos import Liveliness, QosProfile

LEASE_MS = 1_000
"""Default lease of a session: a node that sends no heartbeat for so long is gone."""

LEASE_MAX_MS = 3_600_000

_SLICE_NS = 50 * MS
"""A wait looks up that often for what other threads have done: registered a deadline, closed the session."""

_FRAMES = 1_024
"""Frames taken in before callbacks get their turn; some 10 ms of work."""

_NUMBERS = 2**16


class CanSession(Session):
    """Everything happens inside the calls of the application: there is no thread.

    So also the heartbeats, which keep AUTOMATIC publishers alive, go out in `drive_io` alone.
    """

    def __init__(
        self, clock: Clock, wiring: Wiring, node: int, lease_ms: int, subjects: Mapping[bytes, int],
        closed: Callable[[], None],
    ) -> None:  # fmt: skip
        self.clock = clock
        self.node = node
        self.lease_ms = lease_ms
        self.queue = ReadyQueue()
        self.lock = threading.RLock()
        """Held in every call, also while callbacks run, but not while `drive_io` waits."""
        self.link = Link(wiring, node, clock)
        self.herald = Herald(self.link, clock, lease_ms, subjects)
        self.directory = Directory(node, wiring.mtu, subjects, self._newcomer)
        self.closed = False
        self._on_close = closed
        self._ends: tuple[End, ...] = ()
        self._last_number = 0
        self._pending: Frame | None = None
        self._driving = Driving(clock)
        self._look_ns = clock.now_ns()
        self.herald.beat(self._look_ns, ())  # before any data: whoever knew this node before forgets it

    # The contract.

    def create_publisher(self, topic: str, type_name: str, qos: QosProfile) -> Publisher:
        with self.lock:
            qos = self._admit(topic, type_name, qos)
            publisher = CanPublisher(self, self._number(), (topic, type_name), qos)
            publisher.outlet.publishers += 1
            self._add(publisher)
            return publisher

    def create_subscription(self, topic: str, type_name: str, qos: QosProfile) -> Subscription:
        with self.lock:
            qos = self._admit(topic, type_name, qos)
            subscription = CanSubscription(self, self._number(), (topic, type_name), qos)
            self._add(subscription)
            self.directory.add(subscription, self.clock.now_ns())
            self.herald.listening = True
            return subscription

    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        """OK; WOULD_BLOCK while another drive_io of this session is in progress; INVALID_ARGUMENT.

        Returns early once a callback ran or a sample came. A negative timeout is 0 (C10).
        INVALID_CONFIG, after having driven, while another node on the bus uses this node's id.
        """
        if self.closed:
            return ReturnCode.INVALID_ARGUMENT
        code = self._driving.drive(timeout_ms, max_callbacks, self._drive)
        return ReturnCode.INVALID_CONFIG if code == ReturnCode.OK and self.collides() else code

    def ping(self, timeout_ms: int, attempts: int = 1) -> int:
        """UNSUPPORTED: there is no peer."""
        return ReturnCode.INVALID_ARGUMENT if self.closed else super().ping(timeout_ms, attempts)

    def destroy(self) -> int:
        """OK; INVALID_ARGUMENT, and no harm, the second time. Waits for a `drive_io` on another thread."""
        with self.lock:
            if self.closed:
                return ReturnCode.INVALID_ARGUMENT
            self.closed = True
            self.herald.sign(Sign(SignKind.GONE))
            for end in self._ends:
                end.destroy()
            self.herald.said.clear()
        with self._driving.ended():
            self.link.close()
            self._on_close()
        return ReturnCode.OK

    # For the entities.

    def forget(self, end: End) -> None:
        """An entity is about to be destroyed."""
        self._ends = tuple(other for other in self._ends if other is not end)
        if isinstance(end, CanSubscription):
            self.directory.remove(end)
            self.herald.listening = bool(self.directory.readers)
        if isinstance(end, CanPublisher):
            end.outlet.publishers -= 1
            if end.outlet.count != end.outlet.told and not self.closed:
                self.herald.tell(end.outlet)  # while the others still know what it is about
        if not self.closed:  # else the whole node has taken its leave
            self.herald.adjust(other.qos for other in self._ends if isinstance(other, CanPublisher))
            self.herald.sign(Sign(SignKind.GONE, end.number))

    def manual_by_node(self) -> list[CanPublisher]:
        """The publishers that any one of them asserts with itself."""
        return [
            end
            for end in self._ends
            if isinstance(end, CanPublisher) and end.qos.liveliness is Liveliness.MANUAL_BY_NODE
        ]

    def collides(self) -> bool:
        """Whether another node on the bus has used this node's id within the lease."""
        foreign_ns = self.link.foreign_ns
        return foreign_ns is not None and self.clock.now_ns() - foreign_ns < self.lease_ms * MS

    # Inside.

    def _drive(self, until_ns: int, max_callbacks: int | None) -> None:
        while not self.closed:
            with self.lock:
                self._look()
                ran = self.queue.drain(max_callbacks)
                fresh, self.directory.fresh = self.directory.fresh, False
            now_ns = self.clock.now_ns()
            # What fell due while a busy host kept this thread waiting belongs to this call (DSP-007).
            if ran or fresh or (now_ns >= until_ns and self._look_ns >= until_ns) or self.closed:
                return
            due_ns = min(until_ns, self._next_due_ns(), now_ns + _SLICE_NS)
            if due_ns > now_ns:
                received = self.link.receive(due_ns - now_ns)
                if isinstance(received, Frame):
                    self._pending = received

    def _look(self) -> None:
        """Take in what has come and find what time has brought; queues callbacks."""
        now_ns = self.clock.now_ns()
        left = self._receive()
        self.herald.speak(now_ns, self._ends)
        said = self.herald.said
        while said:
            self.directory.own(said.popleft())
        if left is not None:
            now_ns = left  # later frames wait, and may be what a timer waits for
        self.directory.expire(now_ns)
        for end in self._ends:
            end.look(now_ns)
        self._look_ns = now_ns

    def _receive(self) -> int | None:
        """Take in the frames that have come; when the last one of them came if there may be more."""
        at_ns = 0
        received: Frame | bool | None = self._pending
        self._pending = None
        for _ in range(_FRAMES):
            if isinstance(received, Frame):
                self.directory.frame(received)
                at_ns = received.at_ns
            received = self.link.receive(0)
            if received is False:
                break
        else:
            if isinstance(received, Frame):
                self._pending = received
            return at_ns or None
        if self.link.restarted:
            self.link.restarted = False
            self.herald.wanted = True
        return None

    def _newcomer(self) -> None:
        self.herald.wanted = True

    def _next_due_ns(self) -> int:
        with self.lock:
            ends = min((end.next_due_ns() for end in self._ends), default=NEVER)
            return min(ends, self.herald.next_due_ns(), self.directory.next_due_ns())

    def _admit(self, topic: str, type_name: str, qos: QosProfile) -> QosProfile:
        if self.closed:
            raise RmwError(ReturnCode.INVALID_ARGUMENT, "the session is destroyed")
        qos = admit(topic, type_name, qos)
        topic_digest, type_digest = digest(topic.removeprefix("/")), digest(type_name)
        own = any(end.topic_digest == topic_digest and end.type_digest != type_digest for end in self._ends)
        others = any(
            remote.alive and remote.info.topic == topic_digest and remote.info.type != type_digest
            for peer in self.directory.peers.values()
            for remote in peer.remotes.values()
        )
        if own or others:
            raise RmwError(ReturnCode.TOPIC_NAME_INVALID, f"topic {topic!r} has another type than {type_name!r}")
        return qos

    def _number(self) -> int:
        """One that no endpoint of this node has; 0 is the node."""
        used = {end.number for end in self._ends}
        for step in range(1, _NUMBERS):
            number = (self._last_number + step) % _NUMBERS
            if number and number not in used:
                self._last_number = number
                return number
        raise RmwError(ReturnCode.BAD_ALLOC, f"the session has {len(used)} entities")

    def _add(self, end: End) -> None:
        self._ends = (*self._ends, end)
        self.herald.adjust(other.qos for other in self._ends if isinstance(other, CanPublisher))
        self.herald.announce(end)
