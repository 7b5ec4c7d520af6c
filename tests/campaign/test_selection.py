from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from nros_conformance.campaign.plans import Row, make_plan
from nros_conformance.campaign.selection import Selection, SelectionError, decide, proven
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.discovery import find_backend
from nros_conformance.suite.loader import Loaded, Suites, load_suites


@pytest.fixture(scope="module")
def suites() -> Suites:
    return load_suites()


def one(suites: Suites, key: str) -> Loaded:
    (found,) = (each for each in suites.scenarios if each.key == key)
    return found


def test_a_profile_includes_those_before_it(suites: Suites) -> None:
    smoke, standard, publish = (
        {each.key for each in Selection(profile).choose(suites)} for profile in ("smoke", "standard", "publish")
    )  # fmt: skip
    assert smoke < standard <= publish == {each.key for each in suites.scenarios}


def test_a_scenario_is_chosen_by_id_key_or_pattern_whatever_its_profile(suites: Suites) -> None:
    def chosen(pattern: str) -> set[str]:
        return {each.key for each in Selection("smoke", scenarios=(pattern,)).choose(suites)}

    assert chosen("rdm.no-period") == {"rdm.no-period[period=0]", "rdm.no-period[period=infinite]"}
    assert chosen("rdm.no-period[period=0]") == {"rdm.no-period[period=0]"}
    assert chosen("rdm.no-p*") == chosen("rdm.no-period")


def test_a_requirement_chooses_the_scenarios_that_prove_it(suites: Suites) -> None:
    chosen = Selection("publish", requirements=("RDM-007",)).choose(suites)
    assert chosen
    assert all("RDM-007" in proven(each) for each in chosen)
    assert len(chosen) == sum("RDM-007" in proven(each) for each in suites.scenarios)


@pytest.mark.parametrize(("selection", "message"), [
    (Selection(suites=("registraton",)), "no suite 'registraton'; did you mean 'registration'?"),
    (Selection(requirements=("RDM-99",)), "no requirement 'RDM-99'; did you mean 'RDM-009'?"),
    (Selection(scenarios=("zzz",)), "no scenario 'zzz'; see: nros-conformance list scenarios"),
])  # fmt: skip
def test_a_name_that_nothing_has_is_an_error(suites: Suites, selection: Selection, message: str) -> None:
    with pytest.raises(SelectionError) as caught:
        selection.choose(suites)
    assert str(caught.value) == message


@pytest.mark.parametrize(("backend", "key", "status", "reason"), [
    ("uorb", "reg.raises-message-lost", "play", ""),
    ("uorb", "reg.absent-message-lost", "not-applicable", "MessageLost is claimed"),
    ("uorb", "rdm.recovery", "not-applicable", "RequestedDeadlineMissed is not claimed"),
    ("uorb", "reg.right-callback", "not-applicable", "LivelinessChanged, RequestedDeadlineMissed are not claimed"),
    ("cyclone", "rdm.not-before-first-sample[deadline=in-qos]", "play", ""),
    ("uorb", "dsp.stalled-transport", "untested", "the fault heal cannot be injected here"),
])  # fmt: skip
def test_the_declaration_alone_decides_what_is_played(
    suites: Suites, backend: str, key: str, status: str, reason: str
) -> None:
    declaration = find_backend(backend).declaration
    assert declaration is not None
    decision = decide(one(suites, key), declaration)
    assert (decision.status, decision.reason) == (status, reason)


def test_a_declared_field_with_another_value_makes_a_scenario_not_applicable(suites: Suites) -> None:
    declaration = find_backend("reference").declaration
    assert declaration is not None
    events = dict(declaration.events)
    events["RequestedDeadlineMissed"] = msgspec.structs.replace(events["RequestedDeadlineMissed"], armed_at="create")
    decision = decide(
        one(suites, "rdm.not-before-first-sample[deadline=in-qos]"), msgspec.structs.replace(declaration, events=events)
    )
    assert (decision.status, decision.reason) == (
        "not-applicable", "needs RequestedDeadlineMissed.armed_at = first_sample; declared is create",
    )  # fmt: skip


def test_a_second_session_that_fails_leaves_scenarios_with_two_untested(suites: Suites) -> None:
    declaration = find_backend("reference").declaration
    assert declaration is not None
    single = msgspec.structs.replace(
        declaration, behaviour=msgspec.structs.replace(declaration.behaviour, two_sessions="second_fails")
    )
    decision = decide(one(suites, "reg.raises-message-lost"), single)
    assert (decision.status, decision.reason) == (
        "untested", "needs 2 sessions in one process, where a second one fails",
    )  # fmt: skip
    assert decide(one(suites, "lvc.same-session"), single).status == "play"


def test_plans_carry_scale_tolerances_and_everything_that_judging_needs(suites: Suites) -> None:
    declaration = find_backend("cyclone").declaration
    assert declaration is not None
    loaded = one(suites, "rdm.recovery")
    row = Row(declaration, declaration.adapter)
    first, second = (make_plan(loaded, row, suites, Path("t"), attempt=n, stretch=n) for n in (1, 2))
    assert (first.header.quantities["T"], second.header.quantities["T"]) == (130 * MS, 260 * MS)
    assert (first.header.quantities["tolerance"], first.header.quantities["early"]) == (39 * MS, 6_500_000)
    assert second.trace == str(Path("t") / "rdm.recovery.2.jsonl")
    assert first.header.levels["RDM-004"] == "must"
    virtual = make_plan(loaded, Row(declaration, declaration.adapter, clock="virtual"), suites, Path("t"))
    assert (virtual.header.quantities["tolerance"], virtual.header.quantities["early"]) == (0, 0)
