from __future__ import annotations

from typing import Any

from nros_backends.reference import ReferenceBackend
from nros_backends.reference.backend import ReferenceSession, ReferenceSubscription
from nros_conformance.rmw.clock import MS
from nros_conformance.trace.records import Act, Cycles, Measure, State
from tests.play.scripts import PAIR, T, acts, of, play

BORN: dict[str, Any] = {"talker": PAIR["talker"], "listener": {**PAIR["listener"], "deferred": True}}
CYCLE: list[dict[str, Any]] = [
    {"do": "create", "entity": "listener", "as": "made"},
    {"do": "publish", "by": "talker", "as": "sent"},
    {"drive": "1.5T"},
    {"do": "take", "from": "listener", "as": "took"},
    {"do": "destroy", "of": "listener", "as": "gone"},
]


def test_the_turns_of_a_cycle_are_summed_up_and_leave_no_other_record() -> None:
    records = play([{"cycle": 7, "script": CYCLE, "as": "turns"}], BORN)
    (cycles,) = of(records, Cycles)
    assert (cycles.label, cycles.times) == ("turns", 7)
    assert cycles.answers == {"made": [7], "sent": [7], "#4": [7], "took": [7], "gone": [7]}
    assert [act.result for act in cycles.calls["took"]] == [1]
    assert cycles.received == {"listener": [1, 1]}
    assert cycles.events == {"listener/RequestedDeadlineMissed": [1, 1]}
    assert cycles.end - cycles.begin >= 7 * 1.5 * T
    assert [act.label for act in of(records, Act)] == ["turns"]
    assert [state.what for state in of(records, State) if state.entity == "listener"] == []


class _Third(ReferenceSubscription):
    """Only the first three of a backend hear anything."""

    def try_recv_raw(self, max_size: int) -> bytes | int:
        return super().try_recv_raw(max_size) if self.id < 6 else -1


class _ThirdSession(ReferenceSession):
    subscription_type = _Third


class _Deaf(ReferenceBackend):
    session_type = _ThirdSession


def test_different_answers_are_told_apart_and_a_turn_without_a_sample_shows() -> None:
    (cycles,) = of(play([{"cycle": 5, "script": CYCLE, "as": "turns"}], BORN, adapter=_Deaf), Cycles)
    assert [act.result for act in cycles.calls["took"]] == [1, -1]
    assert cycles.answers["took"] == [3, 2]
    assert cycles.received == {"listener": [0, 1]}


def test_what_follows_a_cycle_is_written_down_again() -> None:
    records = play([{"cycle": 2, "script": CYCLE}, {"do": "publish", "by": "talker", "as": "after"}], BORN)
    assert [act.result for act in acts(records, "after")] == [0]


def test_a_phase_is_drawn_by_the_seed_and_shorter_than_it_says() -> None:
    lasted = [act.end - act.begin for act in acts(play([{"phase": "1T", "as": "p"}, {"phase": "1T"}]), "p")]
    assert len(lasted) == 1
    assert 0 <= lasted[0] < T
    assert lasted == [act.end - act.begin for act in acts(play([{"phase": "1T", "as": "p"}, {"phase": "1T"}]), "p")]


def test_threads_descriptors_and_memory_are_measured() -> None:
    script = [{"do": "measure", "what": what} for what in ("threads", "descriptors", "memory")]
    values = {record.what: record.value for record in of(play(script, needs={"process": "own"}), Measure)}
    assert values["threads"] >= 1
    assert values["descriptors"] >= 3
    assert values["memory"] > 1_000_000


def test_a_released_callback_is_told_from_one_that_is_in_force() -> None:
    records = play(
        [
            {"do": "register", "of": "listener", "kind": "RequestedDeadlineMissed", "times": 3, "as": "held"},
            {"do": "released", "registration": "held", "as": "in-force"},
            {"do": "released", "registration": "held", "but_last": True, "as": "replaced"},
            {"do": "destroy", "of": "listener"},
            {"do": "released", "registration": "held", "as": "gone"},
        ]
    )
    assert [acts(records, label)[0].result for label in ("in-force", "replaced", "gone")] == [False, True, True]


def test_a_stale_creation_does_not_bring_the_session_back() -> None:
    late = {**BORN, "listener": {**BORN["listener"], "may_fail": True}}
    records = play(
        [
            {"do": "destroy", "of": "sub"},
            {"do": "create", "entity": "listener", "stale": True, "as": "stale"},
            {"do": "create", "entity": "listener", "as": "anew"},
            {"drive": "0.1T"},
        ],
        late,
    )
    assert acts(records, "stale")[0].result == -4
    assert acts(records, "anew")[0].result == 0
    assert all(act.end - act.begin < 1 * MS for act in of(records, Act) if act.op == "create")
