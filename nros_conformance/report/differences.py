"""Where declaration and behaviour differ, both ways. Any difference ends a run in exit code 1."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from nros_conformance.report.cells import answers, answers_ok, state, stimuli
from nros_conformance.report.evidence import Evidence, evidence, proofs_of
from nros_conformance.report.known import concerns, in_force, must_show
from nros_conformance.report.results import Difference, Report, ScenarioResult
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.declaration import Known
from nros_conformance.rmw.events import EventKind


def differences(report: Report, requirements: Mapping[str, str]) -> tuple[Difference, ...]:
    """All of them, as sentences that name the section of ``backend.toml``.

    ``requirements``: id to level. Raises `ReportError` for a version range that cannot be read.
    """
    if not report.available:
        return ()
    found = evidence(report, requirements)
    texts = [text for kind in EventKind for text in _event(report, kind)]
    texts += _connection(report, found)
    texts += [text for known in in_force(report.declaration, report.versions) for text in _known(report, known)]
    return tuple(Difference(text=text) for text in texts)


def _event(report: Report, kind: EventKind) -> Iterator[str]:
    claim = report.declaration.event(kind).claim
    section = f'[events.{kind.label}] claim = "{claim}"'
    codes = answers(report, "register", kind)
    if claim != "no":
        canonical = stimuli(report, kind, "canonical")
        if ReturnCode.UNSUPPORTED in codes:
            yield f"{section}, but registering answered UNSUPPORTED (-5)"
        elif 0 in answers(report, "supports", kind):
            yield f"{section}, but supports_event answered false"
        elif state(canonical) == "fail":
            yield f"{section}, but the canonical stimulus fails: {_failing(canonical)}"
        return
    refusal = stimuli(report, kind, "refusal")
    callbacks = sum(result.fired.get(kind, 0) for result in refusal)
    if answers_ok(report, kind):
        answer = "registering answered OK" if ReturnCode.OK in codes else "supports_event answered true"
        if callbacks:
            yield f"{section}, but {answer} and it fires: {_fired(refusal, kind)}; claim it"
        elif state(refusal) in ("pass", "fail"):
            yield f"{section}, but {answer}, and nothing fires: {', '.join(one.key for one in refusal)}"
        else:
            yield f"{section}, but {answer}"
    elif fired := _fired(report.results, kind):
        yield f"{section} and registering was refused, but it fires: {fired}"
    elif state(refusal) == "fail":
        yield f"{section}, but the proof of absence fails: {_failing(refusal)}"


def _connection(report: Report, found: Mapping[str, Evidence]) -> Iterator[str]:
    connection = report.declaration.connection
    ping = found.get("CON-001")
    if ping is not None and ping.broken:
        yield f'[connection] ping = "{connection.ping}", but CON-001 is violated: {", ".join(ping.scenarios("fail"))}'
    rules = [found[one] for one in ("CON-004", "CON-005", "CON-006") if one in found]
    absent = connection.reconnect == "no" and connection.peer != "none"
    if absent and rules and all(rule.standing == "holds" for rule in rules):
        yield '[connection] reconnect = "no", but every rule of reconnection holds; claim it'


def _known(report: Report, known: Known) -> Iterator[str]:
    section = f"[[known]] {known.key} ({known.requirement}, {known.scenario})"
    named = [result for result in report.results if concerns(known, result)]
    if not named:
        # A selection or a shorter profile leaves scenarios out; only a whole run can tell.
        if not report.partial:
            yield f"{section} matches no scenario"
        return
    proofs = (pair for result in named for pair in proofs_of(result))
    outcomes = {proof.outcome for requirement, proof in proofs if requirement == known.requirement}
    if "fail" in outcomes:
        return
    if "pass" in outcomes and "unclear" not in outcomes and must_show(known, named):
        yield f"{section} holds; remove the entry"
    elif not outcomes and all(result.status == "not-applicable" for result in named):
        yield f"{section} names a scenario that does not apply to {report.backend}; remove the entry"
    elif not any(known.requirement in result.proves for result in named) and not outcomes:
        yield f"{section}: the scenario proves nothing about {known.requirement}"


def _failing(results: Iterable[ScenarioResult]) -> str:
    return ", ".join(result.key for result in results if result.status == "played" and state([result]) == "fail")


def _fired(results: Iterable[ScenarioResult], kind: EventKind) -> str:
    return ", ".join(sorted(result.key for result in results if result.fired.get(kind)))
