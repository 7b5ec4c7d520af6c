"""The connection suite against defective variants of the reference: each fails where its defect shows."""

from __future__ import annotations

import functools
from pathlib import Path

import pytest

from nros_backends.reference.backend import ReferenceBackend
from nros_backends.reference.mutants import connection, removal
from nros_conformance.campaign.plans import Row, make_plan
from nros_conformance.judge.judge import judge
from nros_conformance.judge.results import Verdict
from nros_conformance.play.player import play_virtually
from nros_conformance.rmw.backend import Backend
from nros_conformance.rmw.mutants import Mutant
from nros_conformance.trace.records import Header, Trace
from tests.suites.test_suites import reference, scenario, suites


@functools.cache
def mutants() -> dict[str, Mutant]:
    return {one.name: one for one in (*connection.mutants(), *removal.mutants())}


@functools.cache
def verdict_of(key: str, adapter: type[Backend]) -> Verdict:
    header, *records = play_virtually(make_plan(scenario(key), Row(reference(), ""), suites(), Path()), adapter)
    assert isinstance(header, Header)
    return judge(Trace(header, tuple(records)))  # type: ignore[arg-type]


@pytest.mark.parametrize(("name", "key", "requirement"), [
    ("stale-pong", "con.ping-truth[kill=true]", "CON-001"),
    ("loopback-pong", "con.cut-off", "CON-001"),
    ("late-pong", "con.late-answer", "CON-001"),
    ("stale-pong-before", "con.ping-before-truth[kill=true]", "CON-001"),
    ("failed-once", "con.ping-before-truth[kill=false]", "CON-001"),
    ("traffic-prolongs", "con.traffic-is-no-answer", "CON-002"),
    ("ping-as-delay", "con.busy-link", "CON-002"),
    ("ignores-attempts", "con.attempts[who=in-session]", "CON-002"),
    ("ignores-attempts", "con.attempts-are-probes[attempts=3]", "CON-001"),
    ("dead-beside-session", "con.any-stage-beside", "CON-003"),
    ("dead-beside-entities", "con.any-stage", "CON-003"),
    ("ping-loses-data", "con.queued-data[queued=received]", "CON-003"),
    ("ping-runs-callbacks", "con.no-callback-in-ping", "CON-003"),
    ("restart-unnoticed", "con.restart-is-noticed[kill=true,outage=fast,side=pub]", "CON-004"),
    ("restart-unnoticed", "con.state-machine[outage=fast]", "CON-005"),
    ("create-blocks", "con.connect-to-a-dead-peer", "CON-006"),
    ("create-says-nothing", "con.create-with-a-dead-peer[side=publisher]", "CON-006"),
    ("destroy-blocks", "con.destroy-with-a-dead-peer[entities_first=false]", "CON-006"),
    ("failed-once", "con.absent-at-start[absence=short]", "CON-005"),
    ("eight-sessions", "con.twenty-restarts", "CON-005"),
    ("gives-up", "con.long-outages[outage=half-a-minute]", "CON-005"),
    ("gives-up-later", "con.longest-outage", "CON-005"),
    ("gives-up-later", "con.longest-absence", "CON-005"),
    ("deaf-at-first", "con.hears-at-once", "CON-005"),
    ("halfway", "con.halfway", "CON-005"),
    ("later-unserved", "con.later-subscribers", "CON-005"),
    ("removes-nobody", "con.hard-silence[client=cut-off]", "CON-008"),
    ("removes-nobody", "con.hard-silence-is-seen[client=cut-off]", "CON-008"),
    ("removes-nobody", "con.hard-silence-is-seen[client=frozen]", "CON-008"),
    ("removes-late", "con.hard-silence-is-seen[client=cut-off]", "CON-008"),
    ("removed-unseen", "con.hard-silence-is-seen[client=cut-off]", "CON-008"),
    ("removes-early", "con.hard-silence[client=cut-off]", "CON-009"),
    ("removes-early", "con.hard-silence-is-seen[client=cut-off]", "CON-009"),
    ("removes-early", "con.hard-pause", "CON-009"),
    ("only-data-is-life", "con.hard-idle", "CON-009"),
    ("only-data-is-life", "con.hard-receiver", "CON-009"),
    ("only-answers-are-life", "con.hard-data", "CON-009"),
    ("unaware", "con.hard-return", "CON-010"),
])  # fmt: skip
def test_a_defect_fails_where_it_shows(name: str, key: str, requirement: str) -> None:
    assert verdict_of(key, ReferenceBackend).verdict == "pass"
    verdict = verdict_of(key, mutants()[name].adapter)
    assert verdict.verdict == "fail"
    assert requirement in {one for finding in verdict.failed() for one in finding.proves}


@pytest.mark.parametrize(("name", "key"), [
    ("into-the-void", "con.death-is-noticed[side=pub]"),
    ("into-the-void", "con.death-is-noticed[side=sub]"),
    ("receiver-unaware", "con.death-is-noticed[side=sub]"),
    ("quiet-is-dead", "con.idle-is-healthy[side=sub]"),
])  # fmt: skip
def test_a_defect_against_a_should_is_a_warning(name: str, key: str) -> None:
    assert verdict_of(key, ReferenceBackend).verdict == "pass"
    assert verdict_of(key, mutants()[name].adapter).verdict == "warn"


@pytest.mark.parametrize(("name", "key"), [
    ("keeps-its-slot", "con.destroy-with-a-dead-peer[entities_first=true]"),
    ("endpoint-taken", "con.hard-successor"),
])  # fmt: skip
def test_a_creation_that_should_work_and_does_not_ends_the_play(name: str, key: str) -> None:
    assert verdict_of(key, mutants()[name].adapter).verdict == "fail"


def test_one_that_only_receives_is_told_apart() -> None:
    assert verdict_of("con.death-is-noticed[side=pub]", mutants()["receiver-unaware"].adapter).verdict == "pass"
