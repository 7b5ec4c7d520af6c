"""Hand-driven clients at the agent's core, on a clock that only moves when told to."""

from __future__ import annotations

from nros_backends.xrce.agent.core import Agent, Outgoing
from nros_backends.xrce.wire import Header, Message, decode, encode
from nros_backends.xrce.wire import messages as m
from nros_backends.xrce.wire.binary import (
    Body,
    EndpointQos,
    GroupBody,
    ParticipantBody,
    Qos,
    ReaderBody,
    TopicBody,
    WriterBody,
    encode_binary,
)
from nros_backends.xrce.wire.ids import AGENT, BEST_EFFORT, NO_SESSION, NO_STREAM, Kind, ObjectId

MS = 1_000_000
KEEP_ALL = EndpointQos(Qos.RELIABLE)
TOPIC = TopicBody("Square", None, "ShapeType")


def oid(kind: Kind, number: int = 1) -> ObjectId:
    return ObjectId(number, kind)


PARTICIPANT, SQUARE, PUBLISHER, SUBSCRIBER, WRITER, READER = (oid(Kind(number)) for number in range(1, 7))
PARENTS = {
    Kind.TOPIC: PARTICIPANT, Kind.PUBLISHER: PARTICIPANT, Kind.SUBSCRIBER: PARTICIPANT,
    Kind.DATAWRITER: PUBLISHER, Kind.DATAREADER: SUBSCRIBER,
}  # fmt: skip


def create(
    target: ObjectId, body: Body | m.Representation, *, request: int = 10, parent: ObjectId | None = None,
    domain: int = 0, reuse: bool = False, replace: bool = False,
) -> m.Create:  # fmt: skip
    representation = body if isinstance(body, m.Ref | m.Xml | m.Binary) else m.Binary(encode_binary(body))
    return m.Create(
        request=request, object=target, kind=target.kind, representation=representation,
        parent=parent or PARENTS.get(target.kind), domain=domain, reuse=reuse, replace=replace,
    )  # fmt: skip


class Net:
    """An agent and its clients; time only moves when told to."""

    def __init__(self) -> None:
        self.agent = Agent(wall_clock=lambda: 1_000_000_005)
        self.now = 0
        self.peers: dict[tuple[str, int], Peer] = {}

    def peer(self, key: int = 0xAAAABBBB, port: int = 1, session: int = 0x81) -> Peer:
        peer = Peer(self, key, ("127.0.0.1", port), session)
        self.peers[peer.address] = peer
        return peer

    def carry(self, outgoing: list[Outgoing]) -> None:
        for datagram, address in outgoing:
            self.peers[address].inbox.append(decode(datagram))

    def advance(self, ms: int) -> None:
        """Let milliseconds pass, waking the agent when it wants to be woken."""
        until = self.now + ms * MS
        while (due := self.agent.wakeup_ns(self.now)) is not None and due <= until:
            assert due >= self.now
            self.now = due
            self.carry(self.agent.advance(due))
        self.now = until


class Peer:
    """One client of a `Net`. ``inbox``: what came and was not looked at."""

    def __init__(self, net: Net, key: int, address: tuple[str, int], session: int) -> None:
        self.net = net
        self.key = key
        self.address = address
        self.session = session
        self.inbox: list[Message] = []
        self._next = dict.fromkeys(range(0x100), 0)

    def open(self, *properties: tuple[str, str], mtu: int = 508, cookie: bytes = b"XRCE", major: int = 1) -> int:
        """CREATE_CLIENT; the status that answers it."""
        request = m.CreateClient(
            key=self.key, session=self.session, mtu=mtu, properties=properties, cookie=cookie, version=(major, 0)
        )
        header = Header(NO_SESSION) if self.session >= 0x80 else Header(0, key=self.key)
        (reply,) = self.raw(encode(Message(header, (request,))))
        assert isinstance(reply.submessages[0], m.StatusAgent)
        self._next = dict.fromkeys(range(0x100), 0)
        return reply.submessages[0].status

    def raw(self, datagram: bytes) -> list[Message]:
        """Send bytes; everything that came for this client until then."""
        self.net.carry(self.net.agent.receive(datagram, self.address, self.net.now))
        return self.look()

    def post(self, *submessages: m.Submessage, stream: int = BEST_EFFORT) -> None:
        """Send; what came stays in the inbox."""
        came = self.send(*submessages, stream=stream)
        self.inbox += came

    def send(self, *submessages: m.Submessage, stream: int = BEST_EFFORT) -> list[Message]:
        return self.raw(encode(self.message(*submessages, stream=stream)))

    def message(self, *submessages: m.Submessage, stream: int = BEST_EFFORT) -> Message:
        sequence = self._next[stream]
        if stream != NO_STREAM:
            self._next[stream] = (sequence + 1) % 0x10000
        key = self.key if self.session < 0x80 else None
        return Message(Header(self.session, stream, sequence, key), submessages)

    def look(self) -> list[Message]:
        inbox, self.inbox = self.inbox, []
        return inbox

    def status(self, submessage: m.Submessage, stream: int = BEST_EFFORT) -> int:
        """The STATUS that answers a request."""
        (found,) = [
            one
            for message in self.send(submessage, stream=stream)
            for one in message.submessages
            if isinstance(one, m.StatusReply)
        ]
        return found.status

    def reader(self, qos: EndpointQos = KEEP_ALL, topic: TopicBody = TOPIC, domain: int = 0) -> None:
        self.base(topic, domain)
        assert self.status(create(SUBSCRIBER, GroupBody(), replace=True)) == 0
        assert self.status(create(READER, ReaderBody(SQUARE, qos), replace=True)) == 0

    def writer(self, qos: EndpointQos = KEEP_ALL, topic: TopicBody = TOPIC, domain: int = 0) -> None:
        self.base(topic, domain)
        assert self.status(create(PUBLISHER, GroupBody(), replace=True)) == 0
        assert self.status(create(WRITER, WriterBody(SQUARE, qos), replace=True)) == 0

    def base(self, topic: TopicBody = TOPIC, domain: int = 0) -> None:
        assert self.status(create(PARTICIPANT, ParticipantBody(), domain=domain, replace=True)) == 0
        assert self.status(create(SQUARE, topic, replace=True)) == 0

    def read(self, control: m.DeliveryControl | None = None, stream: int = BEST_EFFORT) -> None:
        """READ_DATA, by default without limit; what came stays in the inbox."""
        control = control or m.DeliveryControl()
        self.post(m.ReadData(request=7, object=READER, stream=stream, delivery=control))

    def write(self, *samples: bytes) -> None:
        for data in samples:
            self.post(m.WriteData(request=20, object=WRITER, data=data))

    def samples(self) -> list[bytes]:
        """The data that came since the last look, in order; the rest is dropped."""
        return [one.data for message in self.look() for one in message.submessages if isinstance(one, m.Data)]

    def ping(self) -> int:
        """The implementation status by the in-session ping."""
        (reply,) = self.send(m.GetInfo(request=10, object=AGENT, mask=m.ACTIVITY), stream=NO_STREAM)
        assert isinstance(reply.submessages[0], m.Info)
        return reply.submessages[0].implementation
