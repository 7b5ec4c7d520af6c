from __future__ import annotations

import pytest

from nros_backends.xrce.agent.session import DEAD_NS
from nros_backends.xrce.wire import Message
from nros_backends.xrce.wire import messages as m
from nros_backends.xrce.wire.binary import GroupBody
from nros_backends.xrce.wire.ids import AGENT, CLIENT, NO_STREAM, RELIABLE, Status
from tests.backends.xrce.agent.peer import MS, PARTICIPANT, PUBLISHER, Net, Peer, create

PING = m.GetInfo(request=0, object=CLIENT, mask=m.CONFIGURATION)


def pings(peer: Peer) -> int:
    return sum(message.submessages == (PING,) for message in peer.look())


@pytest.mark.parametrize(
    ("wrong", "status"),
    [
        ({"cookie": b"XRCF"}, Status.INVALID_DATA),
        ({"major": 2}, Status.INCOMPATIBLE),
        ({"mtu": 8}, Status.INVALID_DATA),
        ({"mtu": 17}, Status.INVALID_DATA),
        ({"mtu": 18}, Status.OK),
    ],
)
def test_a_client_that_cannot_be_served_is_told_why(wrong: dict[str, object], status: Status) -> None:
    net = Net()
    assert net.peer().open(**wrong) == status  # type: ignore[arg-type]
    assert len(net.agent.clients) == (status is Status.OK)


def test_key_zero_is_not_a_key() -> None:
    assert Net().peer(key=0).open() == Status.INVALID_DATA


@pytest.mark.parametrize("value", ["", "soon", "-1", "1e3", "٣", "9" * 10, " 100"])
def test_a_liveliness_that_is_no_number_is_refused(value: str) -> None:
    net = Net()
    assert net.peer().open(("uxr_hl", value)) == Status.INVALID_DATA
    assert net.agent.clients == ()


def test_a_silent_client_is_pinged_three_times_and_deleted_a_tick_later() -> None:
    net = Net()
    peer = net.peer()
    peer.open(("uxr_hl", "001000"))
    peer.base()
    peer.look()
    net.advance(999)
    assert pings(peer) == 0
    net.advance(1)
    assert pings(peer) == 1
    net.advance(400)
    assert pings(peer) == 2
    assert peer.key in net.agent.clients
    net.advance(200)
    assert pings(peer) == 0
    assert peer.key not in net.agent.clients
    assert not net.agent.entities()
    assert peer.ping() == 0
    assert net.agent.wakeup_ns(net.now) is None


@pytest.mark.parametrize("answer", ["810000000000000000000000", "81000000", "81000000060108000000fffe00000000"])
def test_every_answer_that_a_client_may_give_keeps_it_alive(answer: str) -> None:
    net = Net()
    peer = net.peer()
    peer.open(("uxr_hl", "001000"))
    for _ in range(10):
        net.advance(200)
        if pings(peer):
            peer.raw(bytes.fromhex(answer))
    assert net.agent.clients == (peer.key,)


def test_pings_outside_the_session_do_not_keep_a_client_alive() -> None:
    net = Net()
    peer = net.peer()
    peer.open(("uxr_hl", "001000"))
    for _ in range(9):
        net.advance(200)
        peer.raw(bytes.fromhex("8000000002010800000afffd02000000"))
    assert net.agent.clients == ()


def test_without_hard_liveliness_a_silent_client_stays_and_is_no_longer_reminded() -> None:
    net = Net()
    peer = net.peer()
    peer.open()
    peer.send(create(PARTICIPANT, m.Ref("default_xrce_participant")), stream=RELIABLE)
    net.advance(DEAD_NS // MS)
    reminders = len(peer.look())
    assert reminders == DEAD_NS // MS // 200 - 1
    net.advance(5_000)
    assert peer.look() == []
    assert peer.ping() == 1
    net.advance(200)
    (reminder,) = peer.look()
    assert reminder.submessages == (m.Heartbeat(first=0, last=0, stream=RELIABLE),)


def test_the_same_key_and_session_again_keeps_entities_and_starts_streams_again() -> None:
    net = Net()
    peer = net.peer()
    peer.open()
    peer.base()
    peer.open()
    (reply,) = peer.send(create(PARTICIPANT, m.Ref("default_xrce_participant")))
    assert reply.header.sequence == 0
    assert isinstance(reply.submessages[0], m.StatusReply)
    assert reply.submessages[0].status == Status.ALREADY_EXISTS


def test_the_same_key_with_another_session_id_starts_with_nothing() -> None:
    net = Net()
    peer = net.peer()
    peer.open()
    peer.base()
    peer.session = 0x82
    peer.open()
    assert net.agent.entities() == ()


def test_another_key_from_the_same_place_ends_the_old_client() -> None:
    net = Net()
    old = net.peer(1, 1)
    old.open()
    old.base()
    new = net.peer(2, 1)
    new.open()
    assert net.agent.clients == (2,)
    assert net.agent.entities() == ()


def test_a_client_that_moves_is_answered_where_it_is() -> None:
    net = Net()
    home, away = net.peer(5, 1, session=1), net.peer(5, 2, session=1)
    home.open()
    home.base()
    (reply,) = away.send(create(PUBLISHER, GroupBody()), stream=RELIABLE)[:1]
    assert reply.header.key == 5
    net.advance(200)
    assert [type(one.submessages[0]) for one in home.look()] == [m.Heartbeat]


def test_without_a_session_only_ping_and_goodbye_are_answered() -> None:
    net = Net()
    peer = net.peer()
    assert peer.send(create(PARTICIPANT, m.Ref("default_xrce_participant")), stream=RELIABLE) == []
    assert peer.send(m.Timestamp(transmit=m.Time(1, 2)), stream=NO_STREAM) == []
    assert peer.send(m.Reset(), stream=NO_STREAM) == []
    assert peer.ping() == 0
    assert peer.status(m.Delete(request=2, object=CLIENT), stream=NO_STREAM) == Status.OK


def test_after_goodbye_the_rest_of_the_message_is_dropped() -> None:
    net = Net()
    peer = net.peer()
    peer.open()
    farewell = m.Delete(request=2, object=CLIENT)
    (reply,) = peer.send(farewell, create(PARTICIPANT, m.Ref("default_xrce_participant")), stream=NO_STREAM)
    assert reply.submessages == (m.StatusReply(request=2, object=CLIENT, status=Status.OK),)
    assert net.agent.clients == ()
    assert net.agent.entities() == ()


def test_the_agents_time_comes_back_with_the_clients_own() -> None:
    net = Net()
    peer = net.peer()
    peer.open()
    (reply,) = peer.send(m.Timestamp(transmit=m.Time(-1, 2)), stream=NO_STREAM)
    time = m.Time(1, 5)
    assert reply.submessages == (m.TimestampReply(transmit=time, receive=time, originate=m.Time(-1, 2)),)


def test_a_ping_outside_a_session_says_whether_the_agent_knows_the_sender() -> None:
    net = Net()
    peer = net.peer()
    ping = bytes.fromhex("8000000002010800000afffd02000000")

    def status(replies: list[Message]) -> int:
        (reply,) = replies
        (info,) = reply.submessages
        assert isinstance(info, m.Info)
        assert info.object == AGENT
        return info.implementation

    assert status(peer.raw(ping)) == 0
    peer.open()
    assert status(peer.raw(ping)) == 1


def test_one_client_more_than_the_limit_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nros_backends.xrce.agent.core.CLIENTS", 2)
    net = Net()
    assert [net.peer(key, key).open() for key in (1, 2, 3)] == [0, 0, Status.RESOURCES]
    assert net.peer(1, 1).open() == Status.OK
