from __future__ import annotations

from typing import Any

import msgspec
import pytest

from nros_conformance.report.differences import differences
from nros_conformance.report.results import Observation, ScenarioResult
from nros_conformance.rmw.declaration import Known
from tests.report.build import (
    CLAIMED,
    LVC,
    REFUSED,
    REQUIREMENTS,
    answers,
    canonical,
    declare,
    everything,
    finding,
    known,
    refusal,
    registered,
    report,
    result,
)


def texts(
    claim: dict[str, Any], results: list[ScenarioResult], observations: list[Observation], **fields: Any
) -> list[str]:
    declaration = declare(events={LVC: claim}, **fields)
    return [one.text for one in differences(report(declaration, results, observations=observations), REQUIREMENTS)]


def test_a_backend_that_does_what_it_says_differs_in_nothing() -> None:
    declaration = declare(events={LVC: REFUSED})
    whole = report(declaration, everything(declaration), observations=answers(declaration))
    assert differences(whole, REQUIREMENTS) == ()


YES, NO = '[events.LivelinessChanged] claim = "yes"', '[events.LivelinessChanged] claim = "no"'
PROMISED = Observation(call="supports", side="subscription", kind=0, case="right side", code=1)
DENIED = Observation(call="supports", side="subscription", kind=0, case="right side", code=0)
SCENARIO = "reg.absent-liveliness-changed"


@pytest.mark.parametrize(
    ("claim", "results", "observations", "text"),
    [
        (CLAIMED, [canonical(LVC, "fail")], [registered(LVC, -5)], f"{YES}, but registering answered UNSUPPORTED (-5)"),
        (CLAIMED, [canonical(LVC)], [registered(LVC), DENIED], f"{YES}, but supports_event answered false"),
        (CLAIMED, [canonical(LVC, "fail")], [registered(LVC)],
         f"{YES}, but the canonical stimulus fails: reg.raises-liveliness-changed"),
        (REFUSED, [refusal(LVC, "fail", fired={0: 3})], [registered(LVC)],
         f"{NO}, but registering answered OK and it fires: {SCENARIO}; claim it"),
        (REFUSED, [refusal(LVC, "fail")], [registered(LVC)],
         f"{NO}, but registering answered OK, and nothing fires: {SCENARIO}"),
        (REFUSED, [], [registered(LVC)], f"{NO}, but registering answered OK"),
        (REFUSED, [refusal(LVC, "fail")], [registered(LVC, -5), PROMISED],
         f"{NO}, but supports_event answered true, and nothing fires: {SCENARIO}"),
        (REFUSED, [refusal(LVC), result("reg.unknown-kind[kind=256]", fired={0: 1})], [registered(LVC, -5)],
         f"{NO} and registering was refused, but it fires: reg.unknown-kind[kind=256]"),
        (REFUSED, [refusal(LVC, "fail")], [registered(LVC, -1)], f"{NO}, but the proof of absence fails: {SCENARIO}"),
    ],
)  # fmt: skip
def test_claim_and_behaviour(
    claim: dict[str, Any], results: list[ScenarioResult], observations: list[Observation], text: str
) -> None:
    assert texts(claim, results, observations) == [text]


def test_a_refused_period_is_no_refused_event() -> None:
    assert texts(CLAIMED, [canonical(LVC)], [registered(LVC), registered(LVC, -6)]) == []


def test_only_the_stimuli_that_fail_are_named_and_all_that_fired() -> None:
    def stimulus(number: int, **fields: Any) -> ScenarioResult:
        return result(f"reg.b[n={number}]", "REG-005", canonical=LVC.label, **fields)

    mixed = [stimulus(1), stimulus(2, outcome="fail"), stimulus(3, status="untested", reason="needs a wire")]
    assert texts(CLAIMED, mixed, [registered(LVC)]) == [f"{YES}, but the canonical stimulus fails: reg.b[n=2]"]
    firing = [result(f"a.{name}", fired={0: 1}) for name in "hgfedcba"]
    assert texts(REFUSED, [refusal(LVC), *firing], [registered(LVC, -5)]) == [
        f"{NO} and registering was refused, but it fires: a.a, a.b, a.c, a.d, a.e, a.f, a.g, a.h"
    ]


def test_no_conclusive_stimulus_no_difference() -> None:
    assert texts(CLAIMED, [canonical(LVC, "unclear")], [registered(LVC)]) == []
    assert texts(REFUSED, [refusal(LVC, "unclear")], [registered(LVC, -5)]) == []


def test_the_connection_is_held_to_its_words() -> None:
    lie = result("con.silent-peer", "CON-001", outcome="fail")
    assert texts(CLAIMED, [lie], []) == ['[connection] ping = "no", but CON-001 is violated: con.silent-peer']
    holding = [result(f"con.{number}", f"CON-00{number}") for number in (4, 5, 6)]
    assert texts(CLAIMED, holding, [], connection={"peer": "agent", "ping": "round_trip"}) == [
        '[connection] reconnect = "no", but every rule of reconnection holds; claim it'
    ]
    agent = {"peer": "agent", "ping": "round_trip"}
    assert texts(CLAIMED, holding, [], connection={**agent, "reconnect": "yes"}) == []
    assert texts(CLAIMED, holding, [], connection={"peer": "none"}) == []
    assert texts(CLAIMED, holding[1:], [], connection=agent) == []
    assert texts(CLAIMED, [], [], connection=agent) == []


def known_texts(entry: Known, *results: ScenarioResult, partial: bool = False, **fields: Any) -> list[str]:
    declaration = declare(known=[entry], subject={"kind": "library", "says": "x", "package": "demo"})
    whole = report(declaration, results, partial=partial, versions={"demo": "11.0.1"}, **fields)
    return [one.text for one in differences(whole, REQUIREMENTS)]


ENTRY = known("LVC-009", "lvc.frozen")


@pytest.mark.parametrize(
    ("results", "expected"),
    [
        ([result("lvc.frozen", "LVC-009", outcome="fail")], []),
        ([result("lvc.frozen", "LVC-009")], ["[[known]] D1 (LVC-009, lvc.frozen) holds; remove the entry"]),
        ([result("lvc.frozen", "LVC-009", outcome="unclear")], []),
        ([result("lvc.frozen[how=stop]", "LVC-009"), result("lvc.frozen[how=kill]", "LVC-009", outcome="fail")], []),
        ([result("lvc.frozen[how=stop]", "LVC-009"), result("lvc.frozen[how=kill]", "LVC-009", outcome="unclear")], []),
        ([result("lvc.frozen", "LVC-009", status="untested", reason="no child processes")], []),
        ([], ["[[known]] D1 (LVC-009, lvc.frozen) matches no scenario"]),
        ([result("lvc.thawed", "LVC-009")], ["[[known]] D1 (LVC-009, lvc.frozen) matches no scenario"]),
        (
            [result("lvc.frozen", "LVC-009", status="not-applicable", reason="virtual clock")],
            ["[[known]] D1 (LVC-009, lvc.frozen) names a scenario that does not apply to demo; remove the entry"],
        ),
        (
            [
                result("lvc.frozen[how=stop]", "LVC-009", status="not-applicable", reason="virtual clock"),
                result("lvc.frozen[how=kill]", "LVC-009", status="untested", reason="no child processes"),
            ],
            [],
        ),
        (
            [result("lvc.frozen[how=stop]", "LVC-004"), result("lvc.frozen[how=kill]", "LVC-009", outcome="none")],
            [],
        ),
        (
            [result("lvc.frozen", "LVC-004", outcome="fail")],
            ["[[known]] D1 (LVC-009, lvc.frozen): the scenario proves nothing about LVC-009"],
        ),
    ],
)
def test_a_known_entry_has_to_fail(results: list[ScenarioResult], expected: list[str]) -> None:
    assert known_texts(ENTRY, *results) == expected


def test_a_known_failure_that_passes_in_a_repeat_at_a_larger_scale_is_no_difference() -> None:
    first = result("lvc.frozen", "LVC-009")
    repeated = msgspec.structs.replace(first, attempts=(*first.attempts, *first.attempts))
    assert known_texts(ENTRY, first) == ["[[known]] D1 (LVC-009, lvc.frozen) holds; remove the entry"]
    assert known_texts(ENTRY, repeated) == []


def test_a_known_race_may_pass() -> None:
    race = known("LVC-009", "lvc.frozen", strict=False)
    assert known_texts(race, result("lvc.frozen", "LVC-009")) == []
    assert known_texts(race) == ["[[known]] D1 (LVC-009, lvc.frozen) matches no scenario"]


def test_a_partial_run_leaves_entries_of_other_scenarios_alone() -> None:
    assert known_texts(ENTRY, partial=True) == []
    assert known_texts(ENTRY, result("lvc.frozen", "LVC-009"), partial=True) == [
        "[[known]] D1 (LVC-009, lvc.frozen) holds; remove the entry"
    ]


def test_an_entry_for_other_versions_is_not_in_force() -> None:
    assert known_texts(known("LVC-009", "lvc.frozen", versions="<11"), result("lvc.frozen", "LVC-009")) == []


def test_an_implied_invariant_can_be_known() -> None:
    entry = known("CNT-004", "lvc.frozen")
    failing = finding("CNT-004", implied=True, outcome="fail")
    assert known_texts(entry, result("lvc.frozen", findings=[failing])) == []


def test_nothing_is_said_of_a_backend_that_did_not_run() -> None:
    assert known_texts(ENTRY, available=False, unavailable_reason="No module named 'demo'") == []
