from __future__ import annotations

from collections import Counter

import pytest

from nros_backends.xrce.client.core import Config, Core
from nros_backends.xrce.wire import Submessage, decode, decode_body
from nros_backends.xrce.wire import messages as m
from tests.backends.xrce.captures import Datagram, conversations
from tests.backends.xrce.client.replay import EXCEPTIONS, automatic, clients, play, recorded

ALL = conversations()
REAL = [(name, peer) for name, one in ALL.items() if not name.startswith("raw_") for peer in clients(one)]
HAND_MADE = [(name, peer) for name, one in ALL.items() if name.startswith("raw_") for peer in clients(one)]


@pytest.mark.parametrize(("name", "peer"), REAL)
def test_sends_what_the_recorded_client_sent(name: str, peer: int) -> None:
    ours, theirs = play(ALL[name], peer).sent, recorded(ALL[name], peer)
    assert [one for one in ours if not automatic(one)] == [one for one in theirs if not automatic(one)]


@pytest.mark.parametrize(("name", "peer"), REAL)
def test_acknowledges_and_announces_what_the_recorded_client_did(name: str, peer: int) -> None:
    ours, theirs = play(ALL[name], peer).sent, recorded(ALL[name], peer)
    assert {one for one in ours if automatic(one)} == {one for one in theirs if automatic(one)}


@pytest.mark.parametrize(("name", "peer"), REAL)
def test_hands_out_every_sample_and_answer_once(name: str, peer: int) -> None:
    arrived = [one for one in ALL[name].datagrams if one.peer == peer and not one.to_agent and not one.dropped]
    assert Counter(map(repr, play(ALL[name], peer).heard)) == Counter(map(repr, _told(arrived)))


def test_every_exception_is_about_a_recorded_conversation() -> None:
    assert set(EXCEPTIONS) <= {name for name, _ in REAL}


@pytest.mark.parametrize(("name", "peer"), HAND_MADE)
def test_gets_the_samples_that_the_recorded_agent_sent_to_made_up_clients(name: str, peer: int) -> None:
    # The client's half is not one that our client could play, so it only listens.
    arrived = [one for one in ALL[name].datagrams if one.peer == peer and not one.to_agent and not one.dropped]
    session = decode(arrived[0].payload).header.session
    heard: list[m.Data] = []
    core = Core(Config(0xAAAABBBB, session), lambda data, at_ns: heard.append(data), lambda reply, at_ns: None)
    for one in arrived:
        core.receive(one.payload, one.at_ns)
    assert core.malformed == 0
    expected = [one for one in _told(arrived) if isinstance(one, m.Data)]
    assert Counter(map(repr, heard)) == Counter(map(repr, expected))


def _told(arrived: list[Datagram]) -> list[Submessage]:
    """What these datagrams have to say to an application, each thing once."""
    told: list[Submessage] = []
    streams: dict[tuple[int, int, int], tuple[Submessage, ...]] = {}
    epoch = 0
    for one in arrived:
        message = decode(one.payload)
        if message.header.stream:
            streams[(epoch, message.header.stream, message.header.sequence)] = message.submessages
        else:
            told += message.submessages
            epoch += isinstance(message.submessages[0], m.StatusAgent)
    pieces = b""
    for submessages in (streams[key] for key in sorted(streams)):
        for submessage in submessages:
            if isinstance(submessage, m.Fragment):
                pieces += submessage.data
                if submessage.last:
                    told += decode_body(pieces)
                    pieces = b""
            else:
                told.append(submessage)
    return [one for one in told if not isinstance(one, m.Acknack | m.Heartbeat | m.GetInfo)]
