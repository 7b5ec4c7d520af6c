"""The agent without sockets and clock: datagrams in, datagrams out, and when to wake it next.

Source of the semantics: DDS-XRCE 1.0, and where it leaves something open eProsima's agent 3.0.1 as it was
recorded. Whatever comes in, nothing is raised.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import msgspec

from nros_backends.xrce.agent.descriptions import Description
from nros_backends.xrce.agent.entities import Entity
from nros_backends.xrce.agent.exchange import DataReader, DataWriter, Exchange, TopicKey
from nros_backends.xrce.agent.profiles import PROFILES
from nros_backends.xrce.agent.qos import EntityQos
from nros_backends.xrce.agent.services import Replier, Requester
from nros_backends.xrce.agent.session import HARD_LIVELINESS, MS, Address, Session, Verdict
from nros_backends.xrce.wire import messages as m
from nros_backends.xrce.wire.cdr import Malformed
from nros_backends.xrce.wire.codec import Frame, decode_header, encode, frames
from nros_backends.xrce.wire.ids import (
    BEST_EFFORT,
    CLIENT,
    COOKIE,
    KEYLESS,
    NO_SESSION,
    NO_STREAM,
    RELIABLE,
    VERSION,
    Id,
    Kind,
    ObjectId,
    Status,
    is_reliable,
)

TICK_NS = 200 * MS
"""Period of HEARTBEATs and of the liveliness check in eProsima's agent."""
SMALLEST_MTU = 18
"""Octets of a STATUS with the client key: a client that cannot take one is refused."""
CLIENTS = 1024
"""Sessions at once; one more is refused with RESOURCES."""

Outgoing = tuple[bytes, Address]
"""A datagram and where it goes."""


class EntityInfo(msgspec.Struct, frozen=True):
    """An entity of the agent's graph.

    ``topic``: of writers and readers; of a requester or replier that of the requests. ``matched``: how many of the
    other side it is connected to.
    """

    client: int
    id: ObjectId
    domain: int
    topic: TopicKey | None = None
    qos: EntityQos | None = None
    matched: int = 0


class Agent:
    """An XRCE agent whose clients exchange data with each other.

    ``start_ns`` and ``tick_ns``: phase and period of HEARTBEATs and of the liveliness check.
    ``wall_clock``: nanoseconds since the epoch, for time synchronisation.
    """

    def __init__(
        self,
        start_ns: int = 0,
        profiles: Mapping[tuple[Kind, str], Description] = PROFILES,
        wall_clock: Callable[[], int] = time.time_ns,
        tick_ns: int = TICK_NS,
    ) -> None:
        self._start_ns = start_ns
        self._tick_ns = tick_ns
        self._next_tick_ns = start_ns + tick_ns
        self._profiles = profiles
        self._wall_clock = wall_clock
        self._exchange = Exchange()
        self._sessions: dict[int, Session] = {}
        self._keys: dict[Address, int] = {}

    @property
    def clients(self) -> tuple[int, ...]:
        """The keys of all clients with a session."""
        return tuple(self._sessions)

    def entities(self) -> tuple[EntityInfo, ...]:
        """The graph: all entities of all clients."""
        return tuple(
            self._listed(session, entity) for session in self._sessions.values() for entity in session.entities
        )

    def _listed(self, session: Session, entity: Entity) -> EntityInfo:
        end: DataWriter | DataReader
        match entity.endpoint:
            case (DataWriter() as end) | Requester(writer=end):
                matched = len(self._exchange.readers(end))
            case (DataReader() as end) | Replier(reader=end):
                matched = len(self._exchange.writers(end))
            case _:
                return EntityInfo(session.key, entity.id, entity.domain)
        return EntityInfo(session.key, entity.id, entity.domain, end.topic, end.qos, matched)

    def wakeup_ns(self, now_ns: int) -> int | None:
        """When to call `advance` next; None: not before a datagram comes in."""
        times = [session.wakeup_ns(now_ns) for session in self._sessions.values()]
        if any(session.ticks for session in self._sessions.values()):
            times.append(max(self._next_tick_ns, self._tick_after(now_ns)))
        return min((one for one in times if one is not None), default=None)

    def receive(self, datagram: bytes, source: Address, now_ns: int) -> list[Outgoing]:
        """Handle a datagram; what to send. What was due by time before is done first."""
        out = self.advance(now_ns)
        try:
            header, start = decode_header(datagram)
        except Malformed:
            return out
        if header.session in (NO_SESSION, NO_SESSION - KEYLESS):
            self._outside(header, datagram, start, source, now_ns, out)
            return out
        session = self._find(header, source)
        if session is None:
            self._unknown(header, datagram, start, source, out)
            return out
        session.hear(now_ns)
        for body in session.accept(header.stream, header.sequence, datagram[start:]):
            if self._sessions.get(session.key) is session:
                self._handle(session, header, body, source, now_ns, out)
        if is_reliable(header.stream):
            reply = m.Header(header.session, key=header.key)
            out.append((encode(m.Message(reply, (session.reliable_in(header.stream).acknack(),))), source))
        self._deliver(now_ns, out)
        return out

    def advance(self, now_ns: int) -> list[Outgoing]:
        """Do what is due by time: HEARTBEATs, liveliness checks, paced deliveries. Missed ticks are not made up."""
        out: list[Outgoing] = []
        if now_ns >= self._next_tick_ns:
            self._next_tick_ns = self._tick_after(now_ns)
            for session in list(self._sessions.values()):
                self._check(session, now_ns, out)
        self._deliver(now_ns, out)
        return out

    def _tick_after(self, now_ns: int) -> int:
        return now_ns - (now_ns - self._start_ns) % self._tick_ns + self._tick_ns

    def _check(self, session: Session, now_ns: int, out: list[Outgoing]) -> None:
        match session.judge(now_ns):
            case Verdict.ALIVE:
                for output in session.reliable_out.values():
                    heartbeat = output.announce()
                    if heartbeat is not None:
                        out += [(one, session.home) for one in session.send(NO_STREAM, heartbeat, now_ns)]
            case Verdict.PING:
                ping = m.GetInfo(request=0, object=CLIENT, mask=m.CONFIGURATION)
                out += [(one, session.home) for one in session.send(NO_STREAM, ping, now_ns)]
            case Verdict.DELETE:
                self._delete(session)
            case Verdict.SILENT:
                pass

    def _deliver(self, now_ns: int, out: list[Outgoing]) -> None:
        for session in self._sessions.values():
            if session.readings:
                out += [(one, session.home) for one in session.deliver(now_ns)]

    def _find(self, header: m.Header, source: Address) -> Session | None:
        key = self._keys.get(source) if header.key is None else header.key
        return None if key is None else self._sessions.get(key)

    def _delete(self, session: Session) -> None:
        session.entities.clear()
        del self._sessions[session.key]
        del self._keys[session.home]

    def _outside(
        self, header: m.Header, datagram: bytes, start: int, source: Address, now_ns: int, out: list[Outgoing]
    ) -> None:
        """Messages outside a session: CREATE_CLIENT and GET_INFO, one per message."""
        frame = _first(datagram, start)
        if frame is None:
            return
        if frame.id == Id.CREATE_CLIENT:
            self._create_client(header, frame, source, now_ns, out)
        elif frame.id == Id.GET_INFO:
            self._inform(header, frame, source, source in self._keys, out)

    def _unknown(self, header: m.Header, datagram: bytes, start: int, source: Address, out: list[Outgoing]) -> None:
        """In-session messages without a session: the ping and the deletion of a client are answered."""
        frame = _first(datagram, start)
        if frame is None:
            return
        if frame.id == Id.GET_INFO:
            self._inform(header, frame, source, source in self._keys, out)
        elif frame.id == Id.DELETE and frame.request is not None and frame.request[1].kind is Kind.CLIENT:
            request, target = frame.request
            reply = m.StatusReply(request=request, object=target, status=Status.OK)
            out.append((encode(m.Message(header, (reply,))), source))

    def _inform(self, header: m.Header, frame: Frame, source: Address, known: bool, out: list[Outgoing]) -> None:
        """INFO about the agent, whatever the object and the mask. ``known``: the implementation status."""
        try:
            request = frame.read()
        except Malformed:
            return
        assert isinstance(request, m.GetInfo)
        reply = m.Info(
            request=request.request, object=request.object, implementation=int(known),
            configuration=m.AgentConfiguration(), activity=m.AgentActivity(),
        )  # fmt: skip
        out.append((encode(m.Message(header, (reply,))), source))

    def _create_client(self, header: m.Header, frame: Frame, source: Address, now_ns: int, out: list[Outgoing]) -> None:
        try:
            request = frame.read()
        except Malformed:
            if len(frame.payload) > _SESSION_ID:  # enough to know whom to tell
                self._answer_client(header, frame.payload[_SESSION_ID], Status.INVALID_DATA, source, out)
            return
        assert isinstance(request, m.CreateClient)
        status, hard_ns = _verify(request)
        if status is Status.OK:
            status = self._establish(request, hard_ns, source, now_ns)
        self._answer_client(header, request.session, status, source, out)

    def _answer_client(
        self, header: m.Header, session: int, status: Status, source: Address, out: list[Outgoing]
    ) -> None:
        key = (header.key or 0) if session < KEYLESS else None
        reply = m.Header(session, header.stream, header.sequence, key)
        out.append((encode(m.Message(reply, (m.StatusAgent(status=status),))), source))

    def _establish(self, request: m.CreateClient, hard_ns: int | None, source: Address, now_ns: int) -> Status:
        """Create, re-create or go on with a session. Same key and id: streams start again, entities stay."""
        other = self._keys.get(source)
        if other is not None and other != request.key:
            self._delete(self._sessions[other])
        session = self._sessions.get(request.key)
        if session is None and len(self._sessions) >= CLIENTS:
            return Status.RESOURCES
        if session is not None and session.id == request.session:
            session.reset()
            del self._keys[session.home]
            session.home = source
        else:
            if session is not None:
                self._delete(session)
                hard_ns = None  # as in eProsima's agent, the property is lost with another session id
            session = Session(request, hard_ns, source, now_ns, self._exchange, self._profiles)
            self._sessions[request.key] = session
        self._keys[source] = request.key
        return Status.OK

    def _handle(
        self, session: Session, header: m.Header, body: bytes, source: Address, now_ns: int, out: list[Outgoing]
    ) -> None:
        """The submessages of a body, up to the first that fails."""
        try:
            for frame in frames(body):
                try:
                    submessage = frame.read()
                except Malformed:
                    if frame.request is not None and frame.id in (Id.CREATE, Id.READ_DATA):
                        self._reply(session, header.stream, *frame.request, Status.INVALID_DATA, source, now_ns, out)
                    return
                if not self._handle_one(session, header, submessage, frame, source, now_ns, out):
                    return
        except Malformed:
            return

    def _handle_one(
        self, session: Session, header: m.Header, submessage: m.Submessage, frame: Frame, source: Address,
        now_ns: int, out: list[Outgoing],
    ) -> bool:  # fmt: skip
        """One submessage; False: the rest of its message is dropped."""
        match submessage:
            case m.Create(request=request, object=target):
                status = session.entities.create(submessage)
                self._reply(session, header.stream, request, target, status, source, now_ns, out)
                return status is not Status.INVALID_DATA
            case m.Delete(request=request, object=target):
                if target.kind is Kind.CLIENT:
                    self._delete(session)
                    reply = m.StatusReply(request=request, object=target, status=Status.OK)
                    out += [(one, source) for one in session.send(NO_STREAM, reply, now_ns)]
                    return False
                status = session.entities.delete(target)
                self._reply(session, header.stream, request, target, status, source, now_ns, out)
            case m.WriteData(request=request, object=target, data=data, format=form):
                return not form and session.entities.write(target, request, data, now_ns)
            case m.ReadData(request=request, object=target):
                if not session.read(submessage, now_ns):
                    # always on the reliable stream, whichever the request came on
                    self._reply(session, RELIABLE, request, target, Status.UNKNOWN_REFERENCE, source, now_ns, out)
            case m.GetInfo():
                self._inform(session.header(NO_STREAM), frame, source, True, out)
            case m.Acknack(first_unacked=first, missing=missing, stream=stream):
                output = session.reliable_out.get(stream)
                if output is not None:
                    output.acknack(first, missing, now_ns)
                    out += [(session.datagram(packet), source) for packet in output.take(now_ns)]
            case m.Heartbeat(first=first, last=last, stream=stream):
                if is_reliable(stream):
                    for body in session.reliable_in(stream).heartbeat(first, last):
                        if self._sessions.get(session.key) is not session:
                            return False
                        self._handle(session, m.Header(session.id, stream), body, source, now_ns, out)
                    acknack = session.reliable_in(stream).acknack()
                    out += [(one, source) for one in session.send(NO_STREAM, acknack, now_ns)]
            case m.Reset():
                session.reset()
            case m.Fragment():
                pass  # on a reliable stream they are joined before they come here; elsewhere they mean nothing
            case m.Timestamp(transmit=transmit):
                received = m.Time.of(self._wall_clock())
                reply_time = m.TimestampReply(
                    transmit=m.Time.of(self._wall_clock()), receive=received, originate=transmit
                )
                out += [(one, source) for one in session.send(NO_STREAM, reply_time, now_ns)]
            case _:
                return False
        return True

    def _reply(
        self, session: Session, stream: int, request: int, target: ObjectId, status: Status, source: Address,
        now_ns: int, out: list[Outgoing],
    ) -> None:  # fmt: skip
        """STATUS on the reliable stream if the request came on one, else on the best-effort one; never on 0."""
        stream = RELIABLE if is_reliable(stream) else BEST_EFFORT
        reply = m.StatusReply(request=request, object=target, status=status)
        out += [(one, source) for one in session.send(stream, reply, now_ns)]


_SESSION_ID = 12
"""Where CREATE_CLIENT has the session id."""


def _first(datagram: bytes, start: int) -> Frame | None:
    try:
        return next(frames(datagram, start), None)
    except Malformed:
        return None


def _verify(request: m.CreateClient) -> tuple[Status, int | None]:
    """What is wrong with CREATE_CLIENT, and its hard liveliness in nanoseconds."""
    if request.key == 0 or request.cookie != COOKIE:
        return Status.INVALID_DATA, None
    if request.version[0] != VERSION[0]:
        return Status.INCOMPATIBLE, None
    if request.mtu < SMALLEST_MTU:
        return Status.INVALID_DATA, None
    value = dict(request.properties).get(HARD_LIVELINESS)
    if value is None:
        return Status.OK, None
    if not (value.isascii() and value.isdigit() and len(value) <= 9):
        return Status.INVALID_DATA, None
    return Status.OK, int(value) * MS
