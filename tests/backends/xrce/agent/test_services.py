"""Requesters and repliers of different clients, as eProsima's client makes and uses them."""

from __future__ import annotations

import struct

import pytest

from nros_backends.xrce.agent.command import describe_graph
from nros_backends.xrce.agent.descriptions import Refused, Service, Topic
from nros_backends.xrce.agent.services import OPEN
from nros_backends.xrce.agent.xml import parse
from nros_backends.xrce.wire import decode, encode
from nros_backends.xrce.wire import messages as m
from nros_backends.xrce.wire.binary import (
    EndpointQos,
    ParticipantBody,
    Qos,
    ServiceBody,
    TopicBody,
    decode_binary,
    encode_binary,
)
from nros_backends.xrce.wire.cdr import Malformed
from nros_backends.xrce.wire.ids import RELIABLE, Kind, ObjectId, Status
from tests.backends.xrce.agent.peer import PARTICIPANT as PARTICIPANT_ID
from tests.backends.xrce.agent.peer import READER, WRITER, Net, Peer, create

REQUESTER, REPLIER = ObjectId(1, Kind.REQUESTER), ObjectId(1, Kind.REPLIER)
BODY = ServiceBody("add", "Request_", "Reply_", "rq/addRequest", "rr/addReply")
NAMED = "<request_topic_name>rq/addRequest</request_topic_name><reply_topic_name>rr/addReply</reply_topic_name>"
# Without spaces between the attributes, as in eProsima's own examples.
XML = (
    '<dds><{0} profile_name="any"service_name="add"request_type="Request_"reply_type="Reply_">' + NAMED + "</{0}></dds>"
)
FORMS: dict[str, tuple[m.Representation, m.Representation]] = {
    "bin": (m.Binary(encode_binary(BODY)), m.Binary(encode_binary(BODY))),
    "xml": (m.Xml(XML.format("requester")), m.Xml(XML.format("replier"))),
    "ref": (m.Ref("shapetype_requester"), m.Ref("shapetype_replier")),
}
UNLIMITED = m.DeliveryControl()


def client(net: Net, number: int, target: ObjectId, body: m.Representation | ServiceBody, domain: int = 0) -> Peer:
    """A client with a participant, this requester or replier, and a READ_DATA for it with the request id 7."""
    peer = net.peer(key=0xBBBB0000 + number, port=number)
    assert peer.open() == Status.OK
    assert peer.status(create(PARTICIPANT_ID, ParticipantBody(), domain=domain)) == Status.OK
    assert peer.status(create(target, body, parent=PARTICIPANT_ID)) == Status.OK
    peer.post(m.ReadData(request=7, object=target, stream=1, delivery=UNLIMITED))
    return peer


def ask(peer: Peer, number: int, data: bytes) -> None:
    peer.post(m.WriteData(request=number, object=REQUESTER, data=data))


def answer(peer: Peer, data: bytes) -> None:
    peer.post(m.WriteData(request=99, object=REPLIER, data=data))


def received(peer: Peer) -> list[m.Data]:
    return [one for message in peer.look() for one in message.submessages if isinstance(one, m.Data)]


def reply_to(number: int, data: bytes) -> m.Data:
    return m.Data(request=7, object=REQUESTER, data=number.to_bytes(2, "big") + bytes([0x00, 0x17]) + data)


@pytest.mark.parametrize(
    ("asking", "answering"), [("bin", "bin"), ("bin", "xml"), ("xml", "bin"), ("xml", "xml"), ("ref", "ref")]
)
def test_a_request_is_answered_whatever_form_the_two_were_made_in(asking: str, answering: str) -> None:
    net = Net()
    replier = client(net, 1, REPLIER, FORMS[answering][1])
    requester = client(net, 2, REQUESTER, FORMS[asking][0])
    for number in range(40, 43):
        ask(requester, number, b"?" * number)
        (request,) = received(replier)
        assert (request.request, request.object, request.data[24:]) == (7, REPLIER, b"?" * number)
        answer(replier, request.data[:24] + b"!" * number)
        assert received(requester) == [reply_to(number, b"!" * number)]


def test_an_identity_is_a_guid_of_16_octets_and_a_number_that_counts() -> None:
    net = Net()
    replier, requester = client(net, 1, REPLIER, BODY), client(net, 2, REQUESTER, BODY)
    for number in range(2):
        ask(requester, number, b"x")
    first, second = (one.data[:24] for one in received(replier))
    assert first[:16] == second[:16]
    assert [struct.unpack("<iI", one[16:]) for one in (first, second)] == [(0, 1), (0, 2)]


def test_a_reply_goes_to_the_one_that_asked_and_to_nobody_else() -> None:
    net = Net()
    replier = client(net, 1, REPLIER, BODY)
    requesters = [client(net, number, REQUESTER, BODY) for number in (2, 3)]
    for requester in requesters:
        ask(requester, 20, b"?")
    requests = received(replier)
    assert len({one.data[:24] for one in requests}) == 2
    answer(replier, requests[1].data[:24] + b"second")
    assert [received(one) for one in requesters] == [[], [reply_to(20, b"second")]]
    answer(replier, requests[0].data[:24] + b"first")
    assert [received(one) for one in requesters] == [[reply_to(20, b"first")], []]


def test_replies_come_in_any_order_and_only_the_first_to_a_request() -> None:
    net = Net()
    repliers = [client(net, number, REPLIER, BODY) for number in (1, 2)]
    requester = client(net, 3, REQUESTER, BODY)
    for number in (20, 21):
        ask(requester, number, b"?")
    one, other = (received(replier) for replier in repliers)
    assert one == other
    answer(repliers[0], one[1].data[:24] + b"b")
    answer(repliers[1], one[0].data[:24] + b"a")
    answer(repliers[1], one[1].data[:24] + b"too late")
    assert received(requester) == [reply_to(21, b"b"), reply_to(20, b"a")]


def test_what_is_no_reply_reaches_nobody_and_harms_nothing() -> None:
    net = Net()
    replier, requester = client(net, 1, REPLIER, BODY), client(net, 2, REQUESTER, BODY)
    ask(requester, 20, b"?")
    (request,) = received(replier)
    for data in (b"", b"short", bytes(24), request.data[:16] + struct.pack("<iI", 0, 2), b"\xff" * 30):
        answer(replier, data)
    assert received(requester) == []
    answer(replier, request.data[:24])
    assert received(requester) == [reply_to(20, b"")]


def test_a_requester_that_was_made_anew_gets_no_reply_of_before() -> None:
    net = Net()
    replier, requester = client(net, 1, REPLIER, BODY), client(net, 2, REQUESTER, BODY)
    ask(requester, 20, b"?")
    (request,) = received(replier)
    assert requester.status(create(REQUESTER, BODY, parent=PARTICIPANT_ID, replace=True)) == Status.OK
    requester.post(m.ReadData(request=7, object=REQUESTER, stream=1, delivery=UNLIMITED))
    ask(requester, 21, b"?")
    answer(replier, request.data[:24] + b"stale")
    assert received(requester) == []


def test_an_agent_of_another_life_knows_no_request_of_the_former_one() -> None:
    identities = set()
    for _ in range(2):
        net = Net()
        replier, requester = client(net, 1, REPLIER, BODY), client(net, 2, REQUESTER, BODY)
        ask(requester, 20, b"?")
        identities.add(received(replier)[0].data[:24])
    assert len(identities) == 2


def test_requests_without_a_reply_are_not_kept_without_end() -> None:
    net = Net()
    replier, requester = client(net, 1, REPLIER, BODY), client(net, 2, REQUESTER, BODY)
    for number in range(OPEN + 1):
        ask(requester, number % 0x8000, b"?")
    requests = received(replier)
    answer(replier, requests[0].data[:24] + b"too late")
    answer(replier, requests[1].data[:24] + b"in time")
    assert received(requester) == [reply_to(1, b"in time")]


def test_services_of_two_domains_do_not_meet() -> None:
    net = Net()
    replier, requester = client(net, 1, REPLIER, BODY), client(net, 2, REQUESTER, BODY, domain=1)
    ask(requester, 20, b"?")
    assert received(replier) == []


def test_on_reliable_streams_large_requests_and_replies_go_in_fragments() -> None:
    net = Net()
    replier, requester = client(net, 1, REPLIER, BODY), client(net, 2, REQUESTER, BODY)
    for peer, target in ((replier, REPLIER), (requester, REQUESTER)):
        peer.post(m.ReadData(request=7, object=target, stream=RELIABLE, delivery=UNLIMITED))
    ask(requester, 20, b"?" * 1_000)
    pieces = [one for message in replier.look() for one in message.submessages if isinstance(one, m.Fragment)]
    whole = b"".join(piece.data for piece in pieces)
    assert len(pieces) == 3
    assert whole[-1_000:] == b"?" * 1_000
    answer(replier, whole[8:32] + b"!" * 1_000)
    pieces = [one for message in requester.look() for one in message.submessages if isinstance(one, m.Fragment)]
    assert b"".join(piece.data for piece in pieces)[8:] == reply_to(20, b"!" * 1_000).data


def test_a_reader_of_the_topic_of_requests_gets_them_bare() -> None:
    net = Net()
    requester = client(net, 2, REQUESTER, BODY)
    onlooker = net.peer(key=5, port=5)
    onlooker.open()
    onlooker.reader(EndpointQos(Qos.RELIABLE), TopicBody("rq/addRequest", None, "Request_"))
    onlooker.post(m.ReadData(request=7, object=READER, stream=1, delivery=UNLIMITED))
    ask(requester, 20, b"bare")
    assert [one.data for one in received(onlooker)] == [b"bare"]


def test_a_replier_answers_nobody_for_a_sample_of_a_plain_writer() -> None:
    net = Net()
    replier = client(net, 1, REPLIER, BODY)
    plain = net.peer(key=5, port=5)
    plain.open()
    plain.writer(EndpointQos(Qos.RELIABLE), TopicBody("rq/addRequest", None, "Request_"))
    plain.post(m.WriteData(request=20, object=WRITER, data=b"plain"))
    (request,) = received(replier)
    assert request.data[24:] == b"plain"
    answer(replier, request.data[:24] + b"to whom?")
    assert plain.look() == []


def test_creation_modes_errors_and_the_end() -> None:
    net = Net()
    peer = client(net, 1, REPLIER, BODY)
    other = ServiceBody("other", "Request_", "Reply_")
    assert peer.status(create(REPLIER, BODY, parent=PARTICIPANT_ID)) == Status.ALREADY_EXISTS
    assert peer.status(create(REPLIER, BODY, reuse=True, parent=PARTICIPANT_ID)) == Status.OK_MATCHED
    assert peer.status(create(REPLIER, other, reuse=True, parent=PARTICIPANT_ID)) == Status.MISMATCH
    assert peer.status(create(REQUESTER, BODY, parent=ObjectId(9, Kind.PARTICIPANT))) == Status.UNKNOWN_REFERENCE
    assert peer.status(create(REQUESTER, m.Ref("nobody"), parent=PARTICIPANT_ID)) == Status.DDS_ERROR
    assert peer.status(create(REQUESTER, m.Xml("<dds/>"), parent=PARTICIPANT_ID)) == Status.DDS_ERROR
    assert peer.status(create(REQUESTER, m.Binary(b"\1\0\0\0"), parent=PARTICIPANT_ID)) == Status.INVALID_DATA
    assert peer.status(m.Delete(request=1, object=REPLIER)) == Status.OK
    assert peer.status(m.Delete(request=1, object=REPLIER)) == Status.UNKNOWN_REFERENCE
    status = peer.send(m.ReadData(request=7, object=REPLIER, stream=1, delivery=UNLIMITED))[0].submessages[0]
    assert status == m.StatusReply(request=7, object=REPLIER, status=Status.UNKNOWN_REFERENCE)
    requester = client(net, 2, REQUESTER, BODY)
    ask(requester, 20, b"nobody is there")
    assert peer.look() == []


def test_the_graph_lists_services_with_the_topic_of_their_requests() -> None:
    net = Net()
    client(net, 1, REPLIER, BODY)
    client(net, 2, REQUESTER, BODY)
    client(net, 3, REQUESTER, BODY)
    assert describe_graph(net.agent.entities()) == [
        "6 entities",
        "  client bbbb0001 PARTICIPANT#1 domain 0",
        "  client bbbb0001 REPLIER#1 domain 0 on rq/addRequest (Request_), 2 matched",
        "  client bbbb0002 PARTICIPANT#1 domain 0",
        "  client bbbb0002 REQUESTER#1 domain 0 on rq/addRequest (Request_), 1 matched",
        "  client bbbb0003 PARTICIPANT#1 domain 0",
        "  client bbbb0003 REQUESTER#1 domain 0 on rq/addRequest (Request_), 1 matched",
    ]


def test_topics_without_names_are_called_after_the_service() -> None:
    text = '<dds><replier profile_name="any" service_name="add" request_type="Request_" reply_type="Reply_"/></dds>'
    described = parse(Kind.REPLIER, text)
    assert isinstance(described, Service)
    assert (described.request, described.reply) == (Topic("add_Request", "Request_"), Topic("add_Reply", "Reply_"))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("<dds><requester/></dds>", "a requester needs service_name, request_type and reply_type"),
        ("<dds><replier/></dds>", "no <requester> in the XML document"),
        ("", "not XML: no element found: line 1, column 0"),
    ],
)
def test_xml_that_describes_no_requester_is_refused(text: str, why: str) -> None:
    with pytest.raises(Refused, match=why):
        parse(Kind.REQUESTER, text)


def test_what_eprosimas_client_sends_for_a_requester_in_binary_form_is_understood() -> None:
    # Recorded of its version 3.0.1. The padding between the two topics is not cleared there.
    message = decode(
        bytes.fromhex(
            "8180000001051c00000a0011010300000d00000000010000050000006e6f64650000000001055200000b0017070300004400000004"
            "00000061646400050000005265715f00000000050000005265705f00018b9f0e00000072712f616464526571756573740001000c00"
            "000072722f6164645265706c790000110000"
        )
    )
    created = message.submessages[1]
    assert isinstance(created, m.Create)
    assert isinstance(created.representation, m.Binary)
    body, octets = ServiceBody("add", "Req_", "Rep_", "rq/addRequest", "rr/addReply"), created.representation.body
    assert decode_binary(Kind.REQUESTER, octets) == decode_binary(Kind.REPLIER, octets) == body
    assert encode_binary(body) == octets.replace(b"\x8b\x9f", bytes(2))
    for end in range(len(octets)):
        with pytest.raises(Malformed):
            decode_binary(Kind.REQUESTER, octets[:end])
    peer = Net().peer()
    peer.open()
    replies = [one for reply in peer.raw(encode(message)) for one in reply.submessages]
    assert [one.status for one in replies if isinstance(one, m.StatusReply)] == [Status.OK, Status.OK]
