"""The word in a cell. Of the words in `WORDS` the first that fits wins."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal, TypeAlias

from msgspec import Struct

from nros_conformance.judge.results import Verdict
from nros_conformance.report.applicability import is_limited
from nros_conformance.report.columns import Column
from nros_conformance.report.evidence import Evidence
from nros_conformance.report.notes import Keys, natural
from nros_conformance.report.results import Report, ScenarioResult
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.declaration import Claim
from nros_conformance.rmw.events import EventKind

CellId: TypeAlias = Literal[
    "broken", "deviates", "inconclusive", "no_evidence", "not_applicable", "refused", "unclaimed", "reduced", "verified"
]
WORDS: Mapping[CellId, str] = {
    "broken": "broken", "deviates": "partly", "inconclusive": "unclear", "no_evidence": "untested",
    "not_applicable": "n/a", "refused": "no", "unclaimed": "undeclared", "reduced": "limited", "verified": "yes",
}  # fmt: skip
"""In the order in which they are tried."""

DEGREE = "°"
_HEART = {"ping": "CON-001", "reconnect": "CON-005", "hard_liveliness": "CON-008"}
"""The must that stands for a canonical stimulus where there is no event."""

_State: TypeAlias = Literal["pass", "fail", "unclear", "none"]


class Cell(Struct, frozen=True, kw_only=True):
    """One cell. ``text`` is what is printed, without the keys of ``notes``."""

    column: str
    id: CellId
    text: str
    notes: tuple[str, ...] = ()
    reason: str
    """One sentence without a full stop: why this word."""

    @property
    def strong(self) -> bool:
        """Whether it is printed bold."""
        return self.id in ("broken", "deviates")

    @property
    def surprising(self) -> bool:
        """Whether it holds a violation that no ``[[known]]`` entry covers."""
        return any(key.startswith("!") for key in self.notes)


def cells(
    report: Report, found: Mapping[str, Evidence], columns: Iterable[Column], keys: Keys
) -> tuple[Cell, ...]:  # fmt: skip
    """The row of a report: one cell per column."""
    return tuple(_cell(report, found, column, keys) for column in columns)


def answers(report: Report, call: str, kind: EventKind) -> frozenset[int]:
    """The codes that a call answered for a kind on its own side, with everything in order."""
    return frozenset(
        one.code for one in report.observations if (one.call, one.kind, one.case) == (call, kind, "right side")
    )


def answers_ok(report: Report, kind: EventKind) -> bool:
    """Whether supports_event or registering ever said that the backend generates this kind."""
    return ReturnCode.OK in answers(report, "register", kind) or 1 in answers(report, "supports", kind)


def fires(report: Report, kind: EventKind) -> bool:
    """Whether an event was received: on its canonical stimulus, or undeclared where it should be absent."""
    if report.declaration.event(kind).claim != "no":
        return state(stimuli(report, kind, "canonical")) == "pass"
    return answers_ok(report, kind) and any(kind in result.fired for result in stimuli(report, kind, "refusal"))


def stimuli(report: Report, kind: EventKind, role: Literal["canonical", "refusal"]) -> tuple[ScenarioResult, ...]:
    """The scenarios that decide about a kind, by key."""
    found = (one for one in report.results if getattr(one, role) == kind.label)
    return tuple(sorted(found, key=lambda one: one.key))


def state(results: Iterable[ScenarioResult]) -> _State:
    """What scenarios of the same role say together; ``none``: not one was played."""
    states = {_state(result.last) for result in results if result.status == "played"}
    for one in ("fail", "unclear", "pass"):
        if one in states:
            return one
    return "none"


def _state(verdict: Verdict | None) -> _State:
    if verdict is None or verdict.verdict == "none":
        return "none"
    if verdict.verdict in ("inconclusive", "error"):
        return "unclear"
    failed = verdict.failed()
    if verdict.verdict == "fail" and (not failed or any(not finding.implied for finding in failed)):
        return "fail"
    # Only implied invariants failed: it fired as it should, and the base rules show the rest.
    return "pass"


def _cell(report: Report, found: Mapping[str, Evidence], column: Column, keys: Keys) -> Cell:
    if column.pattern:
        return _pattern(report, column, keys)
    rules = [found[must] for must in column.musts]
    if column.id == "base":
        return _base(column, rules, keys)
    if column.kind is None:
        return _connection(report, column, rules, keys)
    if report.declaration.event(column.kind).claim == "no":
        return _unclaimed_event(report, column, column.kind, rules, keys)
    return _claimed_event(report, column, column.kind, rules, keys)


def _claimed_event(report: Report, column: Column, kind: EventKind, rules: list[Evidence], keys: Keys) -> Cell:
    canonical = stimuli(report, kind, "canonical")
    outcome = state(canonical)
    if outcome == "fail":
        reason = f"claimed, but the canonical stimulus fails: {_names(canonical, 'fail')}"
        return _make(column, "broken", reason, notes=_violations(keys, rules, canonical))
    if outcome == "pass" and all(rule.standing == "unexercised" for rule in rules if rule.applies):
        reasons = "; ".join(sorted({rule.reason for rule in rules if rule.applies}))
        return _make(column, "no_evidence", f"it fires on its canonical stimulus, but no rule was exercised: {reasons}")
    return _weigh(
        column, rules, keys, "limited" if is_limited(report.declaration, kind) else "yes",
        unclear=_names(canonical, "unclear") if outcome == "unclear" else "",
        untested=_why_not(canonical) if outcome == "none" else "",
    )  # fmt: skip


def _unclaimed_event(report: Report, column: Column, kind: EventKind, rules: list[Evidence], keys: Keys) -> Cell:
    refusal = stimuli(report, kind, "refusal")
    outcome = state(refusal)
    accepted = answers_ok(report, kind)
    absence = keys.absences.get(column.id, ())
    notes = (*_violations(keys, rules, refusal), *absence)
    if accepted and any(kind in result.fired for result in refusal):
        return _make(column, "unclaimed", 'claim = "no", but it answers OK, and it fires', notes=absence)
    if accepted and outcome in ("pass", "fail"):
        return _make(column, "broken", 'claim = "no", but it answers OK, and nothing fires', notes=notes)
    if not accepted and (any(rule.broken for rule in rules) or any(kind in one.fired for one in report.results)):
        return _make(column, "broken", 'claim = "no" and registering is refused, but it fires', notes=notes)
    if outcome == "fail":
        return _make(column, "broken", f"the proof of absence fails: {_names(refusal, 'fail')}", notes=notes)
    if outcome == "unclear":
        return _make(column, "inconclusive", f"no verdict: {_names(refusal, 'unclear')}")
    if outcome == "none":
        return _make(column, "no_evidence", f"the absence was not proved: {_why_not(refusal)}")
    return _make(column, "refused", f"proved absent: {_names(refusal, 'pass')}", notes=absence)


def _base(column: Column, rules: list[Evidence], keys: Keys) -> Cell:
    cell = _weigh(column, rules, keys, "yes")
    if cell.id == "no_evidence":
        return cell
    applicable = [rule for rule in rules if rule.applies]
    count = f"{sum(rule.standing == 'holds' for rule in applicable)}/{len(applicable)}{_degree(applicable)}"
    text = {"deviates": f"partly {count}", "inconclusive": f"unclear {count}"}.get(cell.id, count)
    if any(rule.standing == "violated" for rule in applicable):
        text = f"{count} FAIL"
    return Cell(column=cell.column, id=cell.id, text=text, notes=cell.notes, reason=cell.reason)


def _connection(report: Report, column: Column, rules: list[Evidence], keys: Keys) -> Cell:
    connection = report.declaration.connection
    claim: Claim = {
        "ping": "yes" if connection.ping == "round_trip" else "no",
        "reconnect": connection.reconnect,
        "hard_liveliness": connection.hard_liveliness.claim,
    }[column.id]
    applicable = [rule for rule in rules if rule.applies]
    if not applicable:
        return _make(column, "not_applicable", rules[0].reason if rules else "there is no rule")
    heart = next((rule for rule in applicable if rule.requirement == _HEART[column.id]), applicable[0])
    absence = keys.absences.get(column.id, ())
    if heart.broken and (claim != "no" or column.id == "ping"):
        reason = f"violated: {heart.requirement}, shown by {', '.join(heart.scenarios('fail'))}"
        return _make(column, "broken", reason, notes=_violations(keys, applicable))
    untested = "" if heart.exercised else heart.reason
    if column.id == "ping" and claim == "no":
        if heart.standing == "holds":
            return _make(column, "refused", f"proved absent: {', '.join(heart.scenarios('pass'))}", notes=absence)
        return _weigh(column, [heart], keys, "yes", untested=untested)
    cell = _weigh(column, rules, keys, "limited" if claim == "limited" else "yes", untested=untested)
    if cell.id == "verified" and claim == "no":
        return _make(column, "unclaimed", "not claimed, but every rule holds", notes=absence)
    return cell


def _weigh(
    column: Column, rules: list[Evidence], keys: Keys, best: Literal["yes", "limited"], *, unclear: str = "",
    untested: str = "",
) -> Cell:  # fmt: skip
    """The words after *broken*, for what is claimed. ``unclear`` and ``untested`` speak of the canonical stimulus."""
    applicable = [rule for rule in rules if rule.applies]
    violated = [rule for rule in applicable if rule.broken]
    unsure = [rule.requirement for rule in applicable if rule.standing == "unclear"]
    missing = [rule.requirement for rule in applicable if rule.standing == "unexercised"]
    limit = keys.absences.get(column.id, ()) if best == "limited" else ()
    degree = _degree(applicable)
    if violated:
        holding = sum(rule.standing == "holds" for rule in applicable)
        reason = f"violated: {', '.join(rule.requirement for rule in violated)}"
        notes = (*_violations(keys, violated), *limit)
        return _make(column, "deviates", reason, f" {holding}/{len(applicable)}{degree}", notes)
    if unclear or unsure:
        return _make(column, "inconclusive", f"no verdict: {unclear or ', '.join(unsure)}")
    if untested:
        return _make(column, "no_evidence", f"what decides was not played: {untested}")
    if len(missing) == len(applicable):
        reasons = sorted({rule.reason for rule in applicable})
        return _make(column, "no_evidence", f"nothing was exercised: {'; '.join(reasons) or 'there is no rule'}")
    gap = f"; not exercised: {', '.join(missing)}" if missing else ""
    if best == "limited":
        return _make(column, "reduced", f"holds inside the declared limit{gap}", degree, limit)
    return _make(column, "verified", f"every rule that was exercised holds{gap}" if gap else "every rule holds", degree)


def _pattern(report: Report, column: Column, keys: Keys) -> Cell:
    played = tuple(sorted((one for one in report.results if one.id == column.id), key=lambda one: one.key))
    outcome = state(played)
    needs = sorted({need for one in played for need in one.needs})
    kinds = [kind for kind in EventKind if kind.label in needs]
    absent = [kind for kind in kinds if report.declaration.event(kind).claim == "no"]
    limited = [kind for kind in kinds if is_limited(report.declaration, kind)]
    if outcome == "fail":
        return _make(column, "deviates", f"fails: {_names(played, 'fail')}", notes=_violations(keys, (), played))
    if outcome == "unclear":
        return _make(column, "inconclusive", f"no verdict: {_names(played, 'unclear')}")
    if absent:
        notes = tuple(key for kind in absent for key in keys.absences.get(kind.label, ()))
        reason = f"it needs {', '.join(kind.label for kind in absent)}, which is absent"
        return _make(column, "refused", reason, notes=notes)
    if outcome == "none":
        if played and all(one.status == "not-applicable" for one in played):
            return _make(column, "not_applicable", _why_not(played))
        return _make(column, "no_evidence", f"the pattern was not played: {_why_not(played)}")
    if limited:
        notes = tuple(key for kind in limited for key in keys.absences.get(kind.label, ()))
        return _make(column, "reduced", "works inside the declared limit", notes=notes)
    return _make(column, "verified", "the pattern works")


def _make(column: Column, id_: CellId, reason: str, suffix: str = "", notes: Iterable[str] = ()) -> Cell:
    return Cell(column=column.id, id=id_, text=WORDS[id_] + suffix, notes=_ordered(notes), reason=reason)


def _degree(rules: list[Evidence]) -> str:
    return DEGREE if any(rule.standing == "unexercised" for rule in rules) else ""


def _violations(
    keys: Keys, rules: Iterable[Evidence], stimuli: Iterable[ScenarioResult] = ()
) -> tuple[str, ...]:  # fmt: skip
    requirements = {rule.requirement for rule in rules if rule.broken}
    for result in stimuli:
        failed = result.last.failed() if result.last else ()
        requirements |= {one for finding in failed for one in finding.proves}
        if result.verdict == "fail" and not any(finding.proves for finding in failed):
            requirements |= set(result.proves)
    return tuple(key for one, found in keys.violations.items() if one in requirements for key in found)


def _names(results: Iterable[ScenarioResult], outcome: _State) -> str:
    return ", ".join(one.key for one in results if one.status == "played" and _state(one.last) == outcome)


def _why_not(results: tuple[ScenarioResult, ...]) -> str:
    if not results:
        return "there is no scenario for it"
    reasons = sorted({one.reason for one in results if one.reason})
    codes = sorted({one.last.reason for one in results if one.last is not None and one.last.reason})
    return "; ".join(reasons or codes) or "no reason was given"


def _ordered(keys: Iterable[str]) -> tuple[str, ...]:
    """Each key once; what nobody declared comes first."""
    return tuple(sorted(set(keys), key=natural))
