"""A session: one domain object, one participant, and the wait set that `drive_io` waits on."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from cyclonedds.core import DDSException, Entity, GuardCondition, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from nros_backends.cyclone.ear import Ear
from nros_backends.cyclone.ends import End
from nros_backends.cyclone.envelope import dds_type_name, sample_type
from nros_backends.cyclone.native import Native, return_code
from nros_backends.cyclone.network import ONE_DOMAIN_AT_A_TIME
from nros_backends.cyclone.policies import admit, dds_topic, reader_qos, writer_qos
from nros_backends.cyclone.publisher import CyclonePublisher
from nros_backends.cyclone.receiver import Receiver
from nros_backends.cyclone.subscription import CycloneSubscription
from nros_conformance.rmw.backend import Publisher, Session, Subscription
from nros_conformance.rmw.clock import MS, NEVER, Clock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.dispatch import ReadyQueue
from nros_conformance.rmw.driving import Driving
from nros_conformance.rmw.qos import QosProfile

_WAIT_MAX_NS = 3_600_000 * MS
"""DDS adds the wait to a clock; nothing may overflow there."""

_E = TypeVar("_E", bound=End)


class CycloneSession(Session):
    """Own sockets and threads, so that two sessions of one process meet on the network."""

    def __init__(
        self, clock: Clock, native: Native, domain: Domain, participant: DomainParticipant, ear: Ear | None = None
    ) -> None:
        self.clock = clock
        self.native = native
        self.queue = ReadyQueue()
        self.closed = False
        self.guid: uuid.UUID = participant.get_guid()
        self.ear = ear
        """Where faults are injected that need to know what is on the wire."""
        self.dispatching = threading.RLock()
        """Held while events are found and callbacks run, not while `drive_io` waits."""
        self._domain: Domain | None = domain
        self._participant: DomainParticipant | None = participant
        self._waitset: WaitSet | None = WaitSet(participant)
        self._guard: GuardCondition | None = GuardCondition(participant)
        self._waitset.attach(self._guard)
        self._receiver: Receiver | None = None
        self._ends: tuple[End, ...] = ()
        self._looked_ns = clock.now_ns()
        self._driving = Driving(clock)
        self._waiting = False
        self._noted = False
        self._closing = threading.Lock()

    def create_publisher(self, topic: str, type_name: str, qos: QosProfile) -> Publisher:
        with self._creating(topic, type_name, qos) as (in_force, participant, dds):
            writer: DataWriter[Any] = DataWriter(participant, dds, writer_qos(in_force))
            return self._add(CyclonePublisher(self, topic, type_name, in_force, writer), writer)

    def create_subscription(self, topic: str, type_name: str, qos: QosProfile) -> Subscription:
        with self._creating(topic, type_name, qos) as (in_force, participant, dds):
            reader: DataReader[Any] = DataReader(participant, dds, reader_qos(in_force))
            return self._add(CycloneSubscription(self, topic, type_name, in_force, reader), reader)

    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        """OK; WOULD_BLOCK while another drive_io of this session is in progress; INVALID_ARGUMENT.

        Returns early once a callback ran or a sample came. A negative timeout is 0 (C10).
        """
        if self.closed:
            return ReturnCode.INVALID_ARGUMENT
        return self._driving.drive(timeout_ms, max_callbacks, self._drive)

    def ping(self, timeout_ms: int, attempts: int = 1) -> int:
        return ReturnCode.INVALID_ARGUMENT if self.closed else ReturnCode.UNSUPPORTED

    def destroy(self) -> int:
        """OK; INVALID_ARGUMENT, and no harm, the second time."""
        with self._closing:
            if self.closed:
                return ReturnCode.INVALID_ARGUMENT
            self.closed = True
        self.note()
        with self._driving.ended():
            with self.dispatching:
                for end in self._ends:
                    end.destroy()
            if self._receiver is not None:
                self._receiver.stop()
            self._receiver = self._waitset = self._guard = None
            if self.ear is not None:
                self.ear.close()
            # The domain goes last: deleting it would delete everything in it.
            with ONE_DOMAIN_AT_A_TIME:
                self._participant = None
                self._domain = None
        return ReturnCode.OK

    def deafmute(self, *, deaf: bool, mute: bool) -> int:
        """Harness: cut this session off the network, one way or both, until called with False."""
        participant = self._participant
        return ReturnCode.INVALID_ARGUMENT if participant is None else self.native.deafmute(participant, deaf, mute)

    @property
    def ends(self) -> tuple[End, ...]:
        """Its entities."""
        return self._ends

    # For the entities.

    def note(self) -> None:
        """Have `drive_io` look, now if it waits: there is news that DDS does not know of."""
        self._noted = True
        guard = self._guard
        if self._waiting and guard is not None:
            guard.set(True)

    def assert_node(self) -> ReturnCode:
        """Assert the liveliness of all MANUAL_BY_NODE publishers of this session."""
        participant = self._participant
        return ReturnCode.INVALID_ARGUMENT if participant is None else self.native.assert_liveliness(participant)

    def receive_at_once(self, subscription: CycloneSubscription) -> None:
        """Have its samples taken as they arrive, also between drives."""
        if self._receiver is None:
            assert self._participant is not None
            self._receiver = Receiver(self, self._participant)
        self._receiver.watch(subscription)

    def forget(self, end: End) -> None:
        """An entity is about to be destroyed."""
        self._ends = tuple(other for other in self._ends if other is not end)
        if self._receiver is not None and isinstance(end, CycloneSubscription):
            self._receiver.forget(end)
        if self._waitset is not None and end.endpoint is not None:
            self._waitset.detach(end.endpoint)

    # Inside.

    def _drive(self, until_ns: int, max_callbacks: int | None) -> None:
        waitset, noted, now_ns = self._waitset, False, self.clock.now_ns()
        while waitset is not None and not self.closed:
            due_ns = self._next_due_ns()
            # Said before the notes are looked at: whoever leaves one later wakes the wait.
            self._waiting = True
            noted = self._noted or (max_callbacks != 0 and len(self.queue) > 0)
            left_ns = 0 if noted else min(until_ns, due_ns) - now_ns
            # The one call of an idle drive that gives the GIL away, and has to get it back from many.
            triggered = waitset.wait(min(max(left_ns, 0), _WAIT_MAX_NS))
            self._waiting = False
            now_ns = self.clock.now_ns()
            # Also when the time is over: getting the GIL back may have taken long, and what fell due
            # meanwhile belongs to this call (DSP-007).
            if triggered or noted or now_ns >= min(due_ns, until_ns):
                with self.dispatching:
                    fresh = self._look()
                    if self.queue.drain(max_callbacks) or fresh:
                        return
                now_ns = self.clock.now_ns()
            if now_ns >= until_ns:
                return

    def _look(self) -> bool:
        """Let every entity find what has happened; whether samples came."""
        guard = self._guard
        if self.closed or guard is None:
            return False
        guard.set(False)
        self._noted = False
        before_ns, now_ns = self._looked_ns, self.clock.now_ns()
        fresh = False
        for end in self._ends:
            fresh |= end.look(before_ns, now_ns)
        self._looked_ns = now_ns
        return fresh

    def _next_due_ns(self) -> int:
        return min((end.next_due_ns() for end in self._ends), default=NEVER)

    @contextmanager
    def _creating(
        self, topic: str, type_name: str, qos: QosProfile
    ) -> Iterator[tuple[QosProfile, DomainParticipant, Topic[Any]]]:
        """All the checks, and the DDS topic. Translates what DDS itself refuses."""
        participant = self._participant
        if self.closed or participant is None:
            raise RmwError(ReturnCode.INVALID_ARGUMENT, "the session is destroyed")
        in_force = admit(topic, type_name, qos)
        name = dds_topic(topic, in_force)
        try:
            others = self.native.types_of(participant, name) - {dds_type_name(type_name)}
            if others:
                raise RmwError(ReturnCode.TOPIC_NAME_INVALID, f"topic {topic!r} has the type {min(others)!r}")
            yield in_force, participant, Topic(participant, name, sample_type(type_name))
        except DDSException as error:
            raise RmwError(return_code(error.code), str(error)) from error

    def _add(self, end: _E, endpoint: Entity) -> _E:
        endpoint.set_status_mask(end.status_mask)
        with self.dispatching:
            assert self._waitset is not None
            self._waitset.attach(endpoint)
            self._ends = (*self._ends, end)
        self.note()
        return end
