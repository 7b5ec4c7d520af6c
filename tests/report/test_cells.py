from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import pytest

from nros_conformance.report.cells import WORDS, Cell, cells, fires
from nros_conformance.report.columns import columns
from nros_conformance.report.evidence import evidence
from nros_conformance.report.notes import assign
from nros_conformance.report.results import Observation, ScenarioResult
from nros_conformance.rmw.declaration import Declaration
from tests.report.build import (
    CLAIMED,
    LIMITED,
    LVC,
    MSL,
    REFUSED,
    REQUIREMENTS,
    canonical,
    declare,
    finding,
    known,
    refusal,
    registered,
    report,
    result,
)

LVC_MUSTS = [one for one, level in REQUIREMENTS.items() if one.startswith("LVC") and level == "must"]
MSL_MUSTS = [one for one, level in REQUIREMENTS.items() if one.startswith("MSL") and level == "must"]


def cell(
    column: str, declaration: Declaration, results: Iterable[ScenarioResult], observations: Iterable[Observation] = ()
) -> Cell:
    played = report(declaration, results, observations=observations)
    found = evidence(played, REQUIREMENTS)
    keys, _ = assign([(played, found)])
    heads = columns(REQUIREMENTS, [played])
    return next(one for one in cells(played, found, heads, keys[played.row]) if one.column == column)


def rules(musts: Iterable[str], *without: str) -> list[ScenarioResult]:
    return [result(f"all.{must.lower()}", must) for must in musts if must not in without]


class Case(NamedTuple):
    id: str
    text: str
    notes: tuple[str, ...]
    reason: str
    claim: dict[str, Any]
    results: list[ScenarioResult]
    observations: list[Observation] = []


IMPLIED = finding("CNT-004", implied=True, outcome="fail", name="changes sum to counts")
FAILED = result("lvc.frozen", "LVC-009", outcome="fail")
ACCEPTED = [registered(LVC, 0)]
DENIED = [registered(LVC, -5)]
CRASH = canonical(LVC, findings=[], verdict="fail", reason="crash: signal 11")

EVENT_CASES = {
    "every rule holds": Case(
        "verified", "yes", (), "every rule holds",
        CLAIMED, [canonical(LVC), *rules(LVC_MUSTS)],
    ),
    "a rule was not exercised": Case(
        "verified", "yes°", (), "every rule that was exercised holds; not exercised: LVC-010",
        CLAIMED, [canonical(LVC), *rules(LVC_MUSTS, "LVC-010")],
    ),
    "a declared limit": Case(
        "reduced", "limited", ("D2",), "holds inside the declared limit",
        {**CLAIMED, "claim": "limited", "limit": {"depth": 1}, "because": "small"},
        [canonical(LVC), *rules(LVC_MUSTS)],
    ),
    "a choice that is a limit by itself": Case(
        "reduced", "limited°", ("D2",), "holds inside the declared limit; not exercised: LVC-006",
        {**CLAIMED, "presence_only": True}, [canonical(LVC), *rules(LVC_MUSTS, "LVC-006")],
    ),
    "dispatched from its own calls": Case(
        "reduced", "limited", ("D2",), "holds inside the declared limit",
        {**CLAIMED, "dispatch": "own_call"}, [canonical(LVC), *rules(LVC_MUSTS)],
    ),
    "a known violation": Case(
        "deviates", "partly 8/9", ("D1",), "violated: LVC-009",
        CLAIMED, [canonical(LVC), FAILED, *rules(LVC_MUSTS, "LVC-009")],
    ),
    "an undeclared violation, and a gap": Case(
        "deviates", "partly 7/9°", ("!1",), "violated: LVC-004",
        CLAIMED,
        [canonical(LVC), result("lvc.x", "LVC-004", outcome="fail"), *rules(LVC_MUSTS, "LVC-004", "LVC-010")],
    ),
    "a violation inside a limit": Case(
        "deviates", "partly 8/9", ("D1", "D2"), "violated: LVC-009",
        {**CLAIMED, "presence_only": True}, [canonical(LVC), FAILED, *rules(LVC_MUSTS, "LVC-009")],
    ),
    "a violation although the canonical stimulus was not played": Case(
        "deviates", "partly 8/9", ("D1",), "violated: LVC-009",
        CLAIMED, [FAILED, *rules(LVC_MUSTS, "LVC-009")],
    ),
    "a violated should is no violation of the column": Case(
        "verified", "yes", (), "every rule holds",
        CLAIMED, [canonical(LVC), *rules(LVC_MUSTS), result("lvc.s", "LVC-003", outcome="fail", verdict="warn")],
    ),
    "the canonical stimulus fails": Case(
        "broken", "broken", ("!1",), "claimed, but the canonical stimulus fails: reg.raises-liveliness-changed",
        CLAIMED, [canonical(LVC, "fail"), *rules(LVC_MUSTS)],
    ),
    "the canonical stimulus crashes the backend": Case(
        "broken", "broken", ("!1",), "claimed, but the canonical stimulus fails: reg.raises-liveliness-changed",
        CLAIMED, [CRASH, *rules(LVC_MUSTS)],
    ),
    "it fires as it should, with counters that do not add up": Case(
        "verified", "yes", (), "every rule holds",
        CLAIMED, [canonical(LVC, findings=[finding("REG-005"), IMPLIED]), *rules(LVC_MUSTS)],
    ),
    "the canonical stimulus is inconclusive": Case(
        "inconclusive", "unclear", (), "no verdict: reg.raises-liveliness-changed",
        CLAIMED, [canonical(LVC, "unclear"), *rules(LVC_MUSTS)],
    ),
    "a rule is inconclusive": Case(
        "inconclusive", "unclear", (), "no verdict: LVC-004",
        CLAIMED,
        [canonical(LVC), result("lvc.x", "LVC-004", outcome="unclear"), *rules(LVC_MUSTS, "LVC-004")],
    ),
    "the canonical stimulus was not played": Case(
        "no_evidence", "untested", (), "what decides was not played: needs a wire",
        CLAIMED, [canonical(LVC, status="untested", reason="needs a wire"), *rules(LVC_MUSTS)],
    ),
    "the canonical stimulus gives no evidence": Case(
        "no_evidence", "untested", (), "what decides was not played: nothing was matched",
        CLAIMED, [canonical(LVC, verdict="none", reason="nothing was matched"), *rules(LVC_MUSTS)],
    ),
    "one of several canonical stimuli fails": Case(
        "broken", "broken", ("!1", "!2"), "claimed, but the canonical stimulus fails: reg.b[n=2]",
        CLAIMED,
        [
            result("reg.b[n=1]", "REG-005", canonical=LVC.label),
            result("reg.b[n=2]", "REG-005", canonical=LVC.label, findings=[
                finding("CNT-004", implied=True, outcome="fail"), finding("REG-005", outcome="fail"),
            ]),
            result("reg.b[n=3]", "REG-005", canonical=LVC.label, status="untested", reason="needs a wire"),
            *rules(LVC_MUSTS),
        ],
    ),
    "there is no canonical stimulus": Case(
        "no_evidence", "untested", (), "what decides was not played: there is no scenario for it",
        CLAIMED, rules(LVC_MUSTS),
    ),
    "it fires, and nothing more is known": Case(
        "no_evidence", "untested", (),
        "it fires on its canonical stimulus, but no rule was exercised: no scenario proves it",
        CLAIMED, [canonical(LVC)],
    ),
    "proved absent": Case(
        "refused", "no", ("D2",), "proved absent: reg.absent-liveliness-changed",
        REFUSED, [refusal(LVC)], DENIED,
    ),
    "absent, but nobody looked": Case(
        "no_evidence", "untested", (), "the absence was not proved: there is no scenario for it",
        REFUSED, [], DENIED,
    ),
    "absent, and no verdict": Case(
        "inconclusive", "unclear", (), "no verdict: reg.absent-liveliness-changed",
        REFUSED, [refusal(LVC, "unclear")], DENIED,
    ),
    "not claimed, but it works": Case(
        "unclaimed", "undeclared", ("D2",), 'claim = "no", but it answers OK, and it fires',
        REFUSED, [refusal(LVC, "fail", fired={0: 2})], ACCEPTED,
    ),
    "not claimed, answers OK, stays silent": Case(
        "broken", "broken", ("!1", "D2"), 'claim = "no", but it answers OK, and nothing fires',
        REFUSED, [refusal(LVC, "fail", fired={4: 1})], ACCEPTED,
    ),
    "not claimed, answers OK, and nobody looked": Case(
        "no_evidence", "untested", (), "the absence was not proved: there is no scenario for it",
        REFUSED, [result("a.a", "LVC-001", fired={0: 1}, verdict="none")], ACCEPTED,
    ),
    "supports_event lies": Case(
        "broken", "broken", ("!1", "D2"), 'claim = "no", but it answers OK, and nothing fires',
        REFUSED, [refusal(LVC, "fail")],
        [*DENIED, Observation(call="supports", side="subscription", kind=0, case="right side", code=1)],
    ),
    "refused, but it fires": Case(
        "broken", "broken", ("D2",), 'claim = "no" and registering is refused, but it fires',
        REFUSED, [refusal(LVC), result("reg.unknown-kind", "REG-003", fired={0: 1})], DENIED,
    ),
    "refused, and it violates a rule": Case(
        "broken", "broken", ("!1", "D2"), 'claim = "no" and registering is refused, but it fires',
        REFUSED, [refusal(LVC), result("lvc.x", "LVC-008", outcome="fail"), result("lvc.y", "LVC-001")], DENIED,
    ),
    "refused with the wrong code": Case(
        "broken", "broken", ("!1", "D2"), "the proof of absence fails: reg.absent-liveliness-changed",
        REFUSED, [refusal(LVC, "fail")], [registered(LVC, -1)],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", EVENT_CASES.values(), ids=list(EVENT_CASES))
def test_an_event(case: Case) -> None:
    declaration = declare(events={LVC: case.claim}, known=[known("LVC-009", "lvc.frozen")])
    found = cell("LivelinessChanged", declaration, case.results, case.observations)
    assert (found.id, found.text, found.notes, found.reason) == case[:4]


@pytest.mark.parametrize(
    ("claim", "results", "observations", "expected"),
    [
        (CLAIMED, [canonical(LVC)], [], True),
        (CLAIMED, [canonical(LVC, "fail")], [], False),
        (CLAIMED, [canonical(LVC, "unclear")], [], False),
        (CLAIMED, [], ACCEPTED, False),
        (REFUSED, [refusal(LVC)], DENIED, False),
        (REFUSED, [refusal(LVC, "fail", fired={0: 1})], ACCEPTED, True),
        (REFUSED, [refusal(LVC, "fail", fired={0: 1})], DENIED, False),
        (REFUSED, [refusal(LVC, "fail")], ACCEPTED, False),
        (
            REFUSED,
            [refusal(LVC, "fail"), result("reg.z", findings=[], refusal=LVC.label, fired={0: 1})],
            ACCEPTED,
            True,
        ),
    ],
)
def test_an_event_counts_as_supported_when_it_was_received(
    claim: dict[str, Any], results: list[ScenarioResult], observations: list[Observation], expected: bool
) -> None:
    assert fires(report(declare(events={LVC: claim}), results, observations=observations), LVC) is expected


def test_reasons_are_in_a_fixed_order() -> None:
    blocked = [result(f"reg.b[n={name}]", canonical=LVC.label, status="untested", reason=name) for name in "hgfedcba"]
    assert cell("LivelinessChanged", declare(), [*blocked, *rules(LVC_MUSTS)]).reason == (
        "what decides was not played: a; b; c; d; e; f; g; h"
    )
    gaps = [result(f"a.{index}", must, status="untested", reason=must) for index, must in enumerate(LVC_MUSTS)]
    reasons = "; ".join(sorted(LVC_MUSTS))
    assert cell("LivelinessChanged", declare(), [canonical(LVC), *gaps]).reason == (
        f"it fires on its canonical stimulus, but no rule was exercised: {reasons}"
    )
    gaps = [result(f"a.{index}", must, status="untested", reason=must) for index, must in enumerate(reversed(BASE))]
    assert cell("base", declare(), gaps).reason == f"nothing was exercised: {'; '.join(sorted(BASE))}"


def test_a_limit_of_another_event_does_not_limit_this_one() -> None:
    declaration = declare(events={MSL: LIMITED})
    results = [canonical(LVC), canonical(MSL), *rules(LVC_MUSTS), *rules(MSL_MUSTS)]
    assert cell("LivelinessChanged", declaration, results).text == "yes"
    assert cell("MessageLost", declaration, results).text == "limited"


BASE = [
    one for one, level in REQUIREMENTS.items()
    if level == "must" and one[:3] in ("REG", "DSP", "CNT", "QOS", "LIF", "ROB")
]  # fmt: skip


@pytest.mark.parametrize(
    ("results", "expected"),
    [
        (rules(BASE), ("verified", "33/33", ())),
        (rules(BASE, "ROB-001", "ROB-002"), ("verified", "31/33°", ())),
        ([], ("no_evidence", "untested", ())),
        ([result("rob.x", "ROB-001", outcome="unclear"), *rules(BASE, "ROB-001")],
         ("inconclusive", "unclear 32/33", ())),
        ([result("dsp.known", "DSP-007", outcome="fail"), *rules(BASE, "DSP-007")],
         ("deviates", "partly 32/33", ("D7",))),
        ([result("dsp.x", "DSP-007", outcome="fail"), *rules(BASE, "DSP-007")], ("deviates", "32/33 FAIL", ("!1",))),
        (
            [result("dsp.known", "DSP-007", outcome="fail"), result("dsp.x", "DSP-010", outcome="fail"),
             *rules(BASE, "DSP-007", "DSP-010", "ROB-001")],
            ("deviates", "30/33° FAIL", ("!1", "D7")),
        ),
    ],
)  # fmt: skip
def test_base_rules(results: list[ScenarioResult], expected: tuple[str, str, tuple[str, ...]]) -> None:
    declaration = declare(known=[known("DSP-007", "dsp.known", "D7")])
    found = cell("base", declaration, results)
    assert (found.id, found.text, found.notes) == expected
    assert found.strong == (found.id == "deviates")
    assert found.surprising == ("FAIL" in found.text)


def test_base_rules_count_only_what_applies() -> None:
    declaration = declare(events={LVC: REFUSED}, behaviour={"callback_cap": False})
    gone = ("REG-009", "CNT-004", "CNT-005", "DSP-008")
    assert cell("base", declaration, rules(BASE, *gone)).text == "29/29"


AGENT = {"ping": "round_trip", "peer": "agent", "reconnect": "yes", "hard_liveliness": {"claim": "yes"}}
SILENT = {"ping": "no", "absent": "never", "because": "there is no peer", "link": "https://example.org"}
CON = [f"CON-{number:03}" for number in (1, 2, 3, 4, 5, 6, 8, 9, 10)]


@pytest.mark.parametrize(
    ("column", "connection", "results", "expected"),
    [
        ("ping", AGENT, rules(CON), ("verified", "yes", (), "every rule holds")),
        ("ping", AGENT, [], ("no_evidence", "untested", (), "what decides was not played: no scenario proves it")),
        ("ping", AGENT, [result("con.lie", "CON-001", outcome="fail")],
         ("broken", "broken", ("!1",), "violated: CON-001, shown by con.lie")),
        ("ping", AGENT, [result("con.slow", "CON-002", outcome="fail"), *rules(CON, "CON-002")],
         ("deviates", "partly 2/3", ("!1",), "violated: CON-002")),
        ("ping", AGENT, [result("con.x", "CON-001", outcome="unclear")],
         ("inconclusive", "unclear", (), "no verdict: CON-001")),
        ("ping", SILENT, rules(["CON-001"]), ("refused", "no", ("D1",), "proved absent: all.con-001")),
        ("ping", SILENT, [], ("no_evidence", "untested", (), "what decides was not played: no scenario proves it")),
        ("ping", SILENT, [result("con.lie", "CON-001", outcome="fail")],
         ("broken", "broken", ("!1",), "violated: CON-001, shown by con.lie")),
        ("ping", SILENT, [result("con.x", "CON-001", outcome="unclear")],
         ("inconclusive", "unclear", (), "no verdict: CON-001")),
        ("reconnect", SILENT, [], ("not_applicable", "n/a", (), 'peer = "none"')),
        ("reconnect", AGENT, rules(CON), ("verified", "yes", (), "every rule holds")),
        ("reconnect", AGENT, rules(CON, "CON-006"),
         ("verified", "yes°", (), "every rule that was exercised holds; not exercised: CON-006")),
        ("reconnect", AGENT | {"reconnect": "limited", "because": "once"}, rules(CON),
         ("reduced", "limited", ("D1",), "holds inside the declared limit")),
        ("reconnect", AGENT | {"reconnect": "no"}, rules(CON),
         ("unclaimed", "undeclared", ("D1",), "not claimed, but every rule holds")),
        ("reconnect", AGENT | {"reconnect": "no"}, [result("con.x", "CON-005", outcome="fail"), *rules(CON, "CON-005")],
         ("deviates", "partly 2/3", ("!1",), "violated: CON-005")),
        ("hard_liveliness", AGENT, rules(CON), ("verified", "yes", (), "every rule holds")),
        ("hard_liveliness", AGENT, [result("con.x", "CON-008", outcome="fail")],
         ("broken", "broken", ("!1",), "violated: CON-008, shown by con.x")),
        ("hard_liveliness", {"ping": "round_trip", "peer": "router"}, [],
         ("not_applicable", "n/a", (), 'hard_liveliness.claim = "no"')),
    ],
)  # fmt: skip
def test_the_connection(
    column: str, connection: dict[str, Any], results: list[ScenarioResult], expected: tuple[object, ...]
) -> None:
    found = cell(column, declare(connection=connection), results)
    assert (found.id, found.text, found.notes, found.reason) == expected


def pattern(**fields: Any) -> ScenarioResult:
    fields = {"needs": ("LivelinessChanged", "MessageLost"), **fields}
    return result("pat.slow", "MSL-001", suite="patterns", title="Slow consumer", **fields)


ABSENT = {"status": "not-applicable", "reason": "MessageLost is not claimed"}


@pytest.mark.parametrize(
    ("claim", "results", "expected"),
    [
        (CLAIMED, [pattern()], ("verified", "yes", (), "the pattern works")),
        (LIMITED, [pattern()], ("reduced", "limited", ("D1",), "works inside the declared limit")),
        (CLAIMED, [pattern(outcome="fail")], ("deviates", "partly", ("!1",), "fails: pat.slow")),
        (CLAIMED, [pattern(outcome="unclear")], ("inconclusive", "unclear", (), "no verdict: pat.slow")),
        (REFUSED, [pattern(**ABSENT)], ("refused", "no", ("D1",), "it needs MessageLost, which is absent")),
        (CLAIMED, [pattern(status="untested", reason="no wire")],
         ("no_evidence", "untested", (), "the pattern was not played: no wire")),
        (CLAIMED, [pattern(status="not-applicable", reason="no agent")], ("not_applicable", "n/a", (), "no agent")),
        (CLAIMED, [result("pat.slow[n=1]", suite="patterns", status="not-applicable", reason="no agent"),
                   result("pat.slow[n=2]", suite="patterns", status="untested", reason="no wire")],
         ("no_evidence", "untested", (), "the pattern was not played: no agent; no wire")),
    ],
)  # fmt: skip
def test_a_pattern(claim: dict[str, Any], results: list[ScenarioResult], expected: tuple[object, ...]) -> None:
    found = cell("pat.slow", declare(events={MSL: claim}), results)
    assert (found.id, found.text, found.notes, found.reason) == expected


def test_every_word_is_shown_above() -> None:
    events = {case.id for case in EVENT_CASES.values()}
    assert events | {"not_applicable"} == set(WORDS)
