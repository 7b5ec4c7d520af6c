"""Plays the agent's half of a recorded conversation to our client, on a clock of its own.

What the recorded application asked of its client, ours is asked for at the same times: sessions, entities,
samples, pings. What the client does by itself (acknowledging, announcing, sending again, answering the
agent's pings) ours has to do by itself too.
"""

from __future__ import annotations

import dataclasses

from nros_backends.xrce.client.core import HEARTBEAT_NS, LIVELINESS, Config, Core
from nros_backends.xrce.wire import Message, Submessage, decode, decode_body
from nros_backends.xrce.wire import messages as m
from tests.backends.xrce.captures import Conversation, Datagram

PING = 10
"""Request id of all pings of eProsima's client."""


@dataclasses.dataclass
class Played:
    """What one client sent and got. ``heard``: what came out of it to the application."""

    sent: list[Message]
    heard: list[Submessage]
    core: Core


@dataclasses.dataclass(frozen=True)
class Special:
    """In what a conversation is played differently, and why.

    ``asleep``: nanoseconds between which the application did not run its session; what comes is read at the end.
    """

    why: str
    asleep: tuple[int, int] = (0, 0)


EXCEPTIONS = {
    "hard_liveliness_silent": Special(
        "the application did not run its session for 4 s", asleep=(670_000, 4_001_000_000)
    ),
}


def clients(conversation: Conversation) -> list[int]:
    return sorted({one.peer for one in conversation.datagrams})


def play(conversation: Conversation, peer: int) -> Played:
    """Our client in the place of the recorded one at this endpoint."""
    special = EXCEPTIONS.get(conversation.name, Special(""))
    mine = _moved(conversation, peer, special)
    player = _Player(_bodies([one for one in mine if one.to_agent]))
    for datagram in mine:
        player.step(datagram)
    return Played([_plain(decode(one)) for one in player.sent], player.heard, player.core)


def recorded(conversation: Conversation, peer: int) -> list[Message]:
    """What the recorded client sent."""
    return [_plain(decode(one.payload)) for one in conversation.datagrams if one.to_agent and one.peer == peer]


def automatic(message: Message) -> bool:
    """Whether the client sends such by itself: how many, and when, depends on scheduling."""
    return isinstance(message.submessages[0], m.Acknack | m.Heartbeat)


def _plain(message: Message) -> Message:
    """Without what may differ: request ids of pings, padding at the end."""
    return Message(message.header, tuple(_plain_submessage(one) for one in message.submessages))


def _plain_submessage(one: Submessage) -> Submessage:
    match one:
        case m.GetInfo(object=asked, mask=mask):
            return m.GetInfo(request=PING, object=asked, mask=mask)
        case m.Fragment(data=data, last=True):  # the recorded client pads before it cuts
            return m.Fragment(data=data.rstrip(b"\0"), last=True)
    return one


def _moved(conversation: Conversation, peer: int, special: Special) -> list[Datagram]:
    begin, end = special.asleep
    late = [
        one._replace(at_ns=end) if not one.to_agent and begin < one.at_ns < end else one
        for one in conversation.datagrams
        if one.peer == peer
    ]
    return sorted(late, key=lambda one: one.at_ns)


def _bodies(sent: list[Datagram]) -> dict[int, tuple[Submessage, ...]]:
    """What was cut into fragments, by the sequence number of the first."""
    found: dict[int, tuple[Submessage, ...]] = {}
    pieces: dict[int, m.Fragment] = {}
    for one in sent:
        message = decode(one.payload)
        match message.submessages:
            case (m.Fragment() as piece,):
                pieces.setdefault(message.header.sequence, piece)
    first, body = 0, b""
    for sequence in sorted(pieces):
        first = first if body else sequence
        body += pieces[sequence].data
        if pieces[sequence].last:
            found[first] = decode_body(body)
            body = b""
    return found


class _Player:
    def __init__(self, bodies: dict[int, tuple[Submessage, ...]]) -> None:
        self._bodies = bodies
        self.sent: list[bytes] = []
        self.heard: list[Submessage] = []
        self.core = self._make(Config(key=1, bare_answer=True))
        self._config: Config | None = None
        self._asked: set[tuple[int, int]] = set()

    def step(self, datagram: Datagram) -> None:
        now = datagram.at_ns
        self._tick(now)
        if datagram.to_agent:
            self._ask(decode(datagram.payload), now)
        elif not datagram.dropped:
            self.core.receive(datagram.payload, now)
        self.core.tick(now)
        self._collect()

    def _make(self, config: Config) -> Core:
        return Core(
            config,
            lambda data, at_ns: self.heard.append(data),
            lambda reply, at_ns: self.heard.append(reply),
        )

    def _tick(self, until: int) -> None:
        while (due := self.core.next_due_ns) <= until:
            self.core.tick(due)
            self._collect()

    def _collect(self) -> None:
        self.sent += self.core.outbox
        self.core.outbox = []

    def _ask(self, message: Message, now: int) -> None:
        """Have our client do what made the recorded one send this, unless it was by itself."""
        header = message.header
        if header.stream == 0:
            for one in message.submessages:
                self._control(one, in_session=header.session != 0x80)
            return
        if (header.stream, header.sequence) in self._asked:
            return  # sent again
        self._asked.add((header.stream, header.sequence))
        submessages = message.submessages
        if isinstance(submessages[0], m.Fragment):
            if header.sequence not in self._bodies:
                return  # one of the others, which went with the first
            submessages = self._bodies[header.sequence]
        assert self.core.send(*submessages, reliable=header.stream >= 0x80, now_ns=now)

    def _control(self, one: Submessage, *, in_session: bool) -> None:
        match one:
            case m.CreateClient():
                config = Config(
                    one.key, one.session, one.mtu, int(dict(one.properties).get(LIVELINESS, "0")),
                    HEARTBEAT_NS, bare_answer=True,
                )  # fmt: skip
                if config != self._config:
                    self._config, self.core = config, self._make(config)
                self._asked.clear()
                self.core.create_client()
            case m.Delete():
                self.core.delete_client()
            case m.GetInfo():
                self.core.ping(in_session=in_session)
            case m.Timestamp(transmit=transmit):
                self.core.timestamp(transmit.ns)
