"""A session at an agent over UDP: `Core` with a socket, a clock, and calls that wait for answers.

Single-threaded, as eProsima's client is: nothing happens but inside of its calls, and only one thread
may be in one of them at a time.
"""

from __future__ import annotations

import enum
import time
from collections import deque
from collections.abc import Callable, Iterable

import msgspec

from nros_backends.xrce.client.core import Config, Core
from nros_backends.xrce.client.health import Health, State
from nros_backends.xrce.client.transport import Transport
from nros_backends.xrce.wire import Submessage
from nros_backends.xrce.wire import messages as m
from nros_backends.xrce.wire.ids import BEST_EFFORT, RELIABLE, ObjectId, Status
from nros_conformance.rmw.clock import MS, Clock

ATTEMPTS, ATTEMPT_NS = 10, 1_000 * MS
"""How often and how far apart eProsima's client asks for a session, and for its end."""

LEASE_NS = 1_000 * MS
"""In which a lost agent is noticed unless told otherwise."""

_AGAIN_NS = 50 * MS
"""How long an answer may stay away that the agent should have given before it acknowledged the request."""

_PROBES = 16
"""Probes of `Health` that an answer may still come to."""

_BATCH = 256
"""Datagrams per look at the socket; a few milliseconds' work."""

_SEND_BACKLOG_NS = 100 * MS
"""How long a reliable sample waits for room in a full window."""

UNLIMITED = m.DeliveryControl()
"""READ_DATA for all samples to come."""


class Sent(enum.Enum):
    """What became of a sample."""

    OK = "ok"
    TOO_LARGE = "too large"
    FULL = "full"


class Client:
    """``on_data(submessage, at_ns)`` gets samples; ``at_ns`` is when the kernel received them.

    It owns neither the transport nor anything else that would have to be closed.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        config: Config,
        on_data: Callable[[m.Data, int], None],
        lease_ns: int = LEASE_NS,
    ) -> None:
        self._transport = transport
        self._clock = clock
        self._on_data = on_data
        self.fresh = 0
        """Samples handed out so far."""
        self.core = Core(config, self._data, self._reply, self._heard)
        self.health = Health(lease_ns, clock.now_ns())
        self.connected = False
        self._admitted: list[m.StatusAgent] = []
        self._statuses: dict[int, int | None] = {}
        self._asked: dict[int, m.Create | m.Delete] = {}
        """Requests for entities that have no `Status` yet, to be repeated."""
        self._pong: dict[int, m.Info | None] = {}
        self._probes: deque[int] = deque(maxlen=_PROBES)
        self._times: list[tuple[m.TimestampReply, int]] = []

    # The session.

    def connect(self, attempts: int = ATTEMPTS, attempt_ns: int = ATTEMPT_NS) -> int | None:
        """Open the session; the agent's `Status`, None when it did not answer."""
        self._admitted.clear()
        for _ in range(attempts):
            self.core.create_client()
            if self.pump(lambda: bool(self._admitted), self._clock.now_ns() + attempt_ns):
                status = self._admitted[-1].status
                self.connected = status == Status.OK
                self.health = Health(self.health.lease_ns, self._clock.now_ns())
                return status
        return None

    def disconnect(self, attempts: int = ATTEMPTS, attempt_ns: int = ATTEMPT_NS) -> int | None:
        """Close the session at the agent; its `Status`, None when it did not answer."""
        self.connected = False
        for _ in range(attempts):
            request = self.core.delete_client()
            self._statuses[request] = None
            (status,) = self.outcomes([request], self._clock.now_ns() + attempt_ns)
            if status is not None:
                return status
        return None

    # Entities.

    def create(
        self, object_id: ObjectId, representation: m.Representation, *, parent: ObjectId | None = None,
        domain: int = 0, reuse: bool = False, replace: bool = False, reliable: bool = True,
    ) -> int:  # fmt: skip
        """Ask for an entity; the request id, for `outcomes`."""
        return self._ask(
            m.Create(
                request=self.core.next_request(), object=object_id, kind=object_id.kind,
                representation=representation, parent=parent, domain=domain, reuse=reuse, replace=replace,
            ),
            reliable,
        )  # fmt: skip

    def delete(self, object_id: ObjectId, *, reliable: bool = True) -> int:
        """Ask for the end of an entity; the request id, for `outcomes`."""
        return self._ask(m.Delete(request=self.core.next_request(), object=object_id), reliable)

    def outcomes(self, requests: Iterable[int], until_ns: int) -> list[int | None]:
        """Wait for the `Status` of each of these requests; None for those that came to nothing in time.

        Ends at once when the agent says that it does not know the session.
        """
        asked = list(requests)

        def done() -> bool:
            known = all(self._statuses[one] is not None for one in asked)
            return known or (self.connected and self.health.state is State.FORGOTTEN)

        while not self.pump(done, min(until_ns, self._clock.now_ns() + _AGAIN_NS)):
            if self._clock.now_ns() >= until_ns:
                break
            self._ask_again(asked)
        for one in asked:
            self._asked.pop(one, None)
        return [self._statuses.pop(one) for one in asked]

    def abandon(self, object_id: ObjectId) -> None:
        """Have an entity deleted, without caring for the outcome."""
        self._send(m.Delete(request=self.core.next_request(), object=object_id), True)

    def settle(self, until_ns: int) -> bool:
        """Wait until everything reliable is acknowledged, which is to say: has been handled by the agent."""
        return self.pump(
            lambda: self.core.reliable_out.settled or self.health.state is State.FORGOTTEN, until_ns
        ) and self.core.reliable_out.settled  # fmt: skip

    # Samples.

    def read(self, reader: ObjectId, *, reliable: bool, delivery: m.DeliveryControl | None = UNLIMITED) -> int:
        """Ask for samples of a data reader; they carry the request id."""
        request = self.core.next_request()
        self._send(
            m.ReadData(request=request, object=reader, stream=RELIABLE if reliable else BEST_EFFORT, delivery=delivery),
            True,
        )
        return request

    def write(self, writer: ObjectId, data: bytes, *, reliable: bool) -> Sent:
        """Send a sample. Reliable: it waits 0.1 s at most for those before it to be on their way.

        A large one may still be on its way afterwards; `service` goes on with it.
        """
        out = self.core.reliable_out
        if reliable and not self.pump(lambda: out.free > 0, self._clock.now_ns() + _SEND_BACKLOG_NS):
            return Sent.FULL
        sample = m.WriteData(request=self.core.next_request(), object=writer, data=data)
        if not self.core.send(sample, reliable=reliable, now_ns=self._clock.now_ns()):
            return Sent.TOO_LARGE
        self._flush()
        return Sent.OK

    # Asking the agent.

    def ping(self, timeout_ns: int, attempts: int = 1) -> bool:
        """Whether the agent answers one of so many probes in time, and knows this session."""
        for _ in range(attempts):
            pong = self._probe(timeout_ns)
            if pong is not None:
                return pong.implementation == 1
        return False

    def _probe(self, timeout_ns: int) -> m.Info | None:
        request = self.core.ping(in_session=True)
        self._pong[request] = None
        self.pump(lambda: self._pong[request] is not None, self._clock.now_ns() + timeout_ns)
        return self._pong.pop(request)

    def sync_time(self, timeout_ns: int) -> int | None:
        """The agent's wall clock minus ours, ns, as of NTP; None when it does not answer."""
        self._times.clear()
        self.core.timestamp(time.time_ns())
        if not self.pump(lambda: bool(self._times), self._clock.now_ns() + timeout_ns):
            return None
        reply, arrived_ns = self._times[0]
        return ((reply.receive.ns - reply.originate.ns) + (reply.transmit.ns - arrived_ns)) // 2

    # Being driven.

    def service(self) -> None:
        """Take in what has arrived and send what is due; never waits."""
        for datagram, at_ns in self._transport.receive(_BATCH):
            self.core.receive(datagram, at_ns, self._clock.now_ns())
        now_ns = self._clock.now_ns()
        self.core.tick(now_ns)
        if self.connected and self.health.look(now_ns):
            self._probes.append(self.core.ping(in_session=True))
        self._flush()

    def wait(self, until_ns: int) -> None:
        """Sleep until something arrives or is due."""
        due_ns = min(until_ns, self.core.next_due_ns)
        if self.connected:
            due_ns = min(due_ns, self.health.next_due_ns)
        self._transport.wait(due_ns - self._clock.now_ns())

    def pump(self, done: Callable[[], bool], until_ns: int) -> bool:
        """Go on until ``done()``, or until then; at least looks once. Whether it was done."""
        while True:
            self.service()
            if done():
                return True
            if self._clock.now_ns() >= until_ns:
                return False
            self.wait(until_ns)

    @property
    def known_ns(self) -> int:
        """Up to when all arrivals have been taken in."""
        return self._transport.known_ns

    # Inside.

    def _ask(self, request: m.Create | m.Delete, reliable: bool) -> int:
        self._statuses[request.request] = None
        if reliable:
            self._asked[request.request] = request
        self._send(request, reliable)
        return request.request

    def _ask_again(self, requests: list[int]) -> None:
        """Repeat the requests that the agent has handled without an answer coming here.

        An agent whose reliable stream is full throws its answers away. Repeated with REUSE a creation
        changes nothing, and a deletion answers that there is no such object: that is what was asked for.
        """
        if not self.core.reliable_out.settled:
            return
        for number in requests:
            request = self._asked.get(number) if self._statuses[number] is None else None
            if isinstance(request, m.Create):
                request = msgspec.structs.replace(request, reuse=True, replace=False)
            if request is not None:
                self._send(request, True)

    def _send(self, submessage: Submessage, reliable: bool) -> None:
        if not self.core.send(submessage, reliable=reliable, now_ns=self._clock.now_ns()):
            raise ValueError(f"{type(submessage).__name__} does not fit one message; send it on the reliable stream")
        self._flush()

    def _flush(self) -> None:
        outbox, self.core.outbox = self.core.outbox, []
        for datagram in outbox:
            self._transport.send(datagram)

    def _data(self, data: m.Data, at_ns: int) -> None:
        self.fresh += 1
        self._on_data(data, at_ns)

    def _heard(self, at_ns: int) -> None:
        self.health.heard(at_ns)

    def _reply(self, reply: Submessage, at_ns: int) -> None:
        match reply:
            case m.StatusAgent():
                self._admitted.append(reply)
            case m.StatusReply(request=request, status=status):
                if request in self._statuses and self._statuses[request] is None:
                    self._statuses[request] = status
            case m.Info(request=request):
                self._informed(request, reply, at_ns)
            case m.TimestampReply():
                self._times.append((reply, time.time_ns()))

    def _informed(self, request: int, info: m.Info, at_ns: int) -> None:
        """An answer to a probe of ours, and to nothing else, tells of the agent and of the session."""
        if request in self._pong:
            self._pong[request] = info
        elif request not in self._probes:
            return
        if not self.connected:
            return
        if info.implementation == 1:
            self.health.heard(at_ns)
        else:
            self.health.forgotten()


def ping_agent(transport: Transport, clock: Clock, timeout_ns: int, attempts: int = 1) -> bool:
    """Whether an agent answers one of so many probes in time; no session is needed."""
    core = Core(Config(key=1), lambda data, at_ns: None, lambda reply, at_ns: answered.add(_request(reply)))
    answered: set[int] = set()
    for _ in range(attempts):
        request = core.ping(in_session=False)
        for datagram in core.outbox:
            transport.send(datagram)
        core.outbox.clear()
        until_ns = clock.now_ns() + timeout_ns
        while request not in answered:
            for datagram, at_ns in transport.receive(_BATCH):
                core.receive(datagram, at_ns)
            if request in answered:
                break
            if clock.now_ns() >= until_ns:
                break
            transport.wait(until_ns - clock.now_ns())
        if request in answered:
            return True
    return False


def _request(reply: Submessage) -> int:
    return reply.request if isinstance(reply, m.Info) else -1
