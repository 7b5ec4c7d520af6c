from __future__ import annotations

from typing import Any

import pytest

from nros_conformance.judge.expectations import JUDGES
from nros_conformance.judge.judge import judge
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.suite.schema import EXPECTATIONS, GIVENS
from nros_conformance.trace.records import Starved
from tests.judge.build import (
    LISTENER,
    QUANTITIES,
    RDM,
    START,
    counted,
    finding,
    ms,
    publish,
    register,
    spins,
    state,
    step,
    trace,
    verdict,
)

SILENT = {"never": RDM, "of": "listener", "proves": "RDM-002"}
ANSWERS = {"returns": "data", "is": ["OK"], "proves": "RDM-005"}
RECORDS = [publish("data", 10), spins(0, 300), step("rest", 0, 300)]
SPURIOUS = counted(100, 1)
UNSURE = counted(301, 1, wait=5)


def test_all_holds() -> None:
    result = verdict([SILENT, ANSWERS], RECORDS)
    assert (result.verdict, result.reason, result.warnings) == ("pass", "", ())
    assert [one.outcome for one in result.findings if not one.implied] == ["pass", "pass"]


@pytest.mark.parametrize(
    ("code", "waited", "records", "name"),
    [
        (-2, 60, RECORDS, "inconclusive"),
        (-18, 60, RECORDS, "inconclusive"),
        (-2, 40, RECORDS, "fail"),
        (-1, 60, RECORDS, "fail"),
        (-2, 60, [*RECORDS, SPURIOUS], "fail"),
    ],
)
def test_a_creation_that_nobody_answered_because_threads_had_no_core_is_no_failure_of_the_backend(
    code: int, waited: int, records: list[Any], name: str
) -> None:
    said = "creating late answered TIMEOUT: no answer"
    refused = state("refused", 300, "late", code=code, end=400)
    starved = Starved(begin=ms(300), end=ms(400), wait=ms(waited) - ms(0))
    result = verdict([SILENT, ANSWERS], records, refused, starved, outcome="raised", detail=said)
    assert result.verdict == name
    wait = f"; threads of the backend had to wait {waited} ms for a core meanwhile"
    assert result.reason == f"the backend failed: {said}" + wait * (name == "inconclusive")


def test_findings_stand_in_order_conditions_first() -> None:
    result = verdict([SILENT, ANSWERS], RECORDS, given=[{"returns": "data", "is": ["OK"]}])
    assert [one.name for one in result.findings[:3]] == [
        "given returns data",
        "never RequestedDeadlineMissed of listener",
        "returns data",
    ]
    assert all(one.implied for one in result.findings[3:])


@pytest.mark.parametrize(
    ("outcome", "records", "name", "reason"),
    [
        ("crash", [], "fail", "the backend crashed: signal 11"),
        ("hang", [], "fail", "the backend hung: signal 11"),
        ("raised", [], "fail", "the backend failed: signal 11"),
        ("error", [], "error", "the harness failed: signal 11"),
        (None, [], "inconclusive", "the trace was cut short"),
        (None, [SPURIOUS], "fail", "RDM-002: RequestedDeadlineMissed on listener: total 1 (+1) at 100.0 ms"),
        ("crash", [SPURIOUS], "fail", "the backend crashed: signal 11"),
    ],
)
def test_how_the_play_ended(outcome: str | None, records: list[Any], name: str, reason: str) -> None:
    result = verdict(SILENT, RECORDS, records, outcome=outcome, detail="signal 11")
    assert (result.verdict, result.reason) == (name, reason)
    assert not any(one.outcome == "pass" for one in result.findings)


@pytest.mark.parametrize(
    ("detail", "wait", "lease", "name"),
    [
        ("creating talker answered CONNECTION_FAILED: no router", 300, 500, "inconclusive"),
        ("creating talker answered CONNECTION_FAILED: no router", 200, 500, "fail"),
        ("creating talker answered CONNECTION_FAILED: no router", 300, 0, "fail"),
        ("creating talker answered ERROR: no router", 300, 500, "fail"),
    ],
)
def test_a_connection_lost_while_threads_had_no_core_is_unclear(detail: str, wait: int, lease: int, name: str) -> None:
    starved = Starved(begin=ms(100), end=ms(500), wait=ms(wait) - ms(0))
    code = ReturnCode[detail.split()[3].rstrip(":")]
    refused = state("refused", 520, "talker", code=code, end=530)
    quantities = {**QUANTITIES, "connection_lease": ms(lease) - ms(0)}
    found = verdict(SILENT, RECORDS, starved, refused, outcome="raised", detail=detail, quantities=quantities)
    why = "; threads of the backend had to wait 300 ms for a core meanwhile" if name == "inconclusive" else ""
    assert (found.verdict, found.reason) == (name, f"the backend failed: {detail}{why}")


def test_a_play_that_ended_without_a_word() -> None:
    assert verdict(SILENT, RECORDS, outcome="crash").reason == "the backend crashed"


def test_what_was_seen_of_an_unfinished_play_proves_nothing() -> None:
    found = finding(ANSWERS, RECORDS, outcome=None)
    assert (found.outcome, found.got) == ("unclear", "OK (0), but the play did not come to its end")


SHOULD = {"RDM-002": "should"}
MAY = {"RDM-002": "may"}


@pytest.mark.parametrize(
    ("levels", "event", "name", "reason", "warnings"),
    [
        ({}, SPURIOUS, "fail", "RDM-002: RequestedDeadlineMissed on listener: total 1 (+1) at 100.0 ms", ()),
        (
            SHOULD,
            SPURIOUS,
            "warn",
            "RDM-002: RequestedDeadlineMissed on listener: total 1 (+1) at 100.0 ms",
            ("RDM-002: RequestedDeadlineMissed on listener: total 1 (+1) at 100.0 ms",),
        ),
        (MAY, SPURIOUS, "pass", "", ()),
        (
            {},
            UNSURE,
            "inconclusive",
            "RDM-002: RequestedDeadlineMissed on listener: total 1 (+1) at 301.0 ms, perhaps outside",
            (),
        ),
        (SHOULD, UNSURE, "pass", "", ()),
    ],
    ids=["must violated", "should violated", "may not used", "must unclear", "should unclear"],
)
def test_levels(levels: dict[str, str], event: Any, name: str, reason: str, warnings: tuple[str, ...]) -> None:
    result = verdict([SILENT, ANSWERS], RECORDS, event, levels=levels)
    assert (result.verdict, result.reason, result.warnings) == (name, reason, warnings)


def test_the_strictest_of_several_requirements_counts() -> None:
    both = SILENT | {"proves": ["RDM-002", "RDM-005"]}
    assert verdict(both, RECORDS, SPURIOUS, levels=SHOULD).verdict == "fail"
    assert verdict(both, RECORDS, SPURIOUS, levels={**SHOULD, "RDM-005": "may"}).verdict == "warn"


def test_a_may_that_is_not_used_is_no_finding() -> None:
    found = finding(SILENT, RECORDS, SPURIOUS, levels=MAY)
    assert (found.outcome, found.got) == (
        "none",
        "RequestedDeadlineMissed on listener: total 1 (+1) at 100.0 ms; permitted",
    )


def test_shoulds_alone_that_are_unclear_are_inconclusive() -> None:
    result = verdict(SILENT, RECORDS, UNSURE, levels=SHOULD)
    assert result.verdict == "inconclusive"


def test_no_evidence_at_all() -> None:
    result = verdict(SILENT, RECORDS, claims={RDM: "no"})
    assert (result.verdict, result.reason) == ("none", "RequestedDeadlineMissed is not claimed")
    assert verdict([], RECORDS).reason == "nothing is expected"


def test_an_unclear_invariant() -> None:
    during = [counted(51, 1, registration="reg"), register("reg", 51)]
    result = verdict(ANSWERS, RECORDS, during)
    assert (result.verdict, result.reason) == (
        "inconclusive",
        "REG-006: RequestedDeadlineMissed on listener: total 1 (+1) at 51.0 ms, perhaps before it was registered",
    )


# --- any of ---------------------------------------------------------------------------------------

EITHER = {"any_of": [[{"returns": "data", "is": ["ANY_ERROR"]}], [ANSWERS, SILENT]], "proves": "QOS-006"}


@pytest.mark.parametrize(
    ("records", "outcome", "got"),
    [
        ([], "pass", "OK (0)"),
        (
            [SPURIOUS],
            "fail",
            "OK (0); RequestedDeadlineMissed on listener: total 1 (+1) at 100.0 ms",
        ),
        ([UNSURE], "unclear", "RequestedDeadlineMissed on listener: total 1 (+1) at 301.0 ms, perhaps outside"),
    ],
)
def test_any_of(records: list[Any], outcome: str, got: str) -> None:
    found = finding(EITHER, RECORDS, records)
    assert (found.name, found.proves, found.outcome, found.got) == ("any of 2 groups", ("QOS-006",), outcome, got)
    assert found.wanted == "data answers ANY_ERROR, or data answers OK and no RequestedDeadlineMissed on listener"


def test_any_of_without_evidence() -> None:
    either = {"any_of": [[SILENT], [{"returns": "nothing", "is": ["OK"]}]]}
    found = finding(either, RECORDS, claims={RDM: "no"})
    assert (found.outcome, found.got) == (
        "none",
        "RequestedDeadlineMissed is not claimed; there is no nothing in the trace",
    )


# --- what the harness got wrong -------------------------------------------------------------------


def test_a_header_without_a_quantity() -> None:
    few = {"T": 100_000_000, "tolerance": 0, "early": 0}
    result = verdict(SILENT | {"until": "rest + discovery_bound"}, RECORDS, quantities=few)
    assert (result.verdict, result.reason) == ("error", "the header has no quantity 'discovery_bound'")
    result = verdict(SILENT, RECORDS, quantities={"T": 1})
    assert (result.verdict, result.reason) == ("error", "the header has no quantity 'tolerance'")


def test_a_scenario_that_is_none() -> None:
    broken = {**trace(SILENT).header.scenario, "expect": [{"newer": RDM, "of": "listener", "proves": "RDM-002"}]}
    one = trace(SILENT, RECORDS)
    header = type(one.header)(
        scenario=broken, suite="t", backend="b", clock="real", quantities=one.header.quantities, start=START
    )
    result = judge(type(one)(header, one.records))
    assert (result.verdict, result.reason) == (
        "error",
        "the embedded scenario: unknown head 'newer' of an expectation; did you mean 'never'?",
    )


def test_the_judge_is_a_function() -> None:
    one = trace(
        [SILENT, ANSWERS], RECORDS, SPURIOUS, entities={"listener": LISTENER, "talker": {"publisher": "sensor"}}
    )
    assert judge(one) == judge(one)


def test_there_is_a_judge_for_all_that_a_suite_may_say() -> None:
    for part in (*GIVENS.values(), *EXPECTATIONS.values()):
        assert part in JUDGES, part.__name__
