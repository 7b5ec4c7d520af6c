"""The suites that are shipped, on the reference in virtual time."""

from __future__ import annotations

import functools
import multiprocessing
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from nros_backends.reference import ReferenceBackend
from nros_conformance.campaign.plans import Row, make_plan
from nros_conformance.campaign.selection import decide, proven
from nros_conformance.judge.judge import judge
from nros_conformance.play.plan import expected_ns
from nros_conformance.play.player import play_virtually
from nros_conformance.play.process import QUANTITIES
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.declaration import Declaration
from nros_conformance.rmw.discovery import find_backend
from nros_conformance.suite.kinds import faults_needed
from nros_conformance.suite.loader import Loaded, Suites, load_suites
from nros_conformance.suite.schema import PROFILES
from nros_conformance.trace.records import AnyRecord, Event, Header, Measure, Trace

LONGEST_NS = 4_000 * MS
"""Of a standard scenario at T = 130 ms; those that are longer belong to the profile publish."""

SMOKE_NS = 2_000 * MS


@functools.cache
def suites() -> Suites:
    return load_suites()


@functools.cache
def reference() -> Declaration:
    declaration = find_backend("reference").declaration
    assert declaration is not None
    return declaration


def keys(*statuses: str) -> list[str]:
    """Of the scenarios that the reference plays, or leaves out for such a reason."""
    return [one.key for one in suites().scenarios if decide(one, reference()).status in statuses]


def scenario(key: str) -> Loaded:
    return next(one for one in suites().scenarios if one.key == key)


def play(one: Loaded) -> tuple[Header, tuple[AnyRecord, ...]]:
    plan = make_plan(one, Row(reference(), reference().adapter), suites(), Path())
    plan = msgspec.structs.replace(plan, trace="")
    if one.scenario.needs.process == "own":  # it counts threads and descriptors, and other tests leave some behind
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as apart:
            header, *records = apart.submit(play_virtually, plan, ReferenceBackend).result()
    else:
        header, *records = play_virtually(plan, ReferenceBackend)
    assert isinstance(header, Header)
    return header, tuple(records)  # type: ignore[arg-type]


def comparable(records: Sequence[AnyRecord]) -> list[AnyRecord]:
    """Threads are numbered in the order of their appearance; their names are not the same twice."""
    numbers: dict[int, int] = {}
    plain: list[AnyRecord] = []
    for record in records:
        if isinstance(record, Event):
            thread, driver = (numbers.setdefault(one, len(numbers)) for one in (record.thread, record.driver))
            plain.append(replace(record, thread=thread, driver=driver, process=0))
        elif isinstance(record, Measure) and record.what in QUANTITIES:
            plain.append(replace(record, value=0))  # of the process of the tests, where other things go on
        else:
            plain.append(record)
    return plain


@pytest.mark.parametrize("key", keys("play"))
def test_the_reference_passes_on_evidence_and_two_plays_are_equal(key: str) -> None:
    one = scenario(key)
    header, records = play(one)
    verdict = judge(Trace(header, records))
    assert (verdict.verdict, verdict.reason, verdict.warnings) == ("pass", "", ())
    assert [finding for finding in verdict.findings if not finding.implied and finding.outcome != "pass"] == []
    assert comparable(play(one)[1]) == comparable(records)


@pytest.mark.parametrize("key", keys("play", "not-applicable", "untested"))
def test_every_expectation_proves_something_that_exists(key: str) -> None:
    one = scenario(key)
    assert proven(one)
    assert set(proven(one)) <= set(suites().levels)


@pytest.mark.parametrize("key", keys("untested"))
def test_what_the_reference_cannot_play_says_which_fault_it_lacks(key: str) -> None:
    one = scenario(key)
    reason = decide(one, reference()).reason
    assert reason in {f"the fault {fault} cannot be injected here" for fault in faults_needed(one.scenario)}


def test_standard_scenarios_are_short_and_those_of_the_smoke_profile_very_short() -> None:
    too_long = []
    for one in suites().scenarios:
        quantities = {
            "T": one.scenario.scale.T.ns({}),
            "tolerance": 39 * MS,
            "early": 6 * MS,
            **reference().quantities(),
        }
        lasts = expected_ns(one.scenario.script, quantities)
        limit = {"smoke": SMOKE_NS, "standard": LONGEST_NS}.get(one.scenario.profile)
        # What waits for a declared lease or timeout lasts as long as that.
        waits = any(quantity in str(one.raw) for quantity in ("connection_lease", "hard_liveliness"))
        if limit is not None and lasts > limit and not waits:
            too_long.append((one.key, lasts / 1e9))
    assert too_long == []


def test_each_group_of_requirements_about_events_is_covered() -> None:
    covered = {requirement for one in suites().scenarios for requirement in proven(one)}
    events = {
        one.id
        for one in suites().requirements
        if one.group in ("REG", "DSP", "CNT", "RDM", "ODM", "LVC", "LVL", "MSL", "QOS")
    }
    assert events - covered == set()


def test_every_profile_has_scenarios_of_its_own() -> None:
    assert {one.scenario.profile for one in suites().scenarios} == set(PROFILES)
