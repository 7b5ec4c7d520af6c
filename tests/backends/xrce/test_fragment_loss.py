"""Fragments of a sample that are lost on the wire, at every place in it, in either direction."""

from __future__ import annotations

from contextlib import ExitStack

import pytest

from nros_backends.xrce.client.core import Config, Core
from nros_backends.xrce.session import XrceSession
from nros_backends.xrce.streams import ReliableInput, ReliableOutput
from nros_backends.xrce.subscription import XrceSubscription
from nros_backends.xrce.wire import Header, Message, decode, encode, encode_body
from nros_backends.xrce.wire import messages as m
from nros_backends.xrce.wire.ids import Kind, ObjectId
from nros_conformance.rmw.backend import SessionOptions
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.qos import QosProfile, Reliability
from tests.backends.xrce.conftest import Bench, drain, drive, publisher, subscription
from tests.backends.xrce.lossy import lossy

PIECES = 5
LARGE = bytes(number % 251 for number in range(4 * 500 + 100))
SMALL = b"the next one"
BEST_EFFORT = QosProfile(reliability=Reliability.BEST_EFFORT)


class Losses:
    """Loses the fragments of these places, each ``times`` times, on their way to the agent or from it."""

    def __init__(self, places: set[int], to_agent: bool, times: int = 1) -> None:
        self.places = places
        self.to_agent = to_agent
        self.times = times
        self.lost: list[int] = []
        self._first: int | None = None

    def __call__(self, to_agent: bool, datagram: bytes) -> bool:
        message = decode(datagram)
        if to_agent is not self.to_agent or not isinstance(message.submessages[0], m.Fragment):
            return False
        if self._first is None:
            self._first = message.header.sequence
        place = message.header.sequence - self._first
        if place not in self.places or self.lost.count(place) == self.times:
            return False
        self.lost.append(place)
        return True


def led_by(bench: Bench, node: str, locator: str) -> XrceSession:
    session = bench.backend.create_session(SessionOptions(node_name=node, locator=locator))
    assert isinstance(session, XrceSession)
    return session


def take(received: XrceSubscription, count: int, *sessions: XrceSession) -> list[bytes]:
    """What has come when so many samples have, or none has for long."""
    taken: list[bytes] = []

    def enough() -> bool:
        taken.extend(drain(received))
        return len(taken) >= count

    drive(*sessions, until=enough)
    return taken


@pytest.mark.parametrize("to_agent", [True, False])
@pytest.mark.parametrize(
    "places", [*({place} for place in range(PIECES)), {0, PIECES - 1}, set(range(PIECES))], ids=str
)
def test_what_is_lost_of_a_reliable_sample_is_sent_again(bench: Bench, places: set[int], to_agent: bool) -> None:
    losses = Losses(places, to_agent)
    with ExitStack() as stack:
        locator = stack.enter_context(lossy(bench.agent.endpoint(), losses))
        sender = led_by(bench, "sender", locator) if to_agent else bench.session("sender")
        receiver = bench.session("receiver") if to_agent else led_by(bench, "receiver", locator)
        received, sending = subscription(receiver), publisher(sender)
        assert [sending.publish_raw(LARGE), sending.publish_raw(SMALL)] == [ReturnCode.OK] * 2
        assert take(received, 2, sender, receiver) == [LARGE, SMALL]
        assert set(losses.lost) == places
        for session in (sender, receiver):
            session.destroy()


@pytest.mark.parametrize("to_agent", [True, False])
@pytest.mark.parametrize("place", [0, PIECES - 1])
def test_a_fragment_that_is_lost_again_and_again_comes_in_the_end(bench: Bench, place: int, to_agent: bool) -> None:
    losses = Losses({place}, to_agent, times=3)
    with lossy(bench.agent.endpoint(), losses) as locator:
        sender = led_by(bench, "sender", locator) if to_agent else bench.session("sender")
        receiver = bench.session("receiver") if to_agent else led_by(bench, "receiver", locator)
        received, sending = subscription(receiver), publisher(sender)
        assert sending.publish_raw(LARGE) == ReturnCode.OK
        assert take(received, 1, sender, receiver) == [LARGE]
        assert losses.lost == [place] * 3
        for session in (sender, receiver):
            session.destroy()


def test_a_best_effort_sample_is_never_cut(bench: Bench) -> None:
    session = bench.session()
    received, sending = subscription(session, BEST_EFFORT), publisher(session, BEST_EFFORT)
    assert sending.publish_raw(LARGE) == ReturnCode.MESSAGE_TOO_LARGE
    assert sending.publish_raw(SMALL) == ReturnCode.OK
    assert drive(session, until=lambda: bool(received.has_data()))
    assert drain(received) == [SMALL]


def test_a_sample_too_large_for_a_best_effort_subscription_costs_no_other(bench: Bench) -> None:
    session = bench.session()
    received, sending = subscription(session, BEST_EFFORT), publisher(session)
    for sample in (b"before", LARGE, SMALL):
        assert sending.publish_raw(sample) == ReturnCode.OK
    assert take(received, 2, session) == [b"before", SMALL]


@pytest.mark.parametrize("lost", range(1 << 3), ids=lambda lost: f"{lost:03b}")
def test_fragments_on_a_best_effort_stream_mean_nothing_to_the_client_whichever_are_lost(lost: int) -> None:
    heard: list[m.Data] = []
    core = Core(Config(key=1), lambda data, at_ns: heard.append(data), lambda reply, at_ns: None)
    whole = m.Data(request=20, object=ObjectId(1, Kind.DATAREADER), data=LARGE[:1_200])
    body = encode_body([whole])
    pieces = [m.Fragment(data=body[at : at + 500], last=at + 500 >= len(body)) for at in range(0, len(body), 500)]
    small = m.Data(request=20, object=ObjectId(1, Kind.DATAREADER), data=SMALL)
    for sequence, submessage in enumerate([*pieces, small]):
        if not lost >> sequence & 1:
            core.receive(encode(Message(Header(0x81, 0x01, sequence), (submessage,))), 0)
    assert heard == [small]


@pytest.mark.parametrize("lost", range(1, 1 << PIECES), ids=lambda lost: f"{lost:05b}")
def test_a_sample_of_which_fragments_are_given_up_is_lost_whole_and_no_other_is_harmed(lost: int) -> None:
    sender, receiver = ReliableOutput(0x80, 504), ReliableInput(0x80)
    sample, small = bytes((7, 1, 0, 0)) + LARGE, bytes((7, 1, len(SMALL), 0)) + SMALL
    for body in (small, sample, small, sample):
        sender.push(body)
    packets = sender.take(0)
    assert len(packets) == 2 * (1 + PIECES)
    gone = {1 + place for place in range(PIECES) if lost >> place & 1}
    got = [
        body
        for packet in packets
        if packet.sequence not in gone
        for body in receiver.receive(packet.sequence, packet.body)
    ]
    # The sender no longer has what comes before its heartbeat's first.
    for sequence in sorted(gone):
        got += receiver.heartbeat(sequence + 1, packets[-1].sequence)
    assert got == [small, small, sample]
    assert receiver.lost == len(gone)
    assert receiver.acknack() == m.Acknack(first_unacked=len(packets), missing=0, stream=0x80)
