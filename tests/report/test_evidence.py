from __future__ import annotations

from collections import Counter
from typing import Any

import msgspec
import pytest

from nros_conformance.report.applicability import not_applicable
from nros_conformance.report.evidence import NO_SCENARIO, Evidence, evidence, failures
from nros_conformance.report.results import ReportError, ScenarioResult
from nros_conformance.rmw.declaration import Declaration
from tests.report.build import (
    LVC,
    LVL,
    MSL,
    ODM,
    RDM,
    REFUSED,
    REQUIREMENTS,
    declare,
    finding,
    known,
    report,
    result,
)


def about(
    requirement: str, *results: ScenarioResult, declaration: Declaration | None = None, **fields: Any
) -> Evidence:
    return evidence(report(declaration, results, **fields), REQUIREMENTS)[requirement]


def test_every_requirement_has_evidence_in_the_order_of_the_catalogue() -> None:
    found = evidence(report(), REQUIREMENTS)
    assert list(found) == list(REQUIREMENTS)
    assert Counter(one.standing for one in found.values())["holds"] == 0


@pytest.mark.parametrize(
    ("results", "standing"),
    [
        ([result("a.a", "LVC-001")], "holds"),
        ([result("a.a", "LVC-001"), result("a.b", "LVC-001", outcome="fail")], "violated"),
        ([result("a.a", "LVC-001"), result("a.b", "LVC-001", outcome="unclear")], "holds"),
        ([result("a.a", "LVC-001", outcome="unclear")], "unclear"),
        ([result("a.a", "LVC-001", outcome="none")], "unexercised"),
        ([result("a.a", "LVC-001", verdict="none")], "unexercised"),
        ([result("a.a", "LVC-001", verdict="error")], "unclear"),
        ([result("a.a", "LVC-001", verdict="error", outcome="fail")], "unclear"),
        ([result("a.a", "LVC-001", verdict="inconclusive", findings=[])], "unclear"),
        ([result("a.a", "LVC-001", findings=[])], "unexercised"),
        ([result("a.a", "LVC-001", status="untested", reason="needs a wire")], "unexercised"),
        ([], "unexercised"),
        ([result("a.a", findings=[finding("LVC-001", implied=True)])], "holds"),
        ([result("a.a", findings=[finding("LVC-001", implied=True, outcome="fail")])], "violated"),
    ],
)
def test_a_requirement_stands_as_its_findings_say(results: list[ScenarioResult], standing: str) -> None:
    assert about("LVC-001", *results).standing == standing


def test_the_last_attempt_counts() -> None:
    unsure = result("a.a", "LVC-001", outcome="unclear")
    final = result("a.a", "LVC-001")
    both = msgspec.structs.replace(final, attempts=(*unsure.attempts, *final.attempts))
    assert about("LVC-001", both).standing == "holds"


def test_a_pass_is_none_when_the_stimulus_did_not_happen() -> None:
    condition = finding(outcome="unclear", name="gap data below 0.9T")
    shaky = result("a.a", findings=[finding("LVC-001"), condition])
    assert about("LVC-001", shaky).standing == "unclear"
    certain = result("a.a", findings=[finding("LVC-001"), finding("LVC-002", outcome="unclear")])
    assert about("LVC-001", certain).standing == "holds"
    assert about("LVC-002", certain).standing == "unclear"


def test_a_crash_violates_all_that_the_scenario_proves() -> None:
    crash = result("a.a", "LVC-001", "DSP-003", findings=[], verdict="fail", reason="crash: signal 11")
    for requirement in ("LVC-001", "DSP-003"):
        one = about(requirement, crash)
        assert one.standing == "violated"
        assert [proof.finding for proof in one.proofs] == ["crash: signal 11"]


def test_a_failed_finding_leaves_the_others_of_its_scenario_alone() -> None:
    mixed = result("a.a", findings=[finding("LVC-001"), finding("LVC-002", outcome="fail")])
    assert about("LVC-001", mixed).standing == "holds"
    assert about("LVC-002", mixed).standing == "violated"


@pytest.mark.parametrize(
    ("entry", "standing"),
    [
        (known("LVC-009", "lvc.frozen"), "known"),
        (known("LVC-009", "lvc.frozen[how=stop]"), "known"),
        (known("LVC-009", "lvc.frozen[how=kill]"), "violated"),
        (known("LVC-004", "lvc.frozen"), "violated"),
        (known("LVC-009", "lvc.frozen", versions="==11.0.1"), "known"),
        (known("LVC-009", "lvc.frozen", versions=">=10,<11"), "violated"),
        (known("LVC-009", "lvc.frozen", versions=">=10, <12, !=11.0.2"), "known"),
        (known("LVC-009", "lvc.frozen", versions="==11.0.1.0"), "known"),
    ],
)
def test_a_violation_is_known_where_an_entry_covers_it(entry: Any, standing: str) -> None:
    declaration = declare(known=[entry], subject={"kind": "library", "says": "x", "package": "demo"})
    frozen = result("lvc.frozen[how=stop]", "LVC-009", outcome="fail")
    one = about("LVC-009", frozen, declaration=declaration, versions={"demo": "11.0.1"})
    assert one.standing == standing
    assert one.known == (("D1",) if standing == "known" else ())


def test_one_uncovered_failure_is_enough_for_a_violation() -> None:
    declaration = declare(known=[known("LVC-009", "lvc.a")])
    failing = [result(key, "LVC-009", outcome="fail") for key in ("lvc.a", "lvc.b")]
    one = about("LVC-009", *failing, declaration=declaration)
    assert (one.standing, one.known, one.scenarios("fail")) == ("violated", ("D1",), ("lvc.a", "lvc.b"))


def test_the_keys_of_all_entries_that_show_are_named_in_order() -> None:
    declaration = declare(known=[known("LVC-009", f"lvc.{key}", f"D{key}") for key in "87654321"])
    failing = [result(f"lvc.{key}", "LVC-009", outcome="fail") for key in "87654321"]
    one = about("LVC-009", *failing, declaration=declaration)
    assert one.known == ("D1", "D2", "D3", "D4", "D5", "D6", "D7", "D8")


def test_a_version_range_that_cannot_be_read_is_refused() -> None:
    declaration = declare(known=[known("LVC-009", "lvc.a", versions="~11")])
    with pytest.raises(ReportError) as error:
        about("LVC-009", declaration=declaration)
    assert str(error.value) == (
        'demo: [[known]] D1: cannot read versions = \'~11\'; write for example "==11.0.1" or ">=11,<12"'
    )


@pytest.mark.parametrize(
    ("results", "reason"),
    [
        ([], NO_SCENARIO),
        ([result("a.a", "LVC-001", status="untested", reason="needs a wire")], "needs a wire"),
        (
            [
                result("a.a", "LVC-001", status="untested", reason="needs a wire"),
                result("a.b", "LVC-001", status="not-applicable", reason="no agent"),
                result("a.c", "LVC-001", status="untested", reason="needs a fork"),
            ],
            "needs a fork; needs a wire",
        ),
        ([result("a.b", "LVC-001", status="not-applicable", reason="no agent")], "no agent"),
        ([result("a.a", "LVC-001", verdict="none")], "`a.a` gives no evidence"),
        ([result("a.a", "LVC-001", status="untested")], "its scenarios were not played"),
        (
            [result(f"a.{name}", "LVC-001", status="untested", reason=name) for name in "hgfedcba"],
            "a; b; c; d; e; f; g; h",
        ),
    ],
)
def test_what_was_not_exercised_says_why(results: list[ScenarioResult], reason: str) -> None:
    assert about("LVC-001", *results).reason == reason


ALL_REFUSED = dict.fromkeys((LVC, RDM, MSL, LVL, ODM), REFUSED)


@pytest.mark.parametrize(
    ("fields", "gone"),
    [
        ({}, "CON-002 CON-003 CON-004 CON-005 CON-006 CON-007 CON-008 CON-009 CON-010"),
        ({"connection": {"ping": "round_trip", "peer": "agent"}}, "CON-008 CON-009 CON-010"),
        (
            {"connection": {"ping": "round_trip", "peer": "agent", "hard_liveliness": {"claim": "yes"}}},
            "",
        ),
        ({"behaviour": {"callback_cap": False, "two_sessions": "second_fails"}}, "DSP-008 DSP-011"),
        ({"behaviour": {"derived_support": True}}, "REG-001"),
        ({"events": {LVL: {"claim": "yes", "how": "x", "manual": False}}}, "LVL-003 LVL-004 LVL-006"),
        ({"events": {MSL: {"claim": "yes", "how": "x", "sources": ["wire"]}}}, "MSL-007"),
        ({"events": {MSL: {"claim": "yes", "how": "x", "limit": {"sources": ["wire"]}}}}, "MSL-007"),
        (
            {"events": {LVC: REFUSED}},
            "REG-009 CNT-004 CNT-005 " + " ".join(f"LVC-{number:03}" for number in range(1, 12)),
        ),
        (
            {"events": dict.fromkeys((RDM, ODM, LVL), REFUSED)},
            "REG-008 DSP-007 RDM-001 RDM-002 RDM-003 RDM-004 RDM-005 RDM-006 RDM-007 RDM-008 RDM-009 ODM-001 ODM-002 "
            "ODM-003 ODM-004 LVL-001 LVL-002 LVL-003 LVL-004 LVL-005 LVL-006",
        ),
    ],
)
def test_a_declaration_excuses_from_what_it_may_and_no_more(fields: dict[str, Any], gone: str) -> None:
    connection = {f"CON-{number:03}" for number in range(2, 11)}
    declaration = declare(**fields)
    excused = {requirement for requirement in REQUIREMENTS if not_applicable(requirement, declaration)}
    assert excused == set(gone.split()) | (set() if "connection" in fields else connection)


@pytest.mark.parametrize(
    ("requirement", "fields", "reason"),
    [
        ("LVC-001", {"events": {LVC: REFUSED}}, "LivelinessChanged is not claimed"),
        ("CNT-001", {"events": dict.fromkeys((RDM, MSL, LVL, ODM), REFUSED)}, "none of its events is claimed"),
        ("REG-001", {"behaviour": {"derived_support": True}}, "supports_event is derived from return codes"),
        ("DSP-008", {"behaviour": {"callback_cap": False}}, "callback_cap = false"),
        ("DSP-011", {"behaviour": {"two_sessions": "second_fails"}}, 'two_sessions = "second_fails"'),
        ("LVL-003", {"events": {LVL: {"claim": "yes", "how": "x", "manual": False}}}, "manual = false"),
        (
            "MSL-007",
            {"events": {MSL: {"claim": "yes", "how": "x", "sources": ["wire"]}}},
            "overflow is not a declared source",
        ),
        ("CON-002", {}, 'ping = "no"'),
        ("CON-004", {}, 'peer = "none"'),
        ("CON-008", {}, 'hard_liveliness.claim = "no"'),
        ("CON-001", {}, ""),
    ],
)
def test_the_reason_names_the_field(requirement: str, fields: dict[str, Any], reason: str) -> None:
    assert not_applicable(requirement, declare(**fields)) == reason


def test_a_backend_without_events_still_answers_for_the_rest() -> None:
    declaration = declare(events=ALL_REFUSED)
    left = [one for one in REQUIREMENTS if not not_applicable(one, declaration) and REQUIREMENTS[one] == "must"]
    assert " ".join(left) == (
        "REG-001 REG-002 REG-003 REG-004 DSP-005 DSP-008 DSP-010 DSP-011 QOS-001 QOS-002 QOS-003 QOS-004 QOS-005 "
        "CON-001 LIF-001 LIF-002 LIF-004 ROB-001 ROB-002 ROB-003"
    )


def test_what_does_not_apply_leaves_the_count_unless_it_is_violated() -> None:
    declaration = declare(behaviour={"two_sessions": "second_fails"})
    assert about("DSP-011", result("a.a", "DSP-011"), declaration=declaration).standing == "not-applicable"
    assert about("DSP-011", declaration=declaration).reason == 'two_sessions = "second_fails"'
    assert about("DSP-011", result("a.a", "DSP-011", outcome="fail"), declaration=declaration).standing == "violated"


def test_only_undeclared_violations_of_musts_are_failures() -> None:
    declaration = declare(known=[known("LVC-009", "lvc.a")])
    failing = [result("lvc.a", one, outcome="fail") for one in ("LVC-009", "LVC-003", "LVC-002")]
    found = evidence(report(declaration, failing), REQUIREMENTS)
    assert [one.requirement for one in failures(found.values())] == ["LVC-002"]
