"""A correct backend never fails, a defective one never passes, however busy the host is."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from random import Random
from typing import Any

import pytest

from nros_conformance.judge.judge import judge
from nros_conformance.trace.records import Act, AnyRecord, Event, State, Trace
from tests.judge.build import ALL, RDM, act, alive, counted, state, step, trace
from tests.judge.simulation import LOADS, Load, Occurrence, call, drive, written

SEEDS = 60
T = 100.0

Change = Callable[[Random, list[float]], list[float]]
"""What a backend makes of the times at which something is really due."""


def correct(dice: Random, due: list[float]) -> list[float]:
    return due


def fires_late(dice: Random, due: list[float]) -> list[float]:
    return [at + 75 for at in due]


def fires_early(dice: Random, due: list[float]) -> list[float]:
    return [at - 20 for at in due]


def one_too_many(dice: Random, due: list[float]) -> list[float]:
    return sorted([*due, due[0] + 10 + 70 * dice.random()])


def one_too_few(dice: Random, due: list[float]) -> list[float]:
    left = dice.randrange(min(3, len(due)))
    return due[:left] + due[left + 1 :]


def never_fires(dice: Random, due: list[float]) -> list[float]:
    return []


BROKEN = {
    "late": fires_late,
    "early": fires_early,
    "one too many": one_too_many,
    "one too few": one_too_few,
    "never": never_fires,
}


def finish(expect: Any, ours: list[AnyRecord], calls: Sequence[Act | State], end: float) -> Trace:
    """Both threads' records, in the order in which they are written."""
    placed = [(written(one.end), one) for one in calls]
    last = 0.0
    for one in ours:
        last = max(last, written(one.t if isinstance(one, Event) else one.end))  # type: ignore[union-attr]
        placed.append((last, one))  # type: ignore[arg-type]
    placed.sort(key=lambda pair: pair[0])
    return trace(expect, [one for _, one in placed], setup=tuple(ALL), end=end + 60)


def numbered(times: list[float], kind: str = RDM) -> list[Occurrence]:
    def event(number: int) -> Callable[[float, float], Event]:
        return lambda t, wait: counted(t, number, wait=wait, kind=kind)

    return [(at, event(number)) for number, at in enumerate(times, 1)]


def silence(dice: Random, load: Load, backend: Change) -> Trace:
    """Samples in time, then none for 3.5 T: a miss per period."""
    calls, received = [], 0.0
    for index in range(5):
        begin, effect, end = call(dice, load, 20 + index * 0.4 * T)
        calls.append(act("data", begin, end, index=index, sequence=index + 1))
        received = effect + dice.random()
    begin = end
    over = begin + 3.5 * T
    calls.append(step("silence", begin, over + load.delay(dice)))
    due = [received + n * T for n in range(1, 8)]
    expect = [
        {"periodic": RDM, "of": "listener", "every": "1T", "since": "data.last", "until": "silence.end"},
        {"never": RDM, "of": "listener", "until": "data.last"},
    ]
    return finish(expect, drive(dice, load, numbered(backend(dice, due)), over + 60), calls, over)


def absence(dice: Random, load: Load, backend: Change) -> Trace:
    """A phase in which nobody calls drive_io, in the middle of a silence."""
    begin, effect, end = call(dice, load, 20)
    over = end + 5.5 * T
    due = [effect + dice.random() + n * T for n in range(1, 9)]
    ours = drive(dice, load, numbered(backend(dice, due)), over + 60, idle=(60, 250))
    expect = {"periodic": RDM, "of": "listener", "every": "1T", "since": "one", "until": "rest.end"}
    return finish(expect, ours, [act("one", begin, end, sequence=1), step("rest", end, over)], over)


def lost_once(dice: Random, load: Load, backend: Change) -> Trace:
    """A publisher that stops asserting: one transition, and no more."""
    begin, effect, end = call(dice, load, 20)
    over = end + 3.5 * T
    expect = [
        {"total": RDM, "of": "listener", "at": "one + 0.9T", "is": 0},
        {"total": RDM, "of": "listener", "at": "one + 1.6T", "is": 1},
        {"total": RDM, "of": "listener", "at": "end", "is": 1},
    ]
    ours = drive(dice, load, numbered(backend(dice, [effect + T])), over + 60)
    return finish(expect, ours, [act("one", begin, end, op="assert"), step("rest", end, over)], over)


def gone(dice: Random, load: Load, backend: Change) -> Trace:
    """A publisher that comes and goes."""
    come_begin, came, come_end = call(dice, load, 20)
    go_begin, went, go_end = call(dice, load, come_end + 4 * T)
    over = go_end + 3.5 * T
    times = backend(dice, [came + dice.random() * 1.9 * T, went + dice.random() * 1.9 * T])
    if backend is fires_late:
        times = [came + 3 * T, went + 3 * T]
    steps = [(1, 1), (0, -1), (1, 1)]
    ready: list[Occurrence] = [
        (at, lambda t, wait, count=count, change=change: alive(t, count, change, wait=wait))  # type: ignore[misc]
        for at, (count, change) in zip(times, steps, strict=False)
    ]
    expect = [
        {"level": "alive_count", "of": "listener", "is": 0, "until": "come.begin"},
        {"level": "alive_count", "of": "listener", "is": 1, "by": "come + 2T"},
        {"level": "alive_count", "of": "listener", "is": 1, "from": "come + 2T", "until": "go"},
        {"level": "alive_count", "of": "listener", "is": 0, "by": "go + 2T"},
        {"level": "alive_count", "of": "listener", "is": 0, "from": "go + 2T"},
    ]
    calls = [act("come", come_begin, come_end, op="create"), act("go", go_begin, go_end, op="destroy")]
    created = state("created", come_begin, "talker", end=come_end)
    ours = drive(dice, load, ready, over + 60)
    return finish(expect, ours, [created, *calls, step("rest", go_end, over)], over)


SCENARIOS = {"silence": silence, "absence": absence, "lost once": lost_once, "gone": gone}


def verdicts(scenario: str, load: str, backend: Change, seeds: int = SEEDS) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    for seed in range(seeds):
        dice = Random(zlib.crc32(f"{scenario} {load} {seed}".encode()))
        result = judge(SCENARIOS[scenario](dice, LOADS[load], backend))
        found.append((result.verdict, result.reason))
    return found


@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_a_correct_backend_never_fails(scenario: str, load: str) -> None:
    found = verdicts(scenario, load, correct)
    assert {verdict for verdict, _ in found} <= {"pass", "inconclusive"}, found
    if load == "idle":
        assert {verdict for verdict, _ in found} == {"pass"}, found


@pytest.mark.parametrize("backend", BROKEN)
@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_a_defective_backend_never_passes(scenario: str, load: str, backend: str) -> None:
    if scenario == "gone" and backend in ("early", "one too many"):
        pytest.skip("a transition before its cause is another scenario's business")
    if scenario == "lost once" and backend == "early" and load == "overloaded":
        pytest.skip("an event that the host delivers in time was not early for anybody")
    found = verdicts(scenario, load, BROKEN[backend])
    assert {verdict for verdict, _ in found} <= {"fail", "inconclusive"}, found
    if load == "idle":
        assert {verdict for verdict, _ in found} == {"fail"}, found


def test_a_sample_of_every_outcome_on_a_busy_host() -> None:
    busy = [verdict for scenario in SCENARIOS for verdict, _ in verdicts(scenario, "busy", correct)]
    assert busy.count("pass") > 0.5 * len(busy)
