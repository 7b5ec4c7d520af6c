"""The peer of a play: there, absent, gone and back; what the script asks of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar

import pytest

from nros_backends.reference import ReferenceBackend
from nros_conformance.play.peer import LOG, Peer
from nros_conformance.play.plan import Plan
from nros_conformance.play.player import play as play_on
from nros_conformance.play.player import play_virtually
from nros_conformance.play.starvation import Watch
from nros_conformance.rmw.backend import Environment, SessionOptions
from nros_conformance.rmw.clock import MS, VirtualClock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.trace.records import Act, AnyRecord, Changed, End, FaultRecord, Header, Measure, Starved, State
from tests.play.scripts import PAIR, T, acts, of, play

TAKING = {"talker": {"publisher": "t"}, "listener": {"subscription": "t", "take": "always"}}
EXPECT = [{"returns": "there", "is": ["OK"], "proves": "CON-001"}]


def results(records: list[Any], label: str) -> list[Any]:
    return [act.result for act in acts(records, label)]


def test_pings_within_a_session_and_before_any_are_recorded_with_their_arguments() -> None:
    script = [
        {"do": "ping", "session": "sub", "timeout": "1T", "as": "there"},
        {"do": "ping", "timeout": "1T", "attempts": 2, "as": "before"},
        {"fault": "stop", "kill": True, "as": "down"},
        {"do": "ping", "session": "sub", "timeout": "1T", "times": 2, "as": "gone"},
        {"do": "ping", "timeout": "1T", "attempts": 3, "as": "nobody"},
    ]
    records = play(script, expect=EXPECT)
    (there,), (before,), (nobody,) = (acts(records, label) for label in ("there", "before", "nobody"))
    assert (there.op, there.session, there.result) == ("ping", "sub", ReturnCode.OK)
    assert (before.session, before.args, before.result) == ("", {"timeout_ms": 100, "attempts": 2}, ReturnCode.OK)
    assert results(records, "gone") == [ReturnCode.TIMEOUT] * 2
    assert [act.end - act.begin for act in acts(records, "gone")] == [T, T]
    assert (nobody.result, nobody.end - nobody.begin) == (ReturnCode.TIMEOUT, 3 * T)
    (down,) = of(records, FaultRecord)
    assert (down.label, down.fault, down.of, down.detail) == ("down", "stop", "", {"kill": True})


def test_an_absent_peer_leaves_the_sessions_to_the_script() -> None:
    entities = {"talker": {"publisher": "t", "deferred": True}}
    script = [
        {"do": "create", "entity": "talker", "as": "refused"},
        {"fault": "start"},
        {"do": "create", "entity": "talker", "as": "there"},
    ]
    records = play(script, entities, peer="absent", sessions={"pub": {"may_fail": True}}, expect=EXPECT)
    assert results(records, "refused") == [ReturnCode.CONNECTION_FAILED]
    assert results(records, "there") == [ReturnCode.OK]
    assert [(one.what, one.code) for one in of(records, State) if not one.entity][:2] == [
        ("refused", ReturnCode.CONNECTION_FAILED), ("created", 0)
    ]  # fmt: skip


def test_until_answers_whether_it_came_so_far() -> None:
    script = [
        {"until": "heard", "by": "talker", "of": "listener", "limit": "5T", "as": "flow"},
        {"until": "reported", "session": "sub", "limit": "2T", "every": "1T", "as": "fine"},
        {"fault": "stop"},
        {"until": "reachable", "limit": "2T", "as": "nobody"},
        {"until": "heard", "by": "talker", "of": "listener", "limit": "2T", "as": "deaf"},
        {"until": "reported", "session": "sub", "limit": "20T", "as": "bad"},
        {"fault": "start"},
        {"until": "reachable", "limit": "2T", "as": "there"},
    ]
    records = play(script, TAKING, expect=EXPECT)
    found = {label: results(records, label) for label in ("flow", "fine", "nobody", "deaf", "bad", "there")}
    assert found == {
        "flow": [True], "fine": [False], "nobody": [False], "deaf": [False], "bad": [True], "there": [True]
    }  # fmt: skip
    (deaf,) = acts(records, "deaf")
    assert 2 * T <= deaf.end - deaf.begin <= 2.2 * T  # a call that is under way at the limit is waited for
    assert {act.op for act in acts(records, "flow/by")} == {"publish"}
    assert {act.op for act in acts(records, "fine/ping")} == {"ping"}


def test_the_actions_of_a_repeat_are_numbered_on() -> None:
    script = [
        {"repeat": 3, "script": [
            {"do": "publish", "by": "talker", "times": 2, "as": "there"},
            {"drive": "1T", "as": "pause"},
        ], "as": "all"},
    ]  # fmt: skip
    records = play(script, expect=EXPECT)
    assert [act.index for act in acts(records, "there")] == list(range(6))
    assert [act.index for act in acts(records, "pause")] == [0, 1, 2]
    (whole,) = acts(records, "all")
    assert whole.end - whole.begin >= 3 * T


def test_a_reconnector_connects_again_and_its_states_are_on_record() -> None:
    sessions = {"pub": {"reconnector": True}, "sub": {"reconnector": True}}
    script = [
        {"until": "heard", "by": "talker", "of": "listener", "limit": "20T", "as": "flow"},
        {"repeat": 2, "script": [
            {"fault": "stop", "kill": True},
            {"fault": "start"},
            {"until": "heard", "by": "talker", "of": "listener", "limit": "20T", "as": "there"},
        ]},
    ]  # fmt: skip
    records = play(script, TAKING, sessions=sessions, expect=EXPECT)
    assert results(records, "flow") == [True]
    assert results(records, "there") == [True, True]
    states = [one.state for one in of(records, Changed) if one.session == "pub"]
    again = ["AGENT_DISCONNECTED", "WAITING_AGENT", "AGENT_AVAILABLE", "AGENT_CONNECTED"]
    assert states == [*again[2:], *again, *again]


def test_the_peer_tells_what_it_lists_and_has_counted() -> None:
    sessions = {"pub": {"hard_liveliness": "2T"}}
    script = [
        {"do": "measure", "what": "listed", "of": "talker", "as": "one"},
        {"do": "measure", "what": "checks", "as": "none"},
        {"drive": "5T"},
        {"do": "measure", "what": "checks", "as": "some"},
        {"do": "destroy", "of": "talker"},
        {"do": "measure", "what": "listed", "of": "talker", "as": "gone"},
    ]
    values = {one.label: one.value for one in of(play(script, sessions=sessions, expect=EXPECT), Measure)}
    assert values == {"one": 1, "none": 0, "some": 2, "gone": 0}


class _Silent(ReferenceBackend):
    """A peer that cannot be asked."""

    def environment(self) -> Any:
        return Environment()


def test_what_a_peer_does_not_tell_is_not_on_record() -> None:
    records = play([{"do": "measure", "what": "probes", "as": "there"}], adapter=_Silent, expect=EXPECT)
    assert of(records, Measure) == []
    assert [act.op for act in acts(records, "there")] == ["measure"]


class _Broken(Environment):
    def start(self) -> None:
        raise RmwError(ReturnCode.CONNECTION_FAILED, "no free port")


class _Unstartable(ReferenceBackend):
    def environment(self) -> Any:
        return _Broken()


def test_a_peer_that_does_not_start_is_a_failure_of_the_backend() -> None:
    end = play([], adapter=_Unstartable, outcome="raised", expect=EXPECT)[-1]
    assert end.detail == "the peer did not start: CONNECTION_FAILED (-18): no free port"


class _Foreign(Environment):
    def stop(self, *, kill: bool = False) -> None:
        raise RmwError(ReturnCode.UNSUPPORTED, "the agent at 10.0.0.1:8888 is not ours to stop")


class _ForeignBackend(ReferenceBackend):
    def environment(self) -> Any:
        return _Foreign()


def test_somebody_elses_peer_is_left_alone_and_cannot_be_stopped() -> None:
    assert play([], adapter=_ForeignBackend, expect=EXPECT)[-1].outcome == "done"
    end = play([{"fault": "stop"}], adapter=_ForeignBackend, outcome="raised", expect=EXPECT)[-1]
    assert end.detail == "the peer did not stop: UNSUPPORTED (-5): the agent at 10.0.0.1:8888 is not ours to stop"


def test_the_options_of_a_session_come_from_the_suite() -> None:
    asked: list[SessionOptions] = []

    class Asking(ReferenceBackend):
        def create_session(self, options: SessionOptions) -> Any:
            asked.append(options)
            return super().create_session(options)

    play([], sessions={"pub": {"lease": "7T", "hard_liveliness": "9T"}}, adapter=Asking, expect=EXPECT)
    found = {one.node_name: (one.locator, one.connection_lease_ms, one.hard_liveliness_ms) for one in asked}
    assert found == {"pub": ("reference", 700, 900), "sub": ("reference", 0, 0)}


class _Talkative(Environment):
    def log(self) -> str:
        return "agent: port 8888 is taken\n"


class _TalkativeBackend(ReferenceBackend):
    def environment(self) -> Any:
        return _Talkative()


def test_what_the_peer_has_printed_is_kept_beside_the_trace(tmp_path: Path) -> None:
    scenario = {"id": "x.y", "title": "t", "entities": PAIR, "script": [{"fault": "stop"}], "expect": EXPECT}
    quantities = {"T": T, "tolerance": 0, "early": 0, "discovery_bound": 10 * MS}
    header = Header(scenario=scenario, suite="x", backend="reference", clock="virtual", quantities=quantities, start=0)
    trace = tmp_path / "x.y.1.jsonl"
    records = play_virtually(Plan(key="x.y", adapter="", header=header, trace=str(trace)), _TalkativeBackend)
    assert isinstance(records[-1], End)
    assert Path(f"{trace}.d", LOG).read_text() == "agent: port 8888 is taken\n"


def test_a_peer_without_a_word_leaves_nothing_behind(tmp_path: Path) -> None:
    Peer(Environment(), VirtualClock(), lambda record: None).close(tmp_path / "d")
    assert not (tmp_path / "d").exists()


@pytest.mark.parametrize("fault", ["stop", "start"])
def test_moments_of_the_peers_faults_can_be_waited_for(fault: str) -> None:
    script = [{"fault": fault, "as": "then"}, {"do": "publish", "by": "talker", "at": "then + 2T", "as": "there"}]
    records = play(script, expect=EXPECT)
    (done,) = of(records, FaultRecord)
    (act,) = [one for one in of(records, Act) if one.label == "there"]
    assert act.begin - done.end == 2 * T


class _Counting(Environment):
    """Says what is done to it."""

    did: ClassVar[list[str]] = []

    def start(self) -> None:
        self.did.append("start")

    def stop(self, *, kill: bool = False) -> None:
        self.did.append("stop")

    def release(self) -> None:
        self.did.append("release")


class _CountingBackend(ReferenceBackend):
    def environment(self) -> Any:
        return _Counting()


def test_a_peer_is_left_to_the_next_play_unless_this_one_may_still_use_it() -> None:
    play([{"drive": "1T"}], adapter=_CountingBackend, expect=EXPECT)
    assert _Counting.did == ["start", "release"]
    _Counting.did.clear()
    peer = Peer(_Counting(), VirtualClock(), lambda record: None)
    peer.close(None)
    peer.close(None, clean=True)
    assert _Counting.did == ["stop", "release"]


class _Elsewhere(Environment):
    def processes(self) -> Sequence[int]:
        return [4711]


class _ElsewhereBackend(ReferenceBackend):
    def environment(self) -> Any:
        return _Elsewhere()


class _Seeing(Watch):
    """A watch that only asks, at the begin of a play and at its end."""

    asked: list[Sequence[int]]

    @contextmanager
    def telling(self, note: Any, processes: Callable[[], Sequence[int]] = tuple) -> Iterator[None]:
        self.asked = [processes()]
        yield
        self.asked.append(processes())
        note(Starved(begin=0, end=1, wait=1))


def test_the_processes_of_the_peer_are_watched_from_when_there_is_one() -> None:
    scenario = {"id": "x.y", "title": "t", "entities": PAIR, "script": [{"drive": "1T"}], "expect": EXPECT}
    quantities = {"T": T, "tolerance": 0, "early": 0, "discovery_bound": 10 * MS}
    header = Header(scenario=scenario, suite="x", backend="reference", clock="virtual", quantities=quantities, start=0)
    plan, clock, watch = Plan(key="x.y", adapter="", header=header, trace=""), VirtualClock(), _Seeing()
    records: list[Header | AnyRecord] = []
    clock.run(lambda: play_on(plan, _ElsewhereBackend, clock, records.append, watch=watch))
    assert watch.asked == [[], [4711]]
    assert [type(one) for one in records[-2:]] == [Starved, End]
