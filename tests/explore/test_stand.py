"""Playing on the real clock: in worker processes, many at once, and whatever the backend does is an outcome."""

from __future__ import annotations

import functools
from pathlib import Path

import msgspec
import pytest

from nros_conformance.campaign.plans import Row
from nros_conformance.explore.explore import explore
from nros_conformance.explore.search import generate
from nros_conformance.explore.stand import Outcome, Stand, deviations
from nros_conformance.explore.timelines import Action, Timeline, behind
from nros_conformance.formats.places import FormatError
from nros_conformance.judge.results import Verdict
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.declaration import Declaration, Known
from nros_conformance.rmw.discovery import find_backend
from nros_conformance.rmw.events import EventKind
from nros_conformance.suite.loader import Suites, load_suites
from nros_conformance.trace.records import Act, FaultRecord

KNOWN = Known(
    key="K1", requirement="LVL-002", scenario="x", cause="middleware", because="so", link="unreported",
    model="expired_lease_ignores_assertions",
)  # fmt: skip
UNREAD = Timeline(
    (Action("destroy", "first"), Action("publish", "steady"), Action("create", "first")), (EventKind.MESSAGE_LOST,)
)
READ = Timeline(
    (Action("destroy", "first"), Action("publish", "steady"), Action("take", "second"), Action("create", "first")),
    (EventKind.MESSAGE_LOST,),
)


@functools.cache
def suites() -> Suites:
    return load_suites()


def declaration() -> Declaration:
    found = find_backend("reference").declaration
    assert found is not None
    return found


def real(adapter: str, folder: Path) -> Stand:
    row = Row(declaration(), adapter, clock="real")
    return Stand(row, find_backend("reference").load(), suites(), folder)


@pytest.fixture
def _fragile(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(Path(__file__).parent / "adapters")


def test_a_right_backend_passes_on_the_real_clock(tmp_path: Path) -> None:
    stand = real("nros_backends.reference:ReferenceBackend", tmp_path)
    outcomes = stand.play(generate(stand.cast, 6, 3))
    assert {one.verdict.verdict for one in outcomes} <= {"pass", "none", "inconclusive"}
    assert stand.played >= 6
    assert list(tmp_path.glob("*.jsonl")) == []


@pytest.mark.usefixtures("_fragile")
def test_a_crash_is_the_outcome_of_the_timeline_that_caused_it(tmp_path: Path) -> None:
    read, unread = real("fragile:Segfaults", tmp_path).play([READ, UNREAD])
    assert not read.fails
    assert unread.fails
    assert unread.cause == "the backend crashed"
    assert unread.requirements == {"the backend crashed"}
    assert unread.verdict.reason.startswith(
        "the backend crashed: the process died of SIGSEGV, in string_at at __init__.py"
    )


@pytest.mark.usefixtures("_fragile")
def test_a_hang_is_an_outcome_too(tmp_path: Path) -> None:
    (unread,) = real("fragile:Sleeps", tmp_path).play([UNREAD])
    assert (unread.fails, unread.cause) == (True, "the backend hung")


def test_a_fail_that_is_known_does_not_count() -> None:
    outcome = Outcome(Verdict(verdict="fail", reason="LVL-002: total 1"), "K1")
    assert (outcome.fails, outcome.unclear, outcome.cause) == (False, False, "LVL-002")


def test_a_deviation_that_no_model_has_is_an_error() -> None:
    wrong = msgspec.structs.replace(declaration(), known=[msgspec.structs.replace(KNOWN, model="expired_lease")])
    with pytest.raises(FormatError) as caught:
        deviations(wrong, {})
    assert str(caught.value) == (
        "reference: [[known]] K1: there is no model 'expired_lease'; valid are expired_lease_ignores_assertions"
    )


def test_shipped_deviations_have_models_that_exist() -> None:
    found = find_backend("cyclone").declaration
    assert found is not None
    assert deviations(found, {"cyclonedds": "11.0.1"}) == {"expired_lease_ignores_assertions": "C2"}
    assert deviations(found, {"cyclonedds": "11.0.2"}) == {}


def test_how_far_a_play_was_behind_its_timeline() -> None:
    def act(label: str, end_ms: float) -> Act:
        return Act(label=label, op="", due=0, begin=0, end=int(end_ms * MS))

    timeline = Timeline((Action("publish", "steady"), Action("drive", count=2), Action("take", "first")))
    on_time = [act("go", 1000), act("a0", 1000), act("a1", 1080), act("a2", 1100)]
    assert behind(timeline, on_time) == 0
    late = [*on_time[:2], act("a1", 1089), act("a2", 1103)]
    assert behind(timeline, late) == pytest.approx(0.09)
    assert behind(timeline, [act("go", 0), act("a1", 178)], 200 * MS) == pytest.approx(0.09)
    lost = FaultRecord(label="a0", fault="lose", begin=0, end=1007 * MS)
    assert behind(timeline, [act("go", 1000), lost]) == pytest.approx(0.07)
    assert behind(timeline, [act("a2", 5000)]) == 0
    end = len(timeline.actions)
    assert behind(timeline, [*on_time, act(f"a{end}", 9_000)]) > 1, "what it ends with is looked at too"


@pytest.mark.usefixtures("_fragile")
def test_what_is_found_on_the_real_clock_has_failed_twice_and_is_shrunk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    long = Timeline((*UNREAD.actions, Action("assert", "manual")), UNREAD.kinds)
    monkeypatch.setattr("nros_conformance.explore.explore.generate", lambda cast, examples, seed: [long, long])
    search = explore(real("fragile:Raises", tmp_path), 2, 1)
    (found,) = search.found
    assert found.timeline == UNREAD
    assert found.others == 1
    assert found.verdict.reason.startswith("the backend failed: create raised ValueError: a sample is left at ")
    assert search.plays >= 2 + 1 + 2 * 2


def test_what_fails_once_and_not_again_is_not_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stand = real("nros_backends.reference:ReferenceBackend", tmp_path)
    fine, bad = Outcome(Verdict(verdict="pass")), Outcome(Verdict(verdict="fail", reason="MSL-001: total 0"))
    answers = iter([bad, fine, fine])
    monkeypatch.setattr(stand, "play", lambda timelines, watch=None: [next(answers) for _ in timelines])
    monkeypatch.setattr("nros_conformance.explore.explore.generate", lambda cast, examples, seed: [READ])
    search = explore(stand, 1, 1)
    assert (search.found, dict(search.once)) == ([], {"MSL-001": 1})
