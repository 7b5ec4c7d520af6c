"""A session: a client, its objects at the agent, and the ready queue that `drive_io` drains."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from nros_backends.xrce.client.client import Client, Sent
from nros_backends.xrce.client.core import Config
from nros_backends.xrce.client.health import State
from nros_backends.xrce.ends import End
from nros_backends.xrce.link import Attachment
from nros_backends.xrce.objects import GROUP_BODY, PARTICIPANT_BODY, Objects, endpoint_body, topic_body
from nros_backends.xrce.policies import admit, dds_topic, dds_type
from nros_backends.xrce.publisher import XrcePublisher
from nros_backends.xrce.subscription import XrceSubscription
from nros_backends.xrce.wire import messages as m
from nros_backends.xrce.wire.ids import Kind, ObjectId, Status
from nros_conformance.rmw.backend import Publisher, Session, Subscription
from nros_conformance.rmw.clock import MS, NEVER, Clock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.dispatch import ReadyQueue
from nros_conformance.rmw.driving import Driving
from nros_conformance.rmw.qos import QosProfile, Reliability

CAPACITY = 2**18
"""Octets of the largest reliable sample: some 500 fragments. A best-effort one has to fit a datagram."""

_ATTEMPTS = 6
"""Tries to open a session within one and a half leases, to close it within half of one."""

_E = TypeVar("_E", bound=End)


class XrceSession(Session):
    """Single-threaded: its calls are for one thread at a time, and nothing happens between them.

    ``released(session)`` is told when it has been destroyed.
    """

    def __init__(
        self, attachment: Attachment, clock: Clock, config: Config, lease_ns: int, domain: int,
        released: Callable[[XrceSession], None],
    ) -> None:  # fmt: skip
        self.clock = clock
        self.queue = ReadyQueue()
        self.closed = False
        self.attachment = attachment
        self._lease_ns = lease_ns
        self._released = released
        self._ends: tuple[End, ...] = ()
        self._readers: dict[int, XrceSubscription] = {}
        self._objects = Objects()
        self._driving = Driving(clock)
        self._reported = State.WELL
        self.client = Client(attachment.transport, clock, config, self._arrived, lease_ns)
        try:
            self._open(domain)
        except RmwError:
            self.closed = True
            attachment.close()
            raise

    def _open(self, domain: int) -> None:
        status = self.client.connect(_ATTEMPTS, self._lease_ns // 4)
        if status is None:
            raise RmwError(ReturnCode.CONNECTION_FAILED, "the agent does not answer")
        if status != Status.OK:
            raise RmwError(ReturnCode.CONNECTION_FAILED, f"the agent refuses the session: {_name(status)}")
        self._await(
            "the participant",
            [self.client.create(self._objects.participant, m.Binary(PARTICIPANT_BODY), domain=domain)],
        )

    # Entities.

    def create_publisher(self, topic: str, type_name: str, qos: QosProfile) -> Publisher:
        in_force = self._admit(topic, type_name, qos)
        object_id = self._create(Kind.DATAWRITER, topic, type_name, in_force)
        return self._add(XrcePublisher(self, topic, type_name, in_force, object_id))

    def create_subscription(self, topic: str, type_name: str, qos: QosProfile) -> Subscription:
        in_force = self._admit(topic, type_name, qos)
        object_id = self._create(Kind.DATAREADER, topic, type_name, in_force)
        subscription = XrceSubscription(self, topic, type_name, in_force, object_id)
        subscription.request = self.client.read(object_id, reliable=in_force.reliability is Reliability.RELIABLE)
        self._readers[subscription.request] = subscription
        # Acknowledged means handled: from now on the agent delivers.
        if not self.client.settle(self.clock.now_ns() + self._lease_ns):
            subscription.destroy()
            raise RmwError(self._lost_code(), f"the agent did not confirm that it reads {topic}")
        return self._add(subscription)

    def remove(self, end: End) -> int:
        """Delete an entity at the agent, as far as that answers within half a lease."""
        self._ends = tuple(other for other in self._ends if other is not end)
        if isinstance(end, XrceSubscription):
            self._readers.pop(end.request, None)
        if self.closed:
            return ReturnCode.OK
        released = self._objects.release(end.object_id)
        if self.client.health.state is not State.WELL:
            for one in released:
                self.client.abandon(one)
            return ReturnCode.TIMEOUT
        requests = [self.client.delete(one) for one in released]
        answers = self.client.outcomes(requests, self.clock.now_ns() + self._lease_ns // 2)
        return ReturnCode.TIMEOUT if None in answers else ReturnCode.OK

    def send_sample(self, writer: ObjectId, data: bytes, *, reliable: bool) -> int:
        """Send a sample of a data writer; a return code."""
        if reliable and len(data) > CAPACITY:
            return ReturnCode.MESSAGE_TOO_LARGE
        self.client.service()  # so that one who only publishes notices as well when the agent is gone
        if self.client.health.state is not State.WELL:
            return ReturnCode.CONNECTION_FAILED
        match self.client.write(writer, data, reliable=reliable):
            case Sent.TOO_LARGE:
                return ReturnCode.MESSAGE_TOO_LARGE
            case Sent.FULL:
                return ReturnCode.TIMEOUT
        return ReturnCode.OK

    # Being driven.

    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        """OK; CONNECTION_FAILED when the agent is gone or has forgotten this session; WOULD_BLOCK; INVALID_ARGUMENT.

        Returns early once a callback ran, a sample came or the agent was found lost. WOULD_BLOCK: from
        inside of a callback. A negative timeout is 0 (C10).
        """
        if self.closed:
            return ReturnCode.INVALID_ARGUMENT
        code = self._driving.drive(timeout_ms, max_callbacks, self._drive)
        well = self.client.health.state is State.WELL
        return ReturnCode.CONNECTION_FAILED if code == ReturnCode.OK and not well else code

    def ping(self, timeout_ms: int, attempts: int = 1) -> int:
        """OK; TIMEOUT, also when the agent answers that it does not know this session; INVALID_ARGUMENT.

        ``timeout_ms`` is per attempt.
        """
        if self.closed or not isinstance(timeout_ms, int) or not isinstance(attempts, int) or attempts < 1:
            return ReturnCode.INVALID_ARGUMENT
        return ReturnCode.OK if self.client.ping(max(timeout_ms, 0) * MS, attempts) else ReturnCode.TIMEOUT

    def destroy(self) -> int:
        """OK; TIMEOUT when the agent did not confirm, all is released all the same; INVALID_ARGUMENT."""
        if self.closed:
            return ReturnCode.INVALID_ARGUMENT
        self.closed = True
        for end in self._ends:
            end.destroy()
        code = self._close()
        self._readers.clear()
        self.attachment.close()
        self._released(self)
        return code

    # Inside.

    def _close(self) -> int:
        """Have the agent forget the session, in half a lease; not waited for when it is silent, or has done so."""
        state = self.client.health.state
        if state is State.FORGOTTEN:
            return ReturnCode.OK
        attempts = _ATTEMPTS if state is State.WELL else 1
        within_ns = self._lease_ns // (2 * _ATTEMPTS) if state is State.WELL else 0
        return ReturnCode.TIMEOUT if self.client.disconnect(attempts, within_ns) is None else ReturnCode.OK

    def _drive(self, until_ns: int, max_callbacks: int | None) -> None:
        fresh = self.client.fresh
        while not self.closed:
            self.client.service()
            for end in self._ends:
                end.poll(self.client.known_ns)
            lost = self.client.health.state is not self._reported
            self._reported = self.client.health.state
            if self.queue.drain(max_callbacks) or self.client.fresh != fresh or lost:
                return
            # Compared is when the socket was looked at: what fell due meanwhile belongs to this call (DSP-007).
            if self.client.known_ns >= until_ns:
                return
            if not (len(self.queue) and max_callbacks):
                self.client.wait(min(until_ns, self._next_due_ns()))

    def _next_due_ns(self) -> int:
        return min((end.next_due_ns() for end in self._ends), default=NEVER)

    def _arrived(self, data: m.Data, at_ns: int) -> None:
        subscription = self._readers.get(data.request)
        if subscription is not None:
            subscription.arrived(data.data, at_ns)

    def _admit(self, topic: str, type_name: str, qos: QosProfile) -> QosProfile:
        if self.closed:
            raise RmwError(ReturnCode.INVALID_ARGUMENT, "the session is destroyed")
        in_force = admit(topic, type_name, qos)
        known = self._objects.type_of(dds_topic(topic, in_force))
        if known is not None and known != dds_type(type_name):
            raise RmwError(ReturnCode.TOPIC_NAME_INVALID, f"topic {topic!r} has the type {known!r}")
        return in_force

    def _create(self, kind: Kind, topic: str, type_name: str, qos: QosProfile) -> ObjectId:
        """Have the agent make an endpoint, and what it needs. Raises `RmwError`, and leaves nothing then."""
        objects, client = self._objects, self.client
        name, dds_type_name = dds_topic(topic, qos), dds_type(type_name)
        plan = objects.plan(kind, name, dds_type_name)
        bodies = {plan.topic: topic_body(name, dds_type_name), plan.endpoint: endpoint_body(kind, plan.topic, qos)}
        requests = [
            client.create(object_id, m.Binary(bodies.get(object_id, GROUP_BODY)), parent=parent)
            for object_id, parent in plan.missing
        ]
        try:
            self._await(f"{kind.name.lower()} on {topic}", requests)
        except RmwError:
            for one in objects.abandon(plan):
                client.abandon(one)
            raise
        return plan.endpoint

    def _await(self, what: str, requests: list[int]) -> None:
        statuses = self.client.outcomes(requests, self.clock.now_ns() + self._lease_ns)
        if None in statuses:
            raise RmwError(self._lost_code(), f"the agent did not answer the creation of {what}")
        for status in statuses:
            if status not in (Status.OK, Status.OK_MATCHED):
                assert status is not None
                raise RmwError(_code(status), f"the agent refuses {what}: {_name(status)}")

    def _lost_code(self) -> ReturnCode:
        return ReturnCode.CONNECTION_FAILED if self.client.health.state is not State.WELL else ReturnCode.TIMEOUT

    def _add(self, end: _E) -> _E:
        self._ends = (*self._ends, end)
        return end


def _name(status: int) -> str:
    return Status(status).name if status in set(Status) else f"status {status:#04x}"


def _code(status: int) -> ReturnCode:
    """The return code for a creation that the agent refused."""
    match status:
        case Status.INCOMPATIBLE:
            return ReturnCode.INCOMPATIBLE_QOS
        case Status.MISMATCH:
            return ReturnCode.TOPIC_NAME_INVALID
        case Status.RESOURCES:
            return ReturnCode.BAD_ALLOC
        case Status.INVALID_DATA:
            return ReturnCode.INVALID_ARGUMENT
    return ReturnCode.ERROR
