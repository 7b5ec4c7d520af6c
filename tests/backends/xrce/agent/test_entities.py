from __future__ import annotations

import time

import pytest

from nros_backends.xrce.agent.core import EntityInfo
from nros_backends.xrce.agent.descriptions import Endpoint, Group, Participant, Refused, Topic
from nros_backends.xrce.agent.exchange import TopicKey
from nros_backends.xrce.agent.qos import READER, WRITER, Durability, EntityQos, Liveliness
from nros_backends.xrce.agent.xml import parse
from nros_backends.xrce.wire import messages as m
from nros_backends.xrce.wire.binary import EndpointQos, GroupBody, ParticipantBody, Qos, ReaderBody, WriterBody
from nros_backends.xrce.wire.ids import BEST_EFFORT, NO_STREAM, RELIABLE, Kind, ObjectId, Status
from tests.backends.xrce.agent.peer import (
    PARTICIPANT,
    PUBLISHER,
    SQUARE,
    SUBSCRIBER,
    Net,
    Peer,
    create,
)
from tests.backends.xrce.agent.peer import READER as READER_ID
from tests.backends.xrce.agent.peer import WRITER as WRITER_ID

MS = 1_000_000
WRITER_XML = (
    "<dds><data_writer><topic><kind>NO_KEY</kind><name>{}</name><dataType>{}</dataType></topic></data_writer></dds>"
)


@pytest.fixture
def peer() -> Peer:
    peer = Net().peer()
    peer.open()
    peer.base()
    return peer


def test_a_status_comes_on_the_kind_of_stream_of_its_request(peer: Peer) -> None:
    for stream, expected in ((RELIABLE, RELIABLE), (0x85, RELIABLE), (0x03, BEST_EFFORT), (NO_STREAM, BEST_EFFORT)):
        reply = peer.send(create(PUBLISHER, GroupBody(), replace=True), stream=stream)[0]
        assert reply.header.stream == expected


@pytest.mark.parametrize(
    ("reuse", "replace", "same", "other"),
    [
        (False, False, Status.ALREADY_EXISTS, Status.ALREADY_EXISTS),
        (True, False, Status.OK_MATCHED, Status.MISMATCH),
        (False, True, Status.OK, Status.OK),
        (True, True, Status.OK_MATCHED, Status.OK),
    ],
)
def test_creation_modes(peer: Peer, reuse: bool, replace: bool, same: Status, other: Status) -> None:
    assert peer.status(create(PARTICIPANT, ParticipantBody(), reuse=reuse, replace=replace)) == same
    assert peer.status(create(PARTICIPANT, ParticipantBody(), domain=3, reuse=reuse, replace=replace)) == other


def test_what_is_missing_is_an_unknown_reference_or_an_error_of_dds(peer: Peer) -> None:
    assert peer.status(create(WRITER_ID, WriterBody(SQUARE))) == Status.UNKNOWN_REFERENCE
    assert peer.status(create(PUBLISHER, GroupBody())) == Status.OK
    assert peer.status(create(WRITER_ID, WriterBody(ObjectId(9, Kind.TOPIC)))) == Status.DDS_ERROR
    assert peer.status(create(WRITER_ID, m.Xml(WRITER_XML.format("Circle", "ShapeType")))) == Status.DDS_ERROR
    assert peer.status(create(WRITER_ID, m.Xml(WRITER_XML.format("Square", "Other")))) == Status.DDS_ERROR
    assert peer.status(create(WRITER_ID, m.Ref("nobody"))) == Status.DDS_ERROR
    assert peer.status(create(WRITER_ID, m.Xml(WRITER_XML.format("Square", "ShapeType")))) == Status.OK
    assert peer.status(m.Delete(request=1, object=WRITER_ID)) == Status.OK
    assert peer.status(m.Delete(request=1, object=WRITER_ID)) == Status.UNKNOWN_REFERENCE


def test_a_topic_of_another_domain_is_missing(peer: Peer) -> None:
    elsewhere = ObjectId(2, Kind.PARTICIPANT)
    assert peer.status(create(elsewhere, ParticipantBody(), domain=1)) == Status.OK
    assert peer.status(create(PUBLISHER, GroupBody(), parent=elsewhere)) == Status.OK
    assert peer.status(create(WRITER_ID, WriterBody(SQUARE))) == Status.DDS_ERROR


def test_all_three_representations_make_entities_that_meet() -> None:
    net = Net()
    peers = [net.peer(key, key) for key in (1, 2, 3)]
    bodies: list[tuple[m.Representation | WriterBody, m.Representation | ReaderBody]] = [
        (m.Ref("shapetype_data_writer"), m.Ref("shapetype_data_reader")),
        (m.Xml(WRITER_XML.format("Square", "ShapeType")),
         m.Xml(WRITER_XML.format("Square", "ShapeType").replace("writer", "reader"))),
        (WriterBody(SQUARE), ReaderBody(SQUARE)),
    ]  # fmt: skip
    for peer, (writer, reader) in zip(peers, bodies, strict=True):
        peer.open()
        peer.base()
        assert peer.status(create(PUBLISHER, m.Xml(""))) == Status.OK
        assert peer.status(create(SUBSCRIBER, m.Xml(""))) == Status.OK
        assert peer.status(create(WRITER_ID, writer)) == Status.OK
        assert peer.status(create(READER_ID, reader)) == Status.OK
        peer.read()
    for peer in peers:
        peer.write(bytes([peer.key]))
    assert [peer.samples() for peer in peers] == [[b"\1", b"\2", b"\3"]] * 3


def test_the_agent_lists_its_graph(peer: Peer) -> None:
    peer.writer(EndpointQos(Qos.RELIABLE | Qos.KEEP_LAST, depth=4))
    listed = peer.net.agent.entities()
    assert [one.id for one in listed] == [PARTICIPANT, SQUARE, PUBLISHER, WRITER_ID]
    topic = TopicKey(0, "Square", "ShapeType")
    assert listed[-1] == EntityInfo(peer.key, WRITER_ID, 0, topic, EntityQos(depth=4), 0)


def test_partitions_keep_apart_and_patterns_join() -> None:
    net = Net()
    publisher, subscriber = net.peer(1, 1), net.peer(2, 2)
    for peer in (publisher, subscriber):
        peer.open()
        peer.base()
    publisher.status(create(PUBLISHER, GroupBody(("left",))))
    publisher.status(create(WRITER_ID, WriterBody(SQUARE)))
    for number, partitions in enumerate((None, ("right",), ("l*",)), 1):
        group, reader = ObjectId(number, Kind.SUBSCRIBER), ObjectId(number, Kind.DATAREADER)
        subscriber.status(create(group, GroupBody(partitions)))
        subscriber.status(create(reader, ReaderBody(SQUARE), parent=group))
    matched = [one.matched for one in net.agent.entities() if one.id.kind is Kind.DATAREADER]
    assert matched == [0, 0, 1]


def test_a_kind_that_the_agent_does_not_serve_is_incompatible(peer: Peer) -> None:
    for kind in (Kind.TYPE, Kind.QOSPROFILE, Kind.AGENT):
        request = create(ObjectId(1, kind), m.Ref("x"), parent=PARTICIPANT)
        assert peer.status(request) == Status.INCOMPATIBLE


def test_one_entity_more_than_the_limit_is_refused(peer: Peer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nros_backends.xrce.agent.entities.LIMIT", 2)
    assert peer.status(create(PUBLISHER, GroupBody())) == Status.RESOURCES


def test_xml_says_all_the_qos_that_matters() -> None:
    text = """
      <dds xmlns="http://www.omg.org/dds"><data_writer>
        <topic><name>T</name><dataType>D</dataType>
          <historyQos><kind>KEEP_LAST</kind><depth>7</depth></historyQos></topic>
        <qos>
          <reliability><kind>BEST_EFFORT_RELIABILITY_QOS</kind></reliability>
          <durability><kind>PERSISTENT</kind></durability>
          <deadline><period><sec>1</sec><nanosec>500</nanosec></period></deadline>
          <lifespan><duration><sec>DURATION_INFINITY</sec></duration></lifespan>
          <liveliness><kind>MANUAL_BY_TOPIC</kind><lease_duration><sec>2</sec></lease_duration></liveliness>
          <ownership><kind>EXCLUSIVE</kind></ownership>
        </qos>
      </data_writer></dds>"""
    qos = EntityQos(
        reliable=False, durability=Durability.PERSISTENT, depth=7, deadline_ns=1_000_000_500,
        liveliness=Liveliness.MANUAL_BY_TOPIC, lease_ns=2_000 * MS, exclusive=True,
    )  # fmt: skip
    assert parse(Kind.DATAWRITER, text) == Endpoint(Topic("T", "D"), qos)


def test_xml_that_says_nothing_of_qos_has_the_defaults_of_its_kind() -> None:
    text = WRITER_XML.format("T", "D")
    assert parse(Kind.DATAWRITER, text) == Endpoint(Topic("T", "D"), WRITER)
    assert parse(Kind.DATAREADER, text.replace("writer", "reader")) == Endpoint(Topic("T", "D"), READER)
    assert parse(Kind.PARTICIPANT, "<dds><participant><rtps><name>p</name></rtps></participant></dds>") == Participant(
        "p"
    )
    assert parse(Kind.PUBLISHER, "") == Group()
    names = "<qos><partition><names><name>a</name><name>b</name></names></partition></qos>"
    assert parse(Kind.SUBSCRIBER, f"<subscriber>{names}</subscriber>") == Group(("a", "b"))


@pytest.mark.parametrize(
    ("kind", "text", "reason"),
    [
        (Kind.TOPIC, "Square", "not XML: syntax error: line 1, column 0"),
        (Kind.TOPIC, "", "not XML: no element found: line 1, column 0"),
        (Kind.TOPIC, "<dds/>", "no <topic> in the XML document"),
        (Kind.TOPIC, "<topic><name>T</name></topic>", "a topic needs <name> and <dataType>"),
        (Kind.DATAREADER, "<data_reader/>", "data_reader without a topic"),
        (Kind.TYPE, "<type/>", "object kind TYPE in XML"),
        (Kind.TOPIC, "x" * (1 << 20) + "x", "an XML document of 1048577 characters, 1048576 are allowed"),
        (Kind.DATAWRITER, WRITER_XML.format("T", "D").replace(
            "</topic>", "</topic><qos><reliability><kind>SURE</kind></reliability></qos>"
        ), "SURE is none of BEST_EFFORT, RELIABLE"),
        (Kind.DATAWRITER, WRITER_XML.format("T", "D").replace(
            "</topic>", "<historyQos><depth>-3</depth></historyQos></topic>"
        ), "'-3' is not a positive number"),
        (Kind.DATAWRITER, WRITER_XML.format("T", "D").replace(
            "</topic>", "</topic><qos><deadline><period><sec>soon</sec></period></deadline></qos>"
        ), "'soon' seconds '0' nanoseconds are not a duration"),
    ],
)  # fmt: skip
def test_xml_that_says_no_entity_is_refused_with_the_reason(kind: Kind, text: str, reason: str) -> None:
    with pytest.raises(Refused) as caught:
        parse(kind, text)
    assert str(caught.value) == reason


def test_entities_of_xml_are_never_expanded(peer: Peer) -> None:
    layers = "".join(f'<!ENTITY l{n} "{f"&l{n - 1};" * 10}">' for n in range(1, 12))
    bomb = (
        f'<!DOCTYPE dds [<!ENTITY l0 "lol">{layers}]><dds><topic><name>&l11;</name><dataType>D</dataType></topic></dds>'
    )
    with pytest.raises(Refused, match="a document type declaration in XML"):
        parse(Kind.TOPIC, bomb)
    started = time.process_time()
    assert peer.status(create(ObjectId(2, Kind.TOPIC), m.Xml(bomb))) == Status.DDS_ERROR
    assert time.process_time() - started < 1
