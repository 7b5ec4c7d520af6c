from __future__ import annotations

from typing import Any

import pytest

from nros_conformance.trace.records import Cycles, Starved
from tests.judge.build import act, finding, ms


def summed(**fields: Any) -> Cycles:
    return Cycles(label="loop", times=5, begin=ms(1), end=ms(2), **fields)


def took(result: int) -> Any:
    return act("took", 10, op="take", entity="listener", session="sub", result=result)


LOOP = {"cycles": "loop"}


@pytest.mark.parametrize(
    ("calls", "answers", "outcome", "got"),
    [
        ([took(1)], [5], "pass", "5 times in 5 cycles"),
        ([took(1), took(-10)], [4, 1], "fail", "NO_DATA (-10) once in 5 cycles"),
        ([took(-1)], [5], "fail", "ERROR (-1) 5 times in 5 cycles"),
        ([], [], "none", "took was not called"),
    ],
)
def test_answers_of_a_step(calls: list[Any], answers: list[int], outcome: str, got: str) -> None:
    record = summed(calls={"took": calls}, answers={"took": answers})
    found = finding({**LOOP, "step": "took", "is": ["DATA"]}, record)
    assert (found.outcome, found.got) == (outcome, got)
    assert found.name == "each cycle of loop: took"


@pytest.mark.parametrize(("op", "result", "outcome"), [
    ("destroy", -2, "unclear"), ("create", -2, "unclear"), ("destroy", -4, "fail"), ("publish", -2, "fail"),
])  # fmt: skip
def test_a_peer_that_had_not_answered_because_threads_had_no_core_is_unclear(
    op: str, result: int, outcome: str
) -> None:
    call = act("took", 10, op=op, entity="listener", session="sub", result=result)
    record = summed(calls={"took": [call]}, answers={"took": [1]})
    starved = Starved(begin=ms(0), end=ms(9), wait=ms(8) - ms(0))
    assert finding({**LOOP, "step": "took", "is": ["OK"]}, starved, record).outcome == outcome


@pytest.mark.parametrize(("result", "outcome"), [(-10, "unclear"), (-1, "fail")])
def test_a_sample_that_had_not_come_because_threads_had_no_core_is_unclear(result: int, outcome: str) -> None:
    record = summed(calls={"took": [took(1), took(result)]}, answers={"took": [4, 1]})
    starved = Starved(begin=ms(0), end=ms(9), wait=ms(8) - ms(0))
    assert finding({**LOOP, "step": "took", "is": ["DATA"]}, starved, record).outcome == outcome


@pytest.mark.parametrize(
    ("range_", "outcome", "got"),
    [
        ([1, 1], "pass", "1 in each of 5 cycles"),
        ([0, 3], "fail", "0 to 3 in 5 cycles"),
        (None, "fail", "0 in each of 5 cycles"),
    ],
)
def test_samples_and_events(range_: list[int] | None, outcome: str, got: str) -> None:
    record = summed(
        received={} if range_ is None else {"listener": range_},
        events={} if range_ is None else {"listener/MessageLost": range_},
    )
    assert finding({**LOOP, "sampled": "listener"}, record).outcome == outcome
    found = finding({**LOOP, "event": "MessageLost", "of": "listener"}, record)
    assert (found.outcome, found.got) == (outcome, got)
    assert found.wanted == "listener counts at least 1 MessageLost in each cycle"


@pytest.mark.parametrize(("range_", "outcome"), [([0, 1], "unclear"), ([0, 0], "fail")])
def test_what_came_in_some_cycles_only_while_threads_had_no_core_is_unclear(range_: list[int], outcome: str) -> None:
    record = summed(received={"listener": range_}, events={"listener/MessageLost": range_})
    starved = Starved(begin=ms(1), end=ms(2), wait=ms(8) - ms(0))
    for expected in ({"sampled": "listener"}, {"event": "MessageLost", "of": "listener"}):
        assert finding({**LOOP, **expected}, starved, record).outcome == outcome


def test_without_a_turn_nothing_is_said() -> None:
    found = finding({**LOOP, "sampled": "listener"})
    assert (found.outcome, found.got) == ("none", "no cycle of loop was played")
