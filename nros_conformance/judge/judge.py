"""A trace in, a verdict out. Pure: the same trace always gets the same verdict.

Levels: a failed finding fails the scenario if it proves a must (or a requirement whose level the header
does not know), gives a warning if it proves at most a should, and is none if it proves mays only. An
unclear finding makes the scenario inconclusive if it proves a must; if it proves less, only when nothing
conclusive stands beside it: an unjudged should is not worth playing the scenario again.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from msgspec.structs import replace

from nros_conformance.formats.places import FormatError
from nros_conformance.judge.calls import UnknownAnswer
from nros_conformance.judge.expectations import judge_part, name_of
from nros_conformance.judge.findings import Judged, milliseconds
from nros_conformance.judge.index import CALLS, Index, MissingQuantity
from nros_conformance.judge.invariants import INVARIANTS
from nros_conformance.judge.results import Finding, Verdict, VerdictName
from nros_conformance.judge.standing import answered
from nros_conformance.judge.unopened import why_unopened
from nros_conformance.suite.loader import typed
from nros_conformance.trace.records import End, Trace

CUT_SHORT = "the trace was cut short"
_DIED = {"crash": "the backend crashed", "hang": "the backend hung", "raised": "the backend failed"}


def judge(trace: Trace) -> Verdict:
    """The verdict of one trace; ``error`` when the harness made it so that it cannot be judged."""
    end = trace.end
    if end is not None and end.outcome == "error":
        return Verdict(verdict="error", reason=f"the harness failed: {end.detail}")
    try:
        index = Index(trace, typed(trace.header.scenario))
        conditions = [*_faults(index), *_idling(index), *(_condition(index, one) for one in index.scenario.given)]
        conditions = [_excused(one, {}, None, index) for one in conditions]
        expected = [_finding(name_of(one), one.requirements, judge_part(index, one)) for one in index.scenario.expect]
    except FormatError as error:
        return Verdict(verdict="error", reason=f"the embedded {error}")
    except (MissingQuantity, UnknownAnswer) as error:
        return Verdict(verdict="error", reason=str(error))
    implied = [replace(_finding(law.name, (law.proves,), law.judge(index)), implied=True) for law in INVARIANTS]
    levels = trace.header.levels
    unmet = next((one for one in conditions if one.outcome != "pass"), None)
    expected = [_excused(one, levels, unmet, index) for one in expected]
    implied = [_excused(one, levels, None, index) for one in implied]
    findings = (*conditions, *expected, *implied)
    name, reason = _verdict(end, unmet, expected, implied, levels)
    failed = any(one.outcome == "fail" for one in findings)
    if name == "fail" and not failed and end is not None and (why := why_unopened(index, end)):
        name, reason = "inconclusive", f"{reason}; {why}"
    warnings = tuple(
        _told(one) for one in (*expected, *implied) if one.outcome == "fail" and _level(one, levels) != "must"
    )
    return Verdict(verdict=name, reason=reason, findings=findings, warnings=warnings)


def _verdict(
    end: End | None, unmet: Finding | None, expected: Sequence[Finding], implied: Sequence[Finding],
    levels: dict[str, str],
) -> tuple[VerdictName, str]:  # fmt: skip
    """The verdict and its reason; the first that applies."""
    if end is not None and end.outcome in _DIED:
        return "fail", f"{_DIED[end.outcome]}: {end.detail}" if end.detail else _DIED[end.outcome]
    musts = [one for one in (*expected, *implied) if _level(one, levels) == "must"]
    if failed := _first(musts, "fail"):
        return "fail", _told(failed)
    if end is None:
        return "inconclusive", CUT_SHORT
    if unmet is not None:
        return "inconclusive", f"{unmet.name}: {unmet.got}" + (f"; wanted {unmet.wanted}" if unmet.wanted else "")
    if unclear := _first(musts, "unclear"):
        return "inconclusive", _told(unclear)
    conclusive = [one for one in expected if one.outcome in ("pass", "fail")]
    if not conclusive:
        unclear = _first(expected, "unclear")
        if unclear is not None:
            return "inconclusive", _told(unclear)
        return "none", "; ".join(dict.fromkeys(one.got for one in expected if one.got)) or "nothing is expected"
    if warned := _first((*expected, *implied), "fail"):
        return "warn", _told(warned)
    return "pass", ""


def _faults(index: Index) -> list[Finding]:
    """A condition for each fault that the backend would not inject, although it is declared."""
    refused = [fault for _, fault in index.all_faults if fault.detail.get("code", 0) != 0]
    return [
        _finding(
            f"given fault {one.fault}", (),
            Judged("unclear", f"{one.fault} is injected", answered(one.label, one.detail["code"]), at=one.begin),
        )
        for one in refused
    ]  # fmt: skip


def _idling(index: Index) -> list[Finding]:
    """A condition for each idling in whose time something was to happen that came only afterwards.

    The harness drives by itself again as soon as it is over, and delivers what was to come inside a call of the script.
    """
    acts = [act for _, act in index.all_acts if not act.within]
    found = []
    for together in (act for act in acts if act.op == "parallel"):
        during = [act for act in acts if together.begin <= act.begin <= together.end]
        calls = [act for act in during if act.op in CALLS and act.session]
        for idle in (act for act in during if act.op == "idle"):
            late = next((call for call in calls if call.begin > idle.end), None)
            # A call that was under way then may have taken too long: that is the backend's doing.
            if late is not None and not any(call.begin <= idle.end < call.end for call in calls):
                got = f"it was over {milliseconds(late.begin - idle.end)} before {late.label}[{late.index}] began"
                found.append(_finding("given idle", (), Judged("unclear", "all beside it", got, at=idle.end)))
    return found


def _condition(index: Index, given: object) -> Finding:
    judged = judge_part(index, given)  # type: ignore[arg-type]
    if judged.outcome != "pass":
        judged = judged._replace(outcome="unclear")
    return _finding(name_of(given), (), judged)  # type: ignore[arg-type]


def _finding(name: str, proves: tuple[str, ...], judged: Judged) -> Finding:
    told = judged.outcome in ("fail", "unclear")
    return Finding(
        name=name, proves=proves, outcome=judged.outcome, wanted=judged.wanted, got=judged.got,
        nearest_ns=judged.nearest_ns if told else None, surplus=judged.surplus if told else None, at=judged.at,
    )  # fmt: skip


def _excused(one: Finding, levels: dict[str, str], unmet: Finding | None, index: Index) -> Finding:
    """What is left of a finding when its stimulus did not happen, the trace is not whole, or it is a may."""
    if one.outcome == "none":
        return one
    if unmet is not None:
        return replace(one, outcome="unclear", got=f"the condition is not met: {unmet.got}")
    if one.outcome == "pass" and not index.whole:
        return replace(one, outcome="unclear", got=f"{one.got}, but the play did not come to its end")
    if one.outcome == "fail" and _level(one, levels) == "may":
        return replace(one, outcome="none", got=f"{one.got}; permitted")
    return one


def _level(one: Finding, levels: dict[str, str]) -> str:
    found = {levels.get(requirement, "must") for requirement in one.proves}
    return next((level for level in ("must", "should") if level in found), "may" if found else "must")


def _first(findings: Iterable[Finding], outcome: str) -> Finding | None:
    return next((one for one in findings if one.outcome == outcome), None)


def _told(one: Finding) -> str:
    return f"{', '.join(one.proves)}: {one.got}" if one.got else f"{', '.join(one.proves)}: {one.name}"
