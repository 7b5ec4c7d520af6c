from __future__ import annotations

import socket
import time
from collections.abc import Iterator

import pytest

from nros_backends.xrce.agent.server import AgentServer
from nros_backends.xrce.client.client import Client, Sent, ping_agent
from nros_backends.xrce.client.core import MTU, Config
from nros_backends.xrce.client.health import State
from nros_backends.xrce.client.transport import Transport, open_socket
from nros_backends.xrce.wire import Header, Message, decode, encode
from nros_backends.xrce.wire import messages as m
from nros_backends.xrce.wire.binary import GroupBody, ParticipantBody, ReaderBody, TopicBody, WriterBody, encode_binary
from nros_backends.xrce.wire.ids import AGENT, CLIENT, Kind, ObjectId, Status
from nros_conformance.rmw.clock import MS, MonotonicClock

CLOCK = MonotonicClock()
PARTICIPANT, TOPIC = ObjectId(1, Kind.PARTICIPANT), ObjectId(1, Kind.TOPIC)
PUBLISHER, SUBSCRIBER = ObjectId(1, Kind.PUBLISHER), ObjectId(1, Kind.SUBSCRIBER)
WRITER, READER = ObjectId(1, Kind.DATAWRITER), ObjectId(1, Kind.DATAREADER)
SECOND = 1_000 * MS


class Fake:
    """An agent that does what a test tells it to."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.1)

    def messages(self) -> list[Message]:
        """What has come so far."""
        found: list[Message] = []
        self.socket.setblocking(False)
        while True:
            try:
                datagram, self.client = self.socket.recvfrom(65_536)
            except BlockingIOError:
                return found
            found.append(decode(datagram))


@pytest.fixture
def server() -> Iterator[AgentServer]:
    with AgentServer() as running:
        yield running


@pytest.fixture
def fake() -> Iterator[Fake]:
    made = Fake()
    yield made
    made.socket.close()


def client_of(address: tuple[str, int], received: list[bytes], key: int = 1, session: int = 0x81) -> Client:
    transport = Transport(open_socket(address))
    return Client(transport, CLOCK, Config(key, session), lambda data, at_ns: received.append(data.data))


@pytest.fixture
def client(server: AgentServer) -> Iterator[Client]:
    made = client_of(server.address, [])
    assert made.connect() == Status.OK
    yield made
    made._transport.close()


def create(client: Client, *wanted: tuple[ObjectId, m.Representation, ObjectId | None]) -> list[int | None]:
    requests = [client.create(one, form, parent=parent) for one, form, parent in wanted]
    return client.outcomes(requests, CLOCK.now_ns() + 10 * SECOND)


BINARY: tuple[tuple[ObjectId, m.Representation, ObjectId | None], ...] = (
    (PARTICIPANT, m.Binary(encode_binary(ParticipantBody(None, "node"))), None),
    (TOPIC, m.Binary(encode_binary(TopicBody("topic", type_name="type"))), PARTICIPANT),
    (PUBLISHER, m.Binary(encode_binary(GroupBody())), PARTICIPANT),
    (WRITER, m.Binary(encode_binary(WriterBody(TOPIC))), PUBLISHER),
    (SUBSCRIBER, m.Binary(encode_binary(GroupBody())), PARTICIPANT),
    (READER, m.Binary(encode_binary(ReaderBody(TOPIC))), SUBSCRIBER),
)
_END = "<topic><name>topic</name><dataType>type</dataType></topic>"
XML: tuple[tuple[ObjectId, m.Representation, ObjectId | None], ...] = (
    (PARTICIPANT, m.Xml("<dds><participant><rtps><name>node</name></rtps></participant></dds>"), None),
    (TOPIC, m.Xml(f"<dds>{_END}</dds>"), PARTICIPANT),
    (PUBLISHER, m.Xml("<dds><publisher/></dds>"), PARTICIPANT),
    (WRITER, m.Xml(f"<dds><data_writer>{_END}</data_writer></dds>"), PUBLISHER),
    (SUBSCRIBER, m.Xml("<dds><subscriber/></dds>"), PARTICIPANT),
    (READER, m.Xml(f"<dds><data_reader>{_END}</data_reader></dds>"), SUBSCRIBER),
)


@pytest.mark.parametrize("form", [BINARY, XML], ids=["binary", "xml"])
@pytest.mark.parametrize("reliable", [True, False])
def test_a_sample_goes_through_the_agent_and_comes_back(
    server: AgentServer, form: tuple[tuple[ObjectId, m.Representation, ObjectId | None], ...], reliable: bool
) -> None:
    received: list[bytes] = []
    client = client_of(server.address, received)
    assert client.connect() == Status.OK
    assert create(client, *form) == [Status.OK] * 6
    client.read(READER, reliable=reliable)
    assert client.settle(CLOCK.now_ns() + 10 * SECOND)
    assert client.write(WRITER, b"one", reliable=reliable) is Sent.OK
    assert client.pump(lambda: bool(received), CLOCK.now_ns() + 10 * SECOND)
    assert received == [b"one"]
    assert client.disconnect() == Status.OK
    client._transport.close()


def test_entities_by_reference_are_as_the_agent_says(client: Client) -> None:
    assert create(client, (PARTICIPANT, m.Ref("no such profile"), None)) == [Status.DDS_ERROR]


def test_a_session_with_the_key_in_every_message(server: AgentServer) -> None:
    client = client_of(server.address, [], key=0xCAFE, session=0x01)
    assert client.connect() == Status.OK
    assert create(client, *BINARY) == [Status.OK] * 6
    assert client.ping(10 * SECOND)
    client._transport.close()


def test_large_samples_are_cut_and_joined(server: AgentServer) -> None:
    received: list[bytes] = []
    client = client_of(server.address, received)
    client.connect()
    create(client, *BINARY)
    client.read(READER, reliable=True)
    sizes = [MTU - 12, MTU - 11, 2_009, 70_000]
    for size in sizes:
        assert client.write(WRITER, bytes(size), reliable=True) is Sent.OK
    assert client.pump(lambda: len(received) == len(sizes), CLOCK.now_ns() + 20 * SECOND)
    assert [len(one) for one in received] == sizes
    client._transport.close()


def test_best_effort_has_to_fit_one_message(client: Client) -> None:
    assert client.write(WRITER, bytes(MTU - 12), reliable=False) is Sent.OK
    assert client.write(WRITER, bytes(MTU - 11), reliable=False) is Sent.TOO_LARGE


def test_without_an_agent_it_asks_as_often_as_told(fake: Fake) -> None:
    client = client_of(fake.socket.getsockname(), [])
    begin = time.monotonic()
    assert client.connect(attempts=3, attempt_ns=30 * MS) is None
    assert time.monotonic() - begin >= 0.09
    assert [type(one.submessages[0]) for one in fake.messages()] == [m.CreateClient] * 3
    client._transport.close()


def test_a_full_window_takes_no_more_samples(fake: Fake) -> None:
    client = client_of(fake.socket.getsockname(), [])
    answers = [client.write(WRITER, b"x", reliable=True) for _ in range(17)]
    assert answers == [Sent.OK] * 16 + [Sent.FULL]
    client._transport.close()


def test_pings(server: AgentServer, client: Client) -> None:
    assert client.ping(10 * SECOND)
    transport = Transport(open_socket(server.address))
    assert ping_agent(transport, CLOCK, 10 * SECOND)
    transport.close()
    assert client.disconnect() == Status.OK
    assert not client.ping(10 * SECOND)  # it answers, but does not know the session


def test_only_the_answer_to_this_very_probe_counts(fake: Fake) -> None:
    client = client_of(fake.socket.getsockname(), [])
    assert not client.ping(20 * MS)
    (probe,) = (one.submessages[0] for one in fake.messages())
    assert isinstance(probe, m.GetInfo)
    stale = m.Info(request=probe.request, object=AGENT, implementation=1)
    fake.socket.sendto(encode(Message(Header(0x81), (stale,))), fake.client)
    assert not client.ping(20 * MS)
    client._transport.close()


def test_synchronises_time_with_the_agent(client: Client) -> None:
    offset = client.sync_time(10 * SECOND)
    assert offset is not None
    assert abs(offset) < SECOND  # the same clock on both sides


def test_answers_the_agents_pings_also_as_the_recorded_client_does(fake: Fake) -> None:
    for bare, expected in ((False, m.Info(request=0, object=CLIENT)), (True, m.LivelinessAnswer())):
        transport = Transport(open_socket(fake.socket.getsockname()))
        client = Client(transport, CLOCK, Config(1, bare_answer=bare), lambda data, at_ns: None)
        client.core.delete_client()
        client.service()
        fake.messages()
        ping = m.GetInfo(request=0, object=CLIENT, mask=m.CONFIGURATION)
        fake.socket.sendto(encode(Message(Header(0x81), (ping,))), fake.client)
        client.wait(CLOCK.now_ns() + 10 * SECOND)
        client.service()
        assert [one.submessages[0] for one in fake.messages()] == [expected]
        transport.close()


def test_datagrams_of_other_sessions_are_ignored(fake: Fake) -> None:
    received: list[bytes] = []
    client = client_of(fake.socket.getsockname(), received)
    client.core.delete_client()
    client.service()
    fake.messages()
    data = m.Data(request=10, object=READER, data=b"sample")
    for session in (0x82, 0x81):
        fake.socket.sendto(encode(Message(Header(session, 0x01, 0), (data,))), fake.client)
    assert client.pump(lambda: bool(received), CLOCK.now_ns() + 10 * SECOND)
    client.service()
    assert received == [b"sample"]
    assert client.core.foreign == 1
    client._transport.close()


def test_a_request_whose_answer_the_agent_threw_away_is_repeated(fake: Fake) -> None:
    client = client_of(fake.socket.getsockname(), [])
    request = client.create(PARTICIPANT, BINARY[0][1])
    (first,) = fake.messages()
    acknowledged = m.Acknack(first_unacked=1, missing=0, stream=0x80)
    fake.socket.sendto(encode(Message(Header(0x81), (acknowledged,))), fake.client)
    assert client.outcomes([request], CLOCK.now_ns() + 200 * MS) == [None]
    again = next(one for one in fake.messages() if one.header.stream == 0x80)
    (create_first,), (create_again,) = first.submessages, again.submessages
    assert isinstance(create_first, m.Create)
    assert isinstance(create_again, m.Create)
    assert not create_first.reuse
    assert create_again.reuse
    assert create_again.request == create_first.request
    client._transport.close()


def test_an_agent_that_restarts_has_forgotten_the_session(server: AgentServer, client: Client) -> None:
    server.close()
    with AgentServer(server.address[1]):
        assert client.pump(lambda: client.health.state is State.FORGOTTEN, CLOCK.now_ns() + 10 * SECOND)


def test_an_agent_that_is_gone_falls_silent(server: AgentServer, client: Client) -> None:
    begin = CLOCK.now_ns()
    server.close()
    assert client.pump(lambda: client.health.state is State.SILENT, begin + 10 * SECOND)
    assert CLOCK.now_ns() - begin >= SECOND // 2
