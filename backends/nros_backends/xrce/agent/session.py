"""One client's session in the agent: its streams, its entities, what it reads, and whether it lives."""

from __future__ import annotations

import enum
from collections.abc import Mapping

from nros_backends.xrce.agent.descriptions import Description
from nros_backends.xrce.agent.entities import Entities
from nros_backends.xrce.agent.exchange import Exchange
from nros_backends.xrce.agent.reading import Reading
from nros_backends.xrce.streams import BestEffortInput, BestEffortOutput, Packet, ReliableInput, ReliableOutput
from nros_backends.xrce.wire.codec import encode_body, encode_header
from nros_backends.xrce.wire.ids import KEYLESS, NO_STREAM, Kind, ObjectId, is_reliable
from nros_backends.xrce.wire.messages import CreateClient, Data, Header, ReadData, Submessage

MS = 1_000_000
DEAD_NS = 30_000 * MS
"""Silence after which a client without hard liveliness gets no HEARTBEATs any more."""
PINGS = 3
"""Unanswered pings after which a client with hard liveliness is deleted, one tick after the last."""
HARD_LIVELINESS = "uxr_hl"
"""The property of CREATE_CLIENT that asks for it; its value is the silence in milliseconds, in digits."""

Address = tuple[str, int]
"""Where a datagram comes from or goes to, as `socket` has it for IPv4."""


class Verdict(enum.Enum):
    """What a tick of the liveliness check comes to."""

    ALIVE = "alive"
    SILENT = "silent"
    PING = "ping"
    DELETE = "delete"


class Session:
    """What the agent knows of a client. ``home``: where CREATE_CLIENT came from, DATA and HEARTBEAT go."""

    def __init__(
        self, request: CreateClient, hard_ns: int | None, home: Address, now_ns: int,
        exchange: Exchange, profiles: Mapping[tuple[Kind, str], Description],
    ) -> None:  # fmt: skip
        self.key = request.key
        self.id = request.session
        self.home = home
        self.hard_ns = hard_ns
        self.entities = Entities(exchange, profiles)
        self.readings: dict[ObjectId, Reading] = {}
        self._exchange = exchange
        self._capacity = request.mtu - len(encode_header(self.header(NO_STREAM)))
        self._best_in: dict[int, BestEffortInput] = {}
        self._reliable_in: dict[int, ReliableInput] = {}
        self._best_out: dict[int, BestEffortOutput] = {}
        self.reliable_out: dict[int, ReliableOutput] = {}
        self._heard_ns = now_ns
        self._pings = 0

    def header(self, stream: int, sequence: int = 0) -> Header:
        """The header of a message to this client."""
        return Header(self.id, stream, sequence, self.key if self.id < KEYLESS else None)

    def hear(self, now_ns: int) -> None:
        """The client sent something in its session."""
        self._heard_ns = now_ns
        self._pings = 0

    def judge(self, now_ns: int) -> Verdict:
        """One tick of the liveliness check."""
        limit = DEAD_NS if self.hard_ns is None else self.hard_ns
        if not self._pings and now_ns - self._heard_ns < limit:
            return Verdict.ALIVE
        if self.hard_ns is None:
            return Verdict.SILENT
        if self._pings == PINGS:
            return Verdict.DELETE
        self._pings += 1
        return Verdict.PING

    def reset(self) -> None:
        """Every stream back to sequence number 0; entities and readings stay."""
        for streams in (self._best_in, self._reliable_in, self._best_out, self.reliable_out):
            for stream in streams.values():
                stream.reset()

    def accept(self, stream: int, sequence: int, body: bytes) -> list[bytes]:
        """The bodies that are to be handled now that a message came in."""
        if stream == NO_STREAM:
            return [body]
        if is_reliable(stream):
            return self.reliable_in(stream).receive(sequence, body)
        return [body] if self._best_in.setdefault(stream, BestEffortInput(stream)).receive(sequence) else []

    def reliable_in(self, stream: int) -> ReliableInput:
        """The incoming reliable stream of an id."""
        return self._reliable_in.setdefault(stream, ReliableInput(stream))

    def send(self, stream: int, submessage: Submessage, now_ns: int) -> list[bytes]:
        """The datagrams that bring a submessage to the client now; it is lost if the stream has no room."""
        body = encode_body([submessage])
        if stream == NO_STREAM:
            return [encode_header(self.header(NO_STREAM)) + body]
        if not is_reliable(stream):
            if len(body) > self._capacity:
                return []  # nothing can be fragmented here; no sequence number is used
            return [self.datagram(self._best_out.setdefault(stream, BestEffortOutput(stream)).send(body))]
        output = self._output(stream)
        if output.free:
            output.push(body)
        return [self.datagram(packet) for packet in output.take(now_ns)]

    def datagram(self, packet: Packet) -> bytes:
        """A message of a stream with its header."""
        return encode_header(self.header(packet.stream, packet.sequence)) + packet.body

    def read(self, request: ReadData, now_ns: int) -> bool:
        """Start or replace the reading of a data reader; False: there is no such reader."""
        reader = self.entities.reader(request.object)
        if reader is None:
            return False
        self.readings[request.object] = Reading(request, now_ns, reader.peek(now_ns) is not None)
        return True

    def deliver(self, now_ns: int) -> list[bytes]:
        """The datagrams of all samples that may be given now."""
        datagrams: list[bytes] = []
        for identifier, reading in list(self.readings.items()):
            reader = self.entities.reader(identifier)
            if reader is None or reading.over(now_ns):
                del self.readings[identifier]
                continue
            while not reading.over(now_ns) and self._has_room(reading.stream):
                sample = reader.peek(now_ns)
                if sample is None or reading.ready_ns(len(sample), now_ns) > now_ns:
                    break
                reader.pop()
                reading.give(len(sample), now_ns)
                datagrams += self.send(
                    reading.stream, Data(request=reading.request, object=reading.object, data=sample), now_ns
                )
        return datagrams

    def wakeup_ns(self, now_ns: int) -> int | None:
        """When `deliver` has something to do by time alone; None: not before something comes in."""
        times = []
        for identifier, reading in self.readings.items():
            reader = self.entities.reader(identifier)
            sample = reader.peek(now_ns) if reader is not None else None
            if sample is not None and self._has_room(reading.stream):
                times.append(reading.ready_ns(len(sample), now_ns))
        return min(times, default=None)

    @property
    def ticks(self) -> bool:
        """Whether the agent's periodic check has anything to do with this client."""
        return self.hard_ns is not None or any(not output.settled for output in self.reliable_out.values())

    def _has_room(self, stream: int) -> bool:
        return not is_reliable(stream) or self._output(stream).free > 0

    def _output(self, stream: int) -> ReliableOutput:
        if stream not in self.reliable_out:
            self.reliable_out[stream] = ReliableOutput(stream, self._capacity)
        return self.reliable_out[stream]
