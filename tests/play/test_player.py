"""What the player makes of each step, on the reference in virtual time."""

from __future__ import annotations

from typing import Any

from nros_backends.reference import ReferenceBackend
from nros_conformance.play import payload
from nros_conformance.play.plan import Plan, expected_ns
from nros_conformance.play.player import play_virtually
from nros_conformance.rmw.clock import MS
from nros_conformance.suite.loader import typed
from nros_conformance.trace.records import Act, End, Event, Header, Matched, Message, Spin, State

PAIR = {"talker": {"publisher": "t"}, "listener": {"subscription": "t"}}
T = 100 * MS


def play(script: list[Any], entities: dict[str, Any] | None = None, **fields: Any) -> list[Any]:
    records: list[Any]
    expect = fields.pop("expect", [{"never": "MessageLost", "of": "ALL", "proves": "MSL-002"}])
    scenario = {
        "id": "x.y", "title": "t", "entities": entities or PAIR, "script": script, "expect": expect, **fields,
    }  # fmt: skip
    quantities = {"T": T, "tolerance": 0, "early": 0, "discovery_bound": 10 * MS}
    header = Header(scenario=scenario, suite="x", backend="reference", clock="virtual", quantities=quantities, start=0)
    plan = Plan(key="x.y", adapter="", header=header, trace="")
    head, *rest = play_virtually(plan, ReferenceBackend)
    assert isinstance(head, Header)
    records = list(rest)
    assert records[-1] == End(outcome="done", t=records[-1].t), records[-1]
    return records


def acts(records: list[Any], label: str) -> list[Act]:
    return [record for record in records if isinstance(record, Act) and record.label == label]


def of(records: list[Any], kind: type[Any]) -> list[Any]:
    return [record for record in records if isinstance(record, kind)]


def test_repeated_publishes_happen_at_their_times_with_increasing_sequence() -> None:
    data = acts(play([{"do": "publish", "by": "talker", "every": "0.4T", "times": 3, "as": "data"}]), "data")
    assert [act.begin - data[0].begin for act in data] == [0, 40 * MS, 80 * MS]
    assert [act.args["sequence"] for act in data] == [1, 2, 3]
    assert all(act.begin == act.due for act in data[1:])


def test_driving_goes_on_in_the_background_and_idling_stops_it() -> None:
    records = play([{"drive": "1T", "as": "busy"}, {"idle": "3T", "as": "rest"}, {"drive": "1T"}])
    (rest,) = acts(records, "rest")
    assert rest.end - rest.begin == 3 * T
    for name in ("pub", "sub"):
        spins = [spin for spin in of(records, Spin) if spin.session == name]
        resting = [spin.gap for spin in spins if spin.begin <= rest.begin and spin.end >= rest.end]
        assert resting == [] or 3 * T <= max(resting) <= 3 * T + 10 * MS
        assert sum(spin.calls for spin in spins if rest.begin < spin.begin and spin.end <= rest.end) == 0


def test_a_slice_is_how_long_one_background_drive_waits() -> None:
    records = play([{"drive": "4T"}], sessions={"sub": {"slice": "2T"}})
    longest = {name: max(s.longest for s in of(records, Spin) if s.session == name) for name in ("pub", "sub")}
    assert longest == {"pub": 30 * MS, "sub": 2 * T}  # 10 ms by default, and three times that in a pause


def test_slices_are_longer_between_the_calls_of_a_repetition_and_do_not_delay_them() -> None:
    records = play([{"do": "publish", "by": "talker", "every": "1T", "times": 4, "as": "data"}])
    data = acts(records, "data")
    assert [act.begin - data[0].begin for act in data] == [0, T, 2 * T, 3 * T]
    spins = [spin for spin in of(records, Spin) if data[0].end <= spin.begin]
    assert {name: max(s.longest for s in spins if s.session == name) for name in ("pub", "sub")} == {
        "pub": 30 * MS, "sub": 30 * MS
    }  # fmt: skip
    assert [spin.longest for spin in spins if spin.session == "sub"][-1] == 10 * MS  # free for the next step


def test_between_branches_slices_stay_short() -> None:
    repeated = {"do": "publish", "by": "talker", "every": "1T", "times": 4}
    records = play([{"parallel": [[{"drive": "4T"}], [{"drive": "1T"}], [repeated]]}])
    assert {s.longest for s in of(records, Spin)} == {10 * MS}


def test_an_undriven_session_is_never_driven() -> None:
    records = play([{"drive": "2T"}], sessions={"sub": {"driven": False}})
    assert {spin.session for spin in of(records, Spin)} == {"pub"}


def test_explicit_drives_are_single_calls_of_that_session_and_of_nobody_else_meanwhile() -> None:
    records = play([{"do": "drive", "session": "sub", "timeout": "1T", "times": 3, "as": "calls"}, {"drive": "1T"}])
    calls = acts(records, "calls")
    assert [(act.op, act.session, act.result) for act in calls] == [("drive", "sub", 0)] * 3
    window = [s for s in of(records, Spin) if s.session == "sub" and calls[0].begin <= s.begin <= calls[-1].end]
    assert sum(spin.calls for spin in window if spin.end <= calls[-1].end) == 3


def test_branches_run_side_by_side_and_the_step_ends_with_the_last() -> None:
    branches = [[{"drive": "3T"}], [{"drive": "1T"}, {"do": "publish", "by": "talker", "as": "one"}]]
    records = play([{"parallel": branches, "as": "both"}])
    (both,), (one,) = acts(records, "both"), acts(records, "one")
    assert both.end - both.begin == 3 * T
    assert T <= one.begin - both.begin <= T + 10 * MS


def test_a_step_at_a_moment_begins_then() -> None:
    branches = [
        [{"do": "publish", "by": "talker", "every": "1T", "times": 2, "as": "data"}],
        [{"do": "take", "from": "listener", "at": "data.first + 0.5T", "as": "take"}],
    ]
    records = play([{"parallel": branches}])
    (take,), data = acts(records, "take"), acts(records, "data")
    assert 50 * MS <= take.begin - data[0].end <= 60 * MS


def test_settling_records_every_pair_that_can_meet_and_no_other() -> None:
    entities = {**PAIR, "other": {"publisher": "u"}, "crowd": {"publisher": "t", "count": 2}}
    pairs = {(m.publisher, m.subscription) for m in of(play(["settle"], entities), Matched)}
    assert pairs == {("talker", "listener"), ("crowd[0]", "listener"), ("crowd[1]", "listener")}


def test_entities_with_a_count_are_addressed_together_or_one_by_one() -> None:
    entities = {"crowd": {"publisher": "t", "count": 3}, "listener": {"subscription": "t"}}
    script = [{"do": "publish", "by": "crowd", "as": "all"}, {"do": "destroy", "of": "crowd[1]", "as": "one"}]
    records = play(script, entities)
    assert [act.entity for act in acts(records, "all")] == ["crowd[0]", "crowd[1]", "crowd[2]"]
    assert [act.entity for act in acts(records, "one")] == ["crowd[1]"]


def test_taken_samples_say_who_sent_them_under_which_label_and_in_which_order() -> None:
    script = [
        {"do": "publish", "by": "talker", "times": 3, "as": "data"}, {"drive": "1T"},
        {"do": "take", "from": "listener", "max": 2, "as": "two"}, {"do": "take", "from": "listener", "as": "rest"},
        {"do": "take", "from": "listener", "as": "none"},
    ]  # fmt: skip
    records = play(script)
    assert [(m.publisher, m.label, m.sequence) for m in of(records, Message)] == [
        ("talker", "data", n) for n in (1, 2, 3)
    ]
    assert [acts(records, label)[0].result for label in ("two", "rest", "none")] == [2, 1, -10]


def test_take_always_takes_while_driving_and_withheld_never() -> None:
    script = [{"do": "publish", "by": "talker", "times": 3}, {"drive": "1T"}]
    always = {**PAIR, "listener": {"subscription": "t", "take": "always"}}
    assert len(of(play(script, always), Message)) == 3
    assert of(play(script), Message) == []


def test_a_spin_dispatches_messages_and_events_under_its_cap() -> None:
    entities = {"talker": {"publisher": "t"}, "listener": {"subscription": "t", "register": ["LivelinessChanged"]}}
    script = [
        {"idle": "0.1T"},
        {"parallel": [
            [{"idle": "3T"}],
            [{"drive": "0.5T"}, {"do": "publish", "by": "talker", "times": 3},
             {"do": "spin", "timeout": 0, "cap": 1, "times": 5, "as": "spins"}],
        ]},
    ]  # fmt: skip
    records = play(script, entities)
    assert len(acts(records, "spins")) == 5
    assert [m.callback for m in of(records, Message)] == [True] * 3
    counts = [spin.callbacks for spin in of(records, Spin) if spin.callbacks and spin.session == "sub"]
    assert max(counts) == 1


def test_a_refused_creation_is_an_observation_when_it_may_fail_and_ends_the_play_otherwise() -> None:
    entities = {**PAIR, "bad": {"publisher": "not a name", "raw": True, "may_fail": True}}
    refused = [state for state in of(play([{"drive": "1T"}], entities), State) if state.what == "refused"]
    assert [(state.entity, state.code) for state in refused] == [("bad", -7)]


def test_everything_is_destroyed_in_the_end() -> None:
    states = of(play([{"drive": "1T"}]), State)
    assert [(s.session, s.what) for s in states if not s.entity] == [
        ("pub", "created"), ("sub", "created"), ("pub", "destroyed"), ("sub", "destroyed"),
    ]  # fmt: skip


def test_two_plays_are_the_same_but_for_the_tag_of_the_run() -> None:
    script = [{"do": "publish", "by": "talker", "every": "0.4T", "times": 5}, {"drive": "3T"}]
    assert [r for r in play(script) if not isinstance(r, Event)] == [
        r for r in play(script) if not isinstance(r, Event)
    ]


def test_the_expected_time_of_a_script_counts_branches_once() -> None:
    scenario = typed({
        "id": "x.y", "title": "t", "entities": PAIR, "expect": [],
        "script": [{"drive": "2T"}, {"parallel": [[{"idle": "5T"}], [{"drive": "1T"}]]},
                   {"do": "publish", "by": "talker", "every": "0.5T", "times": 5}],
    })  # fmt: skip
    assert expected_ns(scenario.script, {"T": T}) == 9 * T


def test_a_payload_survives_the_trip_and_foreign_bytes_are_nobodys() -> None:
    identity = payload.Identity(2**47, 3, 9, 4_000_000_000)
    assert payload.decode(payload.encode(identity)) == identity
    assert payload.decode(payload.encode(identity, 200)) == identity
    assert len(payload.encode(identity, 200)) == 200
    assert payload.decode(b"") is payload.decode(b"x" * 100) is None
