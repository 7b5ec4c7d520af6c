"""One session's protocol, without input and output: datagrams go in, datagrams come out.

Held to recordings of eProsima's client 3.0.1. What differs on purpose: request ids of pings are not
always 10, so that a pong can be told to answer *this* probe; the last submessage of a message is not
padded; the answer to the agent's liveliness ping is a proper INFO unless ``bare_answer`` asks for
the C client's eight zeros.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from nros_backends.xrce.streams import (
    BestEffortInput,
    BestEffortOutput,
    Packet,
    ReliableInput,
    ReliableOutput,
)
from nros_backends.xrce.wire import Header, Malformed, Message, Submessage, decode_body, encode, encode_body
from nros_backends.xrce.wire import messages as m
from nros_backends.xrce.wire.codec import decode_header, encode_header
from nros_backends.xrce.wire.ids import (
    AGENT,
    BEST_EFFORT,
    CLIENT,
    KEYLESS,
    NO_SESSION,
    NO_STREAM,
    RELIABLE,
)
from nros_conformance.rmw.clock import MS, NEVER

MTU = 508
"""Octets of the largest message, its header included: what eProsima's client says by default over UDP."""

LIVELINESS = "uxr_hl"
"""Property with which a client asks the agent to check on it; the value is in milliseconds, six digits."""

LIVELINESS_MAX_MS = 999_999
"""Six digits."""

HEARTBEAT_NS = 100 * MS

_SMALLEST = 8
"""eProsima's client ignores datagrams that are not longer."""

_FIRST_REQUEST, _REQUESTS = 10, 2**16
_DELETE_REQUEST = 2
"""Request ids of eProsima's client: of entities and data from 10, of the session's end always 2."""


@dataclasses.dataclass(frozen=True, slots=True)
class Config:
    """What a client says of itself, and how it behaves.

    ``key``: u32, not 0, unique among the clients of an agent. ``session``: an id from 0x81 on needs no key
    in every message. ``hard_liveliness_ms``: 0 is off. ``window``: messages unacknowledged at once.
    """

    key: int
    session: int = 0x81
    mtu: int = MTU
    hard_liveliness_ms: int = 0
    heartbeat_ns: int = HEARTBEAT_NS
    window: int = 16
    bare_answer: bool = False

    @property
    def properties(self) -> tuple[tuple[str, str], ...]:
        """Those of CREATE_CLIENT."""
        if not self.hard_liveliness_ms:
            return ()
        return ((LIVELINESS, f"{self.hard_liveliness_ms:06}"),)


class Core:
    """Protocol state of one session. All times are ``CLOCK_MONOTONIC`` ns, handed in.

    ``on_data(submessage, at_ns)`` gets samples, ``on_reply(submessage, at_ns)`` the answers STATUS_AGENT,
    STATUS, INFO and TIMESTAMP_REPLY, ``on_heard(at_ns)`` hears of every message of the session that only
    an agent which knows it sends. What is to be sent stands in ``outbox``.
    """

    def __init__(
        self,
        config: Config,
        on_data: Callable[[m.Data, int], None],
        on_reply: Callable[[Submessage, int], None],
        on_heard: Callable[[int], None] = lambda at_ns: None,
    ) -> None:
        self.config = config
        self.outbox: list[bytes] = []
        self.malformed = 0
        """Datagrams and bodies that were not XRCE."""
        self.foreign = 0
        """Datagrams of another session, or of streams that were never opened."""
        self._on_data = on_data
        self._on_reply = on_reply
        self._on_heard = on_heard
        self._key = config.key if config.session < KEYLESS else None
        self._request = _FIRST_REQUEST - 1
        self._ping = _REQUESTS // 2
        self.capacity = config.mtu - len(encode_header(self._header(NO_STREAM)))
        """Octets of submessages in one message."""
        self._best_effort_out = BestEffortOutput(BEST_EFFORT)
        self._best_effort_in = BestEffortInput(BEST_EFFORT)
        self.reliable_out = ReliableOutput(RELIABLE, self.capacity, config.window, config.heartbeat_ns, resend_all=True)
        self._reliable_in = ReliableInput(RELIABLE)
        self._owes_acknack = False

    # Going out.

    def next_request(self) -> int:
        """A request id for an entity or for data."""
        self._request += 1
        if self._request >= _REQUESTS // 2:
            self._request = _FIRST_REQUEST
        return self._request

    def create_client(self) -> None:
        """Ask for the session; streams start anew."""
        for stream in (self._best_effort_out, self._best_effort_in, self.reliable_out, self._reliable_in):
            stream.reset()
        header = Header(NO_SESSION) if self._key is None else Header(0, key=self._key)
        properties = self.config.properties
        request = m.CreateClient(
            key=self.config.key, session=self.config.session, mtu=self.config.mtu,
            properties=properties, understated=bool(properties),
        )  # fmt: skip
        self.outbox.append(encode(Message(header, (request,))))

    def delete_client(self) -> int:
        """Ask for the session's end; the request id."""
        self._send_loose(m.Delete(request=_DELETE_REQUEST, object=CLIENT))
        return _DELETE_REQUEST

    def ping(self, *, in_session: bool) -> int:
        """Ask the agent for its state; the request id of this very probe."""
        self._ping = max((self._ping + 1) % _REQUESTS, _REQUESTS // 2)
        probe = m.GetInfo(request=self._ping, object=AGENT, mask=m.ACTIVITY)
        if in_session:
            self._send_loose(probe)
        else:
            self.outbox.append(outside_session(probe))
        return self._ping

    def timestamp(self, wall_ns: int) -> None:
        """Ask the agent for its time."""
        self._send_loose(m.Timestamp(transmit=m.Time.of(wall_ns)))

    def send(self, *submessages: Submessage, reliable: bool, now_ns: int) -> bool:
        """Send these in one message; False, and nothing sent, for best effort and more than fits one."""
        body = encode_body(submessages)
        if reliable:
            self.reliable_out.push(body)
            self._send_reliable(now_ns)
        elif len(body) > self.capacity:
            return False
        else:
            self._send_packet(self._best_effort_out.send(body))
        return True

    def tick(self, now_ns: int) -> None:
        """Acknowledge what has come in since the last call; announce what is unacknowledged, when that is due."""
        if self._owes_acknack:
            self._owes_acknack = False
            self._send_loose(self._reliable_in.acknack())
        announcement = self.reliable_out.heartbeat(now_ns)
        if announcement is not None:
            self._send_loose(announcement)

    @property
    def next_due_ns(self) -> int:
        """When `tick` has something to announce next."""
        due_ns = self.reliable_out.wakeup_ns
        return NEVER if due_ns is None else due_ns

    def _header(self, stream: int, sequence: int = 0) -> Header:
        return Header(self.config.session, stream, sequence, self._key)

    def _send_loose(self, submessage: Submessage) -> None:
        self.outbox.append(encode(Message(self._header(NO_STREAM), (submessage,))))

    def _send_packet(self, packet: Packet) -> None:
        self.outbox.append(encode_header(self._header(packet.stream, packet.sequence)) + packet.body)

    def _send_reliable(self, now_ns: int) -> None:
        for packet in self.reliable_out.take(now_ns):
            self._send_packet(packet)

    # Coming in.

    def receive(self, datagram: bytes, at_ns: int, now_ns: int | None = None) -> None:
        """Take in one datagram that came at ``at_ns``. Whatever it is, nothing is raised."""
        if len(datagram) <= _SMALLEST:
            self.malformed += 1
            return
        try:
            header, start = decode_header(datagram)
            self._dispatch(header, datagram[start:], at_ns, at_ns if now_ns is None else now_ns)
        except Malformed:
            self.malformed += 1

    def _dispatch(self, header: Header, body: bytes, at_ns: int, now_ns: int) -> None:
        if header.session in (NO_SESSION, 0x00) and header.stream == NO_STREAM:
            for submessage in decode_body(body):
                if isinstance(submessage, m.Info):  # the answer to a ping outside of the session
                    self._on_reply(submessage, at_ns)
        elif header.session != self.config.session or header.key not in (None, self._key):
            self.foreign += 1
        elif header.stream == NO_STREAM:
            for submessage in decode_body(body):
                self._control(submessage, at_ns, now_ns)
        elif header.stream == BEST_EFFORT:
            submessages = decode_body(body)
            if self._best_effort_in.receive(header.sequence):
                self._on_heard(at_ns)
                self._handle(submessages, at_ns)
        elif header.stream == RELIABLE:
            self._on_heard(at_ns)
            self._owes_acknack = True
            self._deliver(self._reliable_in.receive(header.sequence, body), at_ns)
        else:
            self.foreign += 1

    def _deliver(self, bodies: list[bytes], at_ns: int) -> None:
        for body in bodies:
            try:
                submessages = decode_body(body)
            except Malformed:
                self.malformed += 1
            else:
                self._handle(submessages, at_ns)

    def _handle(self, submessages: tuple[Submessage, ...], at_ns: int) -> None:
        for submessage in submessages:
            if isinstance(submessage, m.Data):
                self._on_data(submessage, at_ns)
            elif isinstance(submessage, m.StatusReply):
                self._on_reply(submessage, at_ns)

    def _control(self, submessage: Submessage, at_ns: int, now_ns: int) -> None:
        match submessage:
            case m.Info() | m.StatusAgent() | m.TimestampReply():
                self._on_reply(submessage, at_ns)
            case m.StatusReply(request=2):  # STATUS belongs on a stream, but for the end of the session
                self._on_reply(submessage, at_ns)
            case m.GetInfo(request=request, object=asked):
                self._on_heard(at_ns)
                answer = m.LivelinessAnswer() if self.config.bare_answer else m.Info(request=request, object=asked)
                self._send_loose(answer)
            case m.Data():  # that is how samples come that wait when READ_DATA is cancelled
                self._on_heard(at_ns)
                self._on_data(submessage, at_ns)
            case m.Acknack(stream=stream, first_unacked=first, missing=missing) if stream == RELIABLE:
                self._on_heard(at_ns)
                self.reliable_out.acknack(first, missing, now_ns)
                self._send_reliable(now_ns)
            case m.Heartbeat(stream=stream, first=first, last=last) if stream == RELIABLE:
                self._on_heard(at_ns)
                self._owes_acknack = True
                self._deliver(self._reliable_in.heartbeat(first, last), at_ns)


def outside_session(probe: Submessage) -> bytes:
    """A message that belongs to no session."""
    return encode(Message(Header(NO_SESSION), (probe,)))
