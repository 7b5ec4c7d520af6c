"""What a report shows about each requirement.

A requirement holds if at least one conclusive finding passes and none fails. The last attempt of a
scenario counts; all before it were inconclusive. Implied invariants count like expectations.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Literal, TypeAlias

from msgspec import Struct

from nros_conformance.judge.results import Finding, Outcome, Verdict
from nros_conformance.report.applicability import not_applicable
from nros_conformance.report.known import covering, in_force
from nros_conformance.report.results import Report, ScenarioResult
from nros_conformance.rmw.declaration import Known

Standing: TypeAlias = Literal["holds", "violated", "known", "unclear", "unexercised", "not-applicable"]

NO_SCENARIO = "no scenario proves it"


class Proof(Struct, frozen=True, kw_only=True):
    """One finding about a requirement."""

    scenario: str
    """Key of the scenario."""
    finding: str
    outcome: Outcome
    known: str = ""
    """Key of the ``[[known]]`` entry that declares this failure."""


class Evidence(Struct, frozen=True, kw_only=True):
    """One requirement on one backend."""

    requirement: str
    level: str
    standing: Standing
    reason: str = ""
    """Why it was not exercised, or does not apply."""
    proofs: tuple[Proof, ...] = ()

    @property
    def applies(self) -> bool:
        """Whether it counts."""
        return self.standing != "not-applicable"

    @property
    def broken(self) -> bool:
        """Whether a conclusive finding violates it, declared or not."""
        return self.standing in ("violated", "known")

    @property
    def exercised(self) -> bool:
        """Whether there is a conclusive finding."""
        return self.standing in ("holds", "violated", "known")

    @property
    def known(self) -> tuple[str, ...]:
        """Keys of the ``[[known]]`` entries that declare its failures."""
        return tuple(sorted({proof.known for proof in self.proofs if proof.known}))

    def scenarios(self, *outcomes: Outcome) -> tuple[str, ...]:
        """Keys of the scenarios with such a finding, sorted."""
        return tuple(sorted({proof.scenario for proof in self.proofs if proof.outcome in outcomes}))


def evidence(report: Report, requirements: Mapping[str, str]) -> dict[str, Evidence]:
    """By requirement, in order of ``requirements`` (id to level: must, should, may)."""
    entries = in_force(report.declaration, report.versions)
    proofs: dict[str, list[Proof]] = {}
    for result in sorted(report.results, key=lambda result: result.key):
        for requirement, proof in proofs_of(result, entries):
            proofs.setdefault(requirement, []).append(proof)
    return {
        requirement: _weigh(report, requirement, level, tuple(sorted(proofs.get(requirement, ()), key=_order)))
        for requirement, level in requirements.items()
    }


def proofs_of(result: ScenarioResult, entries: tuple[Known, ...] = ()) -> Iterator[tuple[str, Proof]]:
    """What one scenario says about which requirement; findings without a word on it are left out."""
    verdict = result.last
    if result.status != "played" or verdict is None or verdict.verdict == "none":
        return
    findings = tuple(_findings(verdict, result.proves))
    for finding in findings:
        outcome = _outcome(finding, verdict)
        for requirement in finding.proves if outcome != "none" else ():
            known = covering(entries, result, requirement) if outcome == "fail" else None
            yield (
                requirement,
                Proof(scenario=result.key, finding=finding.name, outcome=outcome, known=known.key if known else ""),
            )


def failures(found: Iterable[Evidence]) -> tuple[Evidence, ...]:
    """The musts that are violated and that no ``[[known]]`` entry covers: they end in exit code 1."""
    return tuple(one for one in found if one.level == "must" and one.standing == "violated")


def _findings(verdict: Verdict, proves: tuple[str, ...]) -> Iterator[Finding]:
    yield from verdict.findings
    failed = verdict.failed()
    if verdict.verdict == "fail" and not any(finding.proves for finding in failed):
        # A crash, hang or exception: the backend did nothing of what this scenario asks for.
        name = failed[0].name if failed else verdict.reason
        yield Finding(name=name, proves=proves, outcome="fail")
    elif verdict.verdict in ("inconclusive", "error"):
        said = {requirement for finding in verdict.findings for requirement in finding.proves}
        if missing := tuple(one for one in proves if one not in said):
            yield Finding(name=verdict.reason, proves=missing, outcome="unclear")


def _outcome(finding: Finding, verdict: Verdict) -> Outcome:
    """What counts of it: nothing was shown when the stimulus did not happen or the harness failed."""
    if finding.outcome == "none" or verdict.verdict not in ("inconclusive", "error"):
        return finding.outcome
    conditions = (one for one in verdict.findings if not one.proves and not one.implied)
    unsure = verdict.verdict == "error" or any(one.outcome != "pass" for one in conditions)
    return "unclear" if unsure else finding.outcome


def _order(proof: Proof) -> tuple[str, str, str]:
    return proof.scenario, proof.finding, proof.outcome


def _weigh(report: Report, requirement: str, level: str, proofs: tuple[Proof, ...]) -> Evidence:
    standing: Standing
    reason = ""
    outcomes = {proof.outcome for proof in proofs}
    if "fail" in outcomes:
        declared = all(proof.known for proof in proofs if proof.outcome == "fail")
        standing = "known" if declared else "violated"
    elif excused := not_applicable(requirement, report.declaration):
        standing, reason = "not-applicable", excused
    elif "pass" in outcomes:
        standing = "holds"
    elif "unclear" in outcomes:
        standing = "unclear"
    else:
        standing, reason = "unexercised", _why_unexercised(report.results, requirement)
    return Evidence(requirement=requirement, level=level, standing=standing, reason=reason, proofs=proofs)


def _why_unexercised(results: Iterable[ScenarioResult], requirement: str) -> str:
    meant = sorted((one for one in results if requirement in one.proves), key=lambda one: one.key)
    if not meant:
        return NO_SCENARIO
    reasons = {one.reason for one in meant if one.status == "untested"}
    if not reasons:
        reasons = {f"`{one.key}` gives no evidence" for one in meant if one.status == "played"}
    if not reasons:
        reasons = {one.reason for one in meant if one.status == "not-applicable"}
    return "; ".join(sorted(filter(None, reasons))) or "its scenarios were not played"
