"""A correct backend never fails, a defective one never passes, however busy the host is."""

from __future__ import annotations

import zlib
from random import Random

import pytest

from nros_conformance.judge.judge import judge
from tests.judge.simulation import BROKEN, LOADS, SCENARIOS, Change, correct

SEEDS = 60


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
