from __future__ import annotations

import random
import tracemalloc

import pytest

from nros_backends.xrce.wire import Header, Message, encode
from nros_backends.xrce.wire import messages as m
from nros_backends.xrce.wire.binary import GroupBody, ParticipantBody, ReaderBody, ServiceBody, WriterBody
from nros_backends.xrce.wire.ids import CLIENT, RELIABLE, Kind, ObjectId, Status
from tests.backends.xrce.agent.peer import (
    PARTICIPANT,
    PUBLISHER,
    READER,
    SQUARE,
    SUBSCRIBER,
    TOPIC,
    WRITER,
    Net,
    Peer,
    create,
)
from tests.backends.xrce.captures import conversations

MUTATIONS = 10_000


def mutate(datagram: bytes, chance: random.Random) -> bytes:
    changed = bytearray(datagram)
    for _ in range(chance.randint(1, 4)):
        if not changed:
            break
        place = chance.randrange(len(changed))
        match chance.randrange(6):
            case 0:
                changed[place] = chance.randrange(256)
            case 1:
                changed[place] ^= 1 << chance.randrange(8)
            case 2:
                del changed[place:]
            case 3:
                changed[place:place] = chance.randbytes(chance.randint(1, 8))
            case 4:
                changed[place : place + 4] = chance.choice((b"\xff" * 4, b"\xff\xff\xff\x7f", bytes(4), b"\1\2\2\2"))
            case _:
                del changed[place : place + chance.randint(1, 4)]
    return bytes(changed)


SERVICES = [
    encode(Message(Header(0x81), (submessage,)))
    for kind in (Kind.REQUESTER, Kind.REPLIER)
    for submessage in (
        create(ObjectId(1, kind), ServiceBody("add", "Request_", "Reply_"), parent=PARTICIPANT, replace=True),
        create(ObjectId(1, kind), m.Ref(f"shapetype_{kind.name.lower()}"), parent=PARTICIPANT, replace=True),
        m.ReadData(request=7, object=ObjectId(1, kind), stream=1, delivery=m.DeliveryControl()),
        m.WriteData(request=20, object=ObjectId(1, kind), data=bytes(32)),
    )
]
"""Of services nothing was recorded."""


def test_ten_thousand_mutated_datagrams_neither_end_nor_hang_nor_bloat_the_agent() -> None:
    chance = random.Random(20261122)
    recorded = [one.payload for talk in conversations().values() for one in talk.datagrams if one.to_agent]
    recorded += SERVICES * (len(recorded) // 100)
    net = Net()
    mutants = [net.peer(port, port) for port in range(1, 5)]
    healthy = net.peer(0x1234, 99)
    healthy.open()
    healthy.writer()
    healthy.reader()
    healthy.read()
    answers = 0
    tracemalloc.start()
    try:
        for number in range(MUTATIONS):
            peer = mutants[number % len(mutants)]
            if number % 20 == 0:
                peer.raw(chance.choice(recorded))
            for reply in peer.raw(mutate(chance.choice(recorded), chance)):
                answers += 1
                assert reply.submessages  # what we send is well-formed, or decoding it had failed
            if number % 100 == 0:
                net.advance(50)
            for other in mutants:
                other.look()
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 32 << 20
    assert answers > MUTATIONS // 20
    healthy.look()
    healthy.write(b"still here")
    assert healthy.samples() == [b"still here"]


@pytest.fixture
def peer() -> Peer:
    peer = Net().peer()
    peer.open()
    peer.writer()
    peer.reader()
    return peer


def statuses(replies: list[Message]) -> list[int]:
    return [one.status for reply in replies for one in reply.submessages if isinstance(one, m.StatusReply)]


@pytest.mark.parametrize(
    ("request_", "status"),
    [
        # a bool that is neither 0 nor 1 in READ_DATA, in a publisher's and in a writer's body
        ("08010800" "0007" "0016" "01000200", Status.INVALID_DATA),
        ("01050e00" "0007" "0023" "0303" "0000" "02000000" "0200" "0011", Status.INVALID_DATA),
        ("01051100" "0007" "0025" "0503" "0000" "05000000" "0012ff0000" "0013", Status.INVALID_DATA),
        # a body that ends too early
        ("01050f00" "0007" "0025" "0503" "0000" "03000000" "001201" "0013", Status.INVALID_DATA),
        # 2 GB of body that are not there
        ("01050e00" "0007" "0025" "0503" "0000" "ffffff7f" "0012" "0013", Status.INVALID_DATA),
        # 2^31 partitions
        ("01051400" "0007" "0023" "0303" "0000" "08000000" "01000000ffffff7f" "0011" + "0000", Status.INVALID_DATA),
        # a representation format and an object kind that do not exist
        ("01050e00" "0007" "0023" "0309" "0000" "02000000" "0000" "0011", Status.INVALID_DATA),
        ("01050e00" "0007" "0023" "ff03" "0000" "02000000" "0000" "0011", Status.INVALID_DATA),
    ],
)  # fmt: skip
def test_what_crashed_the_original_is_answered_with_a_status(peer: Peer, request_: str, status: Status) -> None:
    before = peer.net.agent.entities()
    head = encode(peer.message(stream=RELIABLE))
    assert statuses(peer.raw(head + bytes.fromhex(request_))) == [status]
    assert peer.net.agent.entities() == before


@pytest.mark.parametrize("length", [1, 2, 3])
def test_a_write_data_too_short_to_name_a_writer_is_ignored(peer: Peer, length: int) -> None:
    head = encode(peer.message())
    assert peer.raw(head + bytes((7, 1, length, 0)) + bytes(length)) == []
    assert peer.ping() == 1


@pytest.mark.parametrize("value", [2, 0xFF])
def test_a_create_client_with_a_bool_of_neither_kind_is_refused(value: int) -> None:
    net = Net()
    peer = net.peer()
    datagram = bytearray.fromhex("8000000000011000585243450100010faaaabbbb8100fc01")
    datagram[21] = value
    (reply,) = peer.raw(bytes(datagram))
    assert reply == Message(Header(0x81), (m.StatusAgent(status=Status.INVALID_DATA),))
    assert net.agent.clients == ()


def test_two_billion_properties_cost_nothing() -> None:
    net = Net()
    (reply,) = net.peer().raw(bytes.fromhex("8000000000011800585243450100010faaaabbbb81010000ffffff7f00000000"))
    assert reply.submessages == (m.StatusAgent(status=Status.INVALID_DATA),)


def test_after_a_submessage_that_fails_the_rest_of_its_message_is_dropped(peer: Peer) -> None:
    peer.read()
    good = m.WriteData(request=1, object=WRITER, data=b"good")
    for bad in (
        m.WriteData(request=1, object=ObjectId(9, Kind.DATAWRITER), data=b"x"),
        m.WriteData(request=1, object=WRITER, data=b"x", format=2),
        m.Unknown(id=32, flags=0, payload=b"1234"),
        m.StatusReply(request=1, object=WRITER, status=0),
    ):
        peer.post(good, bad, good)
        assert peer.samples() == [b"good"]


def test_a_request_that_fails_does_not_drop_the_rest(peer: Peer) -> None:
    gone = m.Delete(request=1, object=ObjectId(9, Kind.DATAREADER))
    unread = m.ReadData(request=2, object=ObjectId(9, Kind.DATAREADER), stream=1)
    there = m.Delete(request=3, object=READER)
    assert sorted(statuses(peer.send(gone, unread, there))) == [0, 0x84, 0x84]


def test_fragments_on_a_best_effort_stream_mean_nothing(peer: Peer) -> None:
    peer.read()
    body = m.Fragment(data=bytes.fromhex("0701050000010015") + b"x", last=True)
    peer.post(body)
    assert peer.samples() == []


def test_nothing_is_kept_of_a_client_that_said_goodbye_within_a_burst(peer: Peer) -> None:
    other = peer.net.peer(5, 5)
    other.open()
    other.base()
    for target, body in ((SUBSCRIBER, GroupBody()), (READER, ReaderBody(SQUARE))):
        assert other.status(create(target, body)) == Status.OK
    writers = [
        create(PARTICIPANT, ParticipantBody()), create(SQUARE, TOPIC), create(PUBLISHER, GroupBody()),
        create(WRITER, WriterBody(SQUARE)),
    ]  # fmt: skip
    late = Message(Header(0x81, RELIABLE, 1), tuple(writers))
    goodbye = Message(Header(0x81, RELIABLE, 0), (m.Delete(request=2, object=CLIENT),))
    for message in (late, goodbye):
        peer.raw(encode(message))
    assert peer.net.agent.clients == (5,)
    assert [one.matched for one in peer.net.agent.entities()] == [0, 0, 0, 0]


def test_after_a_body_that_is_malformed_the_rest_of_its_message_is_dropped(peer: Peer) -> None:
    broken = m.Create(
        request=1, object=ObjectId(2, Kind.PUBLISHER), kind=Kind.PUBLISHER, representation=m.Binary(b"\2"),
        parent=PARTICIPANT,
    )  # fmt: skip
    assert statuses(peer.send(broken, m.Delete(request=2, object=WRITER))) == [Status.INVALID_DATA]
