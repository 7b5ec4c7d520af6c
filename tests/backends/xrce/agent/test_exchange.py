from __future__ import annotations

import pytest

from nros_backends.xrce.wire.binary import EndpointQos, Qos, TopicBody
from nros_backends.xrce.wire.ids import NO_STREAM, RELIABLE
from nros_backends.xrce.wire.messages import Acknack, DeliveryControl, Reset
from tests.backends.xrce.agent.peer import READER, WRITER, Net, Peer

BEST_EFFORT = EndpointQos(Qos(0))
RELIABLE_QOS = EndpointQos(Qos.RELIABLE)
LATE = EndpointQos(Qos.RELIABLE | Qos.TRANSIENT_LOCAL)


def pair(writer: EndpointQos = RELIABLE_QOS, reader: EndpointQos = RELIABLE_QOS) -> tuple[Net, Peer, Peer]:
    net = Net()
    publisher, subscriber = net.peer(1, 1), net.peer(2, 2)
    assert publisher.open() == subscriber.open() == 0
    publisher.writer(writer)
    subscriber.reader(reader)
    subscriber.read()
    return net, publisher, subscriber


def test_a_sample_goes_from_one_client_to_the_other() -> None:
    _, publisher, subscriber = pair()
    publisher.write(b"one", b"two")
    assert subscriber.samples() == [b"one", b"two"]


@pytest.mark.parametrize(
    ("writer", "reader", "matched"),
    [
        (RELIABLE_QOS, BEST_EFFORT, True),
        (BEST_EFFORT, RELIABLE_QOS, False),
        (LATE, RELIABLE_QOS, True),
        (RELIABLE_QOS, LATE, False),
        (EndpointQos(Qos.RELIABLE, deadline_ms=100), EndpointQos(Qos.RELIABLE, deadline_ms=200), True),
        (EndpointQos(Qos.RELIABLE, deadline_ms=300), EndpointQos(Qos.RELIABLE, deadline_ms=200), False),
        (RELIABLE_QOS, EndpointQos(Qos.RELIABLE, deadline_ms=200), False),
        (EndpointQos(Qos.RELIABLE | Qos.EXCLUSIVE), RELIABLE_QOS, False),
    ],
)
def test_writer_and_reader_meet_only_with_compatible_qos(
    writer: EndpointQos, reader: EndpointQos, matched: bool
) -> None:
    net, publisher, subscriber = pair(writer, reader)
    publisher.write(b"x")
    assert subscriber.samples() == [b"x"] * matched
    counts = {one.id: one.matched for one in net.agent.entities() if one.topic is not None}
    assert counts == {WRITER: int(matched), READER: int(matched)}


@pytest.mark.parametrize(
    ("topic", "domain"),
    [(TopicBody("Circle", None, "ShapeType"), 0), (TopicBody("Square", None, "Other"), 0),
     (TopicBody("Square", None, "ShapeType"), 1)],
)  # fmt: skip
def test_another_name_type_or_domain_is_another_topic(topic: TopicBody, domain: int) -> None:
    net = Net()
    publisher, subscriber = net.peer(1, 1), net.peer(2, 2)
    publisher.open()
    subscriber.open()
    publisher.writer(topic=topic, domain=domain)
    subscriber.reader()
    subscriber.read()
    publisher.write(b"x")
    assert subscriber.samples() == []


def test_a_late_reader_gets_what_a_transient_local_writer_kept_and_no_more_than_its_depth() -> None:
    net = Net()
    publisher, volatile, durable = net.peer(1, 1), net.peer(2, 2), net.peer(3, 3)
    for peer in (publisher, volatile, durable):
        peer.open()
    publisher.writer(EndpointQos(Qos.RELIABLE | Qos.TRANSIENT_LOCAL | Qos.KEEP_LAST, depth=2))
    publisher.write(b"1", b"2", b"3")
    volatile.reader(RELIABLE_QOS)
    durable.reader(LATE)
    volatile.read()
    durable.read()
    assert volatile.samples() == []
    assert durable.samples() == [b"2", b"3"]


def test_the_history_of_a_writer_goes_with_its_client() -> None:
    net = Net()
    publisher, subscriber = net.peer(1, 1), net.peer(2, 2)
    publisher.open()
    subscriber.open()
    publisher.writer(LATE)
    publisher.write(b"1")
    publisher.session = 0x82
    publisher.open()
    subscriber.reader(LATE)
    subscriber.read()
    assert subscriber.samples() == []


def test_a_reader_keeps_its_depth_until_it_is_asked() -> None:
    net = Net()
    peer = net.peer()
    peer.open()
    peer.writer()
    peer.reader(EndpointQos(Qos.RELIABLE | Qos.KEEP_LAST, depth=3))
    peer.write(*(str(number).encode() for number in range(10)))
    peer.read()
    assert peer.samples() == [b"7", b"8", b"9"]


def test_a_sample_older_than_its_lifespan_is_not_delivered() -> None:
    net = Net()
    peer = net.peer()
    peer.open()
    peer.writer(EndpointQos(Qos.RELIABLE, lifespan_ms=50))
    peer.reader()
    peer.write(b"old")
    net.advance(49)
    peer.write(b"new")
    net.advance(1)
    peer.read()
    assert peer.samples() == [b"new"]


def test_a_full_reliable_stream_holds_samples_back_and_loses_none() -> None:
    _, publisher, subscriber = pair()
    subscriber.read(stream=RELIABLE)
    sent = [bytes([number]) for number in range(40)]
    publisher.write(*sent)
    got = subscriber.samples()
    assert got == sent[:16]
    while len(got) < 40:
        subscriber.post(Acknack(first_unacked=len(got), missing=0, stream=RELIABLE), stream=NO_STREAM)
        got += subscriber.samples()
    assert got == sent


def test_samples_come_on_the_stream_that_was_asked_for() -> None:
    _, publisher, subscriber = pair()
    for stream in (NO_STREAM, 0x05, 0x90):
        subscriber.read(stream=stream)
        publisher.write(b"x")
        (message,) = subscriber.look()
        assert (message.header.stream, message.header.sequence) == (stream, 0)


@pytest.mark.parametrize(
    ("control", "first", "later"),
    [
        (DeliveryControl(max_samples=2), 2, 2),
        (DeliveryControl(max_octets_per_s=20), 2, 3),  # ten octets each: the next after half a second
        (DeliveryControl(min_pace_ms=400), 1, 2),
        (DeliveryControl(max_samples=0), 5, 5),  # a cancellation that finds samples delivers them
    ],
)
def test_delivery_control(control: DeliveryControl, first: int, later: int) -> None:
    net = Net()
    peer = net.peer()
    peer.open()
    peer.writer()
    peer.reader()
    peer.write(*[b"0123456789"] * 5)
    peer.read(control)
    assert len(peer.samples()) == first
    net.advance(500)
    assert len(peer.samples()) == later - first


def test_a_reading_ends_after_its_seconds() -> None:
    net, publisher, subscriber = pair()
    subscriber.read(DeliveryControl(max_elapsed_s=1))
    net.advance(1000)
    publisher.write(b"in time")
    net.advance(1)
    publisher.write(b"late")
    assert subscriber.samples() == [b"in time"]


def test_a_sample_larger_than_the_rate_of_a_second_still_comes() -> None:
    net, publisher, subscriber = pair()
    subscriber.read(DeliveryControl(max_octets_per_s=10))
    publisher.write(bytes(100), b"x")
    assert subscriber.samples() == [bytes(100)]
    net.advance(100)
    assert subscriber.samples() == [b"x"]


def test_a_reset_leaves_entities_and_readings() -> None:
    _, publisher, subscriber = pair()
    publisher.write(b"a")
    subscriber.send(Reset(), stream=NO_STREAM)
    publisher.write(b"b")
    (message,) = subscriber.look()
    assert message.header.sequence == 0
