from __future__ import annotations

import functools
import sys
from collections.abc import Collection
from pathlib import Path

import msgspec
import pytest

from nros_backends.reference import ReferenceBackend
from nros_conformance.campaign.plans import Row
from nros_conformance.explore.cast import Cast
from nros_conformance.explore.explore import compare, explore
from nros_conformance.explore.mutation import play_defective
from nros_conformance.explore.search import HypothesisMissing
from nros_conformance.explore.stand import Stand
from nros_conformance.explore.timelines import Action, Timeline, scenario
from nros_conformance.explore.writing import as_suite
from nros_conformance.judge.judge import judge
from nros_conformance.model.deviations import ExpiredLeaseIgnoresAssertions
from nros_conformance.model.world import Id, Occurrence, World, _Publisher
from nros_conformance.rmw.backend import Backend
from nros_conformance.rmw.discovery import find_backend
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.mutants import find_mutants
from nros_conformance.suite.loader import Suites, load_suites
from tests.explore.test_stand import KNOWN


@functools.cache
def suites() -> Suites:
    return load_suites()


def stand(adapter: type[Backend] = ReferenceBackend) -> Stand:
    found = find_backend("reference")
    assert found.declaration is not None
    return Stand(Row(found.declaration, found.adapter), adapter, suites())


class _Forgets(World):
    """Two defects that hide each other: the numbers of whoever is lost are forgotten, and the next one synchronises."""

    def _tell(self, id_: Id, publisher: _Publisher, at_ns: int, alive: bool | None) -> list[Occurrence]:
        if alive is False:
            self.__dict__.setdefault("forgotten", set()).add(id_)
        return super()._tell(id_, publisher, at_ns, alive)

    def publish(
        self, id_: Id, data: bytes, at_ns: int, *, lost: bool = False, deaf: Collection[Id] = ()
    ) -> list[Occurrence]:
        forgotten = self.__dict__.get("forgotten", set())
        if id_ in forgotten and not lost:
            forgotten.remove(id_)
            for subscription in self._subscriptions.values():
                subscription.heard[id_] = self._publishers[id_].sequence
        return super().publish(id_, data, at_ns, lost=lost, deaf=deaf)


class Forgetful(ReferenceBackend):
    world_type = _Forgets


def test_the_reference_does_what_the_model_says() -> None:
    search = explore(stand(), 20, 7)
    assert search.found == []
    assert search.plays == search.timelines == 20


def test_interacting_defects_are_found_and_shrunk_to_at_most_six_actions(tmp_path: Path) -> None:
    (found,) = explore(stand(Forgetful), 40, 37).found
    assert len(found.timeline.actions) <= 6
    assert {"lose", "publish"} <= {action.verb for action in found.timeline.actions}
    assert found.verdict.reason.startswith("MSL-001: ")
    (tmp_path / "explored.yaml").write_text(as_suite([found]), encoding="utf-8")
    (loaded,) = load_suites(tmp_path).scenarios
    assert loaded.scenario.id == "x.reference-1"
    assert judge(play_defective(loaded, stand().row, suites(), Forgetful)).reason == found.verdict.reason
    assert judge(play_defective(loaded, stand().row, suites(), ReferenceBackend)).verdict == "pass"


class ForgetfulAndDeaf(ReferenceBackend):
    world_type = type("_Both", (_Forgets, ExpiredLeaseIgnoresAssertions), {})


def test_what_is_known_is_told_from_what_is_new_and_does_not_hide_it() -> None:
    found = find_backend("reference")
    assert found.declaration is not None
    known = msgspec.structs.replace(found.declaration, known=[KNOWN])
    both = Stand(Row(known, found.adapter), ForgetfulAndDeaf, suites())
    search = explore(both, 40, 25)
    assert set(search.known) == {"K1"}
    assert [one.verdict.reason.partition(":")[0] for one in search.found] == ["MSL-001"]
    undeclared = explore(stand(ForgetfulAndDeaf), 40, 25)
    assert not undeclared.known
    assert {"MSL-001", "LVC-009"} <= {one.verdict.reason.partition(":")[0] for one in undeclared.found}


def test_the_same_seed_finds_the_same() -> None:
    early = next(one.adapter for one in find_mutants()["reference"] if one.name == "fires-early")
    first, second = (explore(stand(early), 15, 3) for _ in range(2))
    assert first.found
    assert (first.plays, first.found) == (second.plays, second.found)


def test_what_cannot_be_done_is_left_out() -> None:
    actions = (
        Action("create", "first"), Action("destroy", "first"), Action("take", "first"), Action("destroy", "first"),
        Action("create", "first"), Action("register", "first"), Action("take", "first"),
    )  # fmt: skip
    assert [action.verb for action in Timeline(actions).sensible().actions] == ["destroy", "create", "take"]


@pytest.mark.parametrize(
    ("first", "then"), [(("create", "first"), ("publish", "steady")), (("publish", "steady"), ("take", "second"))]
)
def test_what_needs_its_way_gets_time(first: tuple[str, str], then: tuple[str, str]) -> None:
    actions = (Action("destroy", "first"), Action(*first), Action("assert", "manual"), Action(*then))
    assert [one.verb for one in Timeline(actions).sensible().actions] == [
        "destroy", first[0], "assert", "drive", then[0],
    ]  # fmt: skip


def test_the_expectations_are_what_the_model_says() -> None:
    raw = scenario(
        Timeline((Action("publish", "steady"), Action("drive", count=6)), (EventKind.OFFERED_DEADLINE_MISSED,))
    )
    totals = [(one["of"], one["at"], one["is"]) for one in raw["expect"]]
    assert totals == [
        ("steady", "a1.end - 0.1T", 2), ("manual", "a1.end - 0.1T", 0),
        ("steady", "a2.end - 0.1T", 3), ("manual", "a2.end - 0.1T", 0),
    ]  # fmt: skip


def losses(*actions: Action, forgets: bool = False) -> list[tuple[str, int, int]]:
    raw = scenario(Timeline((*actions, Action("drive")), (EventKind.MESSAGE_LOST,)), cast=Cast(forgets=forgets))
    asked = [one for one in raw["expect"] if one["at"] == f"a{len(actions)}.end - 0.1T" and one["of"] == "first"]
    return [(one["of"], one.get("at_least", one.get("is")), one.get("at_most", one.get("is"))) for one in asked]


def test_a_loss_may_be_told_before_a_sample_shows_the_gap_and_has_to_be_told_then() -> None:
    begun = Action("publish", "steady")
    assert losses(begun, Action("lose", "steady", 2)) == [("first", 0, 2)]
    assert losses(begun, Action("lose", "steady", 2), Action("publish", "steady")) == [("first", 2, 2)]


def test_a_loss_before_the_first_sample_that_arrives_need_not_be_counted() -> None:
    assert losses(Action("lose", "steady", 2), Action("publish", "steady")) == [("first", 0, 2)]
    assert losses(Action("lose", "steady", 2), Action("publish", "steady", 6)) == [("first", 2, 4)]
    again = (Action("lose", "steady"), Action("publish", "steady"))
    assert losses(*again, *again) == [("first", 1, 2)]


def test_a_publisher_that_was_not_alive_is_a_new_one_where_that_is_declared() -> None:
    actions = (
        Action("publish", "manual"),
        Action("drive", count=5),
        Action("lose", "manual"),
        Action("publish", "manual"),
    )
    assert losses(*actions) == [("first", 1, 1)]
    assert losses(*actions, forgets=True) == [("first", 0, 1)]


def test_whether_others_hear_of_an_assertion_that_is_lost_is_left_open() -> None:
    def levels(verb: str) -> list[int]:
        actions = (Action("drive", count=3), Action(verb, "manual"), Action("drive", count=3), Action("drive", count=2))
        asked = scenario(Timeline(actions, (EventKind.LIVELINESS_CHANGED,)))["expect"]
        return [one["is"] for one in asked if one["of"] == "first"]

    assert levels("publish") == [2, 2, 1, 1]  # asserted at 200 ms, lost at 413
    assert levels("lose") == [2, 1, 1]


def test_what_gets_lost_is_not_repaired() -> None:
    assert "reliability" not in scenario(Timeline((Action("publish", "steady"),)))["entities"]["first"]["qos"]
    lossy = scenario(Timeline((Action("lose", "steady"),)))["entities"]
    assert {one["qos"]["reliability"] for one in lossy.values()} == {"best_effort"}


def test_slack_leaves_open_what_falls_due_close_to_a_look() -> None:
    silent = Timeline((Action("publish", "steady"), Action("drive", count=3)), (EventKind.OFFERED_DEADLINE_MISSED,))
    for slack_ms, bounds in ((5, {"is": 0}), (10, {"at_least": 0, "at_most": 1})):  # due at 127 ms, looked at 120 ms
        (first, *_) = scenario(silent, slack_ns=slack_ms * 1_000_000)["expect"]
        assert {key: first[key] for key in bounds} == bounds


def test_two_backends_are_told_apart_by_requirement() -> None:
    (difference,) = compare(stand(), stand(Forgetful), 40, 37).differences
    assert (difference.requirement, difference.by, difference.known) == ("MSL-001", "reference", "")
    assert len(difference.timeline.actions) <= 6
    assert compare(stand(), stand(), 10, 5).differences == []


def test_without_hypothesis_the_remedy_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "hypothesis", None)
    with pytest.raises(HypothesisMissing) as missing:
        explore(stand(), 1, 1)
    assert str(missing.value) == 'explore needs hypothesis; install it: pip install "nros-conformance[explore]"'


def test_what_happens_at_once_is_little_enough_for_a_play_to_keep_up() -> None:
    eight = (Action("publish", "steady"),) * 8
    timeline = Timeline((*eight, Action("idle"), *eight[:4])).sensible()
    assert timeline.actions == (*eight[:4], Action("drive"), *eight[:4], Action("idle"), *eight[:4])
    assert [one.verdict.verdict for one in stand().play([timeline])] == ["pass"]
