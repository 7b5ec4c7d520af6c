"""Why a scenario was judged as it was, as text: requirement, script, timeline, judgement."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any, Protocol

from nros_conformance.formats.counts import many, repeatedly
from nros_conformance.judge.results import Finding, Verdict
from nros_conformance.report.columns import columns
from nros_conformance.report.evidence import evidence
from nros_conformance.report.matrix import MEANINGS
from nros_conformance.report.results import Attempt, Report, ReportError, ScenarioResult
from nros_conformance.report.table import Table
from nros_conformance.report.timeline import render, timeline
from nros_conformance.rmw.codes import code_name
from nros_conformance.rmw.events import EventKind
from nros_conformance.suite.catalogue import Requirement
from nros_conformance.suite.loader import Loaded
from nros_conformance.suite.walk import expectations
from nros_conformance.trace.records import Trace

WIDTH = 96


class Played(Protocol):
    """Which row was played, and by what name the command finds it; a `Report` is one."""

    @property
    def row(self) -> str: ...
    @property
    def asked(self) -> str: ...


def explain_scenario(
    report: Played, result: ScenarioResult, attempt: Attempt, trace: Trace, requirements: Mapping[str, Requirement],
    options: str = "", sources: Mapping[str, str] = MappingProxyType({}),
) -> str:  # fmt: skip
    """The whole explanation of one play.

    ``options``: of the command, to be repeated in its hints. ``sources``: what the abbreviations in the
    requirements stand for.
    """
    verdict = attempt.verdict
    final = "a fail is final" if verdict.verdict == "fail" else f"T = {attempt.T_ns / 1e6:g} ms"
    word = {"pass": "pass", "fail": "FAIL", "inconclusive": "unclear"}.get(verdict.verdict, verdict.verdict)
    lines = [
        f"{word:<6} {result.key} on {report.row}{'':<8}attempt {attempt.number} of {len(result.attempts)}, {final}"
    ]
    lines += ["", f"  {result.title}"]
    if verdict.reason:
        lines += _wrapped(verdict.reason, "  ")
    for id_ in _concerned(result, verdict):
        lines += ["", *_requirement(requirements[id_], requirements, sources)]
    lines += ["", f"Script   {result.source:<62} T = {attempt.T_ns / 1e6:g} ms"]
    lines += [f"  {line}" for line in script_lines(trace.header.scenario)]
    lines += ["", "Timeline   ms after the start"]
    lines += render(timeline(trace, verdict.findings), trace.header.start)
    lines += ["", "Judgement", *_judgement(verdict)]
    lines += ["", f"Again      {again(report, result)}{options}", f"Trace      {report.row}/{attempt.trace}"]
    return "\n".join(lines)


def again(report: Played, result: ScenarioResult) -> str:
    """The one command that plays just that."""
    asked = report.asked or report.row
    named = asked if asked.startswith("--") else f"--backend {asked}"
    return f"nros-conformance run {named} --scenario {_quoted(result.key)}"


def failure(report: Played, result: ScenarioResult, requirements: Mapping[str, Requirement], options: str = "") -> str:
    """The block that a run prints for a failure, as soon as it is known. ``options`` as for `explain_scenario`."""
    verdict = result.last
    assert verdict is not None
    failed = verdict.failed()
    ids = sorted({id_ for finding in failed for id_ in finding.proves if requirements[id_].level == "must"})
    word = "known" if result.known else "FAIL"
    lines = [f"{word}  {report.row}  {result.key}   {', '.join(f'{id_} (must)' for id_ in ids)}".rstrip()]
    if ids:
        lines += _wrapped(requirements[ids[0]].statement, "  ")
    for finding in failed[:1]:
        lines += _wrapped(finding.wanted, "  wanted  ") + _wrapped(finding.got, "  got     ")
    if not failed:
        lines += _wrapped(verdict.reason, "  cause   ")
    lines += [
        f"  why     nros-conformance explain {report.row} {_quoted(result.key)}{options}",
        f"  again   {again(report, result)}{options}",
    ]
    return "\n".join(lines)


def script_lines(scenario: Mapping[str, Any]) -> list[str]:
    """The script, a step a line, in the words of the suite."""
    return [line for step in scenario.get("script", ()) for line in _step(step)]


def _step(step: Any, indent: str = "") -> Iterable[str]:
    if isinstance(step, str):
        return [indent + step]
    if "parallel" in step:
        lines = [f"{indent}side by side"]
        for branch in step["parallel"]:
            inner = [line for one in branch for line in _step(one, indent + "    ")]
            lines += [f"{indent}  - {inner[0].strip()}", *inner[1:]]
        return lines
    if isinstance(step.get("script"), list):
        about = {key: value for key, value in step.items() if key != "script"}
        return [*_step(about, indent), *(line for one in step["script"] for line in _step(one, indent + "    "))]
    head = f"{step['do']} " if "do" in step else ""
    rest = ", ".join(f"{key} {_value(value)}" for key, value in step.items() if key not in ("do", "as"))
    label = f"   ({step['as']})" if "as" in step else ""
    return [f"{indent}{head}{rest}{label}".rstrip()]


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_value(inner)}" for key, inner in value.items()) + "}"
    return str(value)


def _quoted(key: str) -> str:
    return f"'{key}'" if "[" in key else key


def _concerned(result: ScenarioResult, verdict: Verdict) -> list[str]:
    wrong = sorted({id_ for f in verdict.findings if f.outcome in ("fail", "unclear") for id_ in f.proves})
    return wrong or list(result.proves)


def _requirement(
    one: Requirement, requirements: Mapping[str, Requirement], sources: Mapping[str, str]
) -> list[str]:  # fmt: skip
    lines = _wrapped(f"{one.statement}", f"{one.id} ({one.level})  ", "  ")
    lines += _source(one, sources)
    if one.level == "must":
        heads = columns({each.id: each.level for each in requirements.values()})
        lines += [f"  counts in  {column.title}" for column in heads if one.id in column.musts]
    return lines


def _source(one: Requirement, sources: Mapping[str, str]) -> list[str]:
    """Where a requirement comes from, and what its abbreviations stand for."""
    lines = _wrapped(one.source, "  from       ")
    for short, long in sources.items():
        if re.search(rf"\b{re.escape(short)}\b", one.source):
            lines += _wrapped(f"{short}: {long}", " " * 13, " " * (15 + len(short)))
    return lines


def _judgement(verdict: Verdict) -> list[str]:
    lines: list[str] = []
    held = implied = absent = 0
    for finding in verdict.findings:
        if finding.outcome == "pass":
            implied += finding.implied
            held += not finding.implied
        elif finding.outcome == "none":
            absent += 1
        else:
            lines += _finding(finding)
    lines.append(f"  held       {many(held, 'expectation')} and {many(implied, 'invariant')}")
    if absent:
        lines.append(f"  no word    {many(absent, 'finding')} had nothing to judge")
    lines += [f"  warning    {text}" for text in verdict.warnings]
    return lines


def _finding(finding: Finding) -> list[str]:
    word = "FAIL" if finding.outcome == "fail" else finding.outcome
    lines = [f"  {word:<9}  {finding.name}   {', '.join(finding.proves)}".rstrip()]
    lines += _wrapped(finding.wanted, "  wanted     ")
    lines += _wrapped(finding.got, "  got        ")
    missed = []
    if finding.nearest_ns:
        missed.append(f"{abs(finding.nearest_ns) / 1e6:.1f} ms too {'late' if finding.nearest_ns > 0 else 'early'}")
    if finding.surplus:
        missed.append(f"{abs(finding.surplus)} too {'many' if finding.surplus > 0 else 'few'}")
    if missed:
        lines.append(f"  nearest    {', '.join(missed)}")
    return lines


def _wrapped(text: str, first: str, rest: str = "") -> list[str]:
    if not text:
        return []
    return textwrap.wrap(
        text, WIDTH, initial_indent=first, subsequent_indent=rest or " " * len(first),
        break_on_hyphens=False, break_long_words=False,
    )  # fmt: skip


def explain_word(word: str, table: Table | None = None) -> str | None:
    """A word of the legend, by its id or as it is printed, and which cells say so; None for another word."""
    for id_, (printed, means) in MEANINGS.items():
        if word in (id_, printed, printed.split()[0]):
            lines = _wrapped(
                f'{id_}   printed as "{printed}": {_plain(means)} {_ENDS.get(id_, "")}'.rstrip(), "", "    "
            )
            here = [] if table is None else [
                f"{row.name}/{cell.column}" + "".join(f" {key}" for key in cell.notes)
                for row in table.rows for cell in row.cells if cell.id == id_
            ]  # fmt: skip
            return "\n".join([*lines, *_wrapped(", ".join(here), "  in these results  ")])
    return None


_ENDS: Mapping[str, str] = {
    "deviates": "If [[known]] entries cover all of it the run ends with 0, otherwise with 1.",
    "broken": "The run ends with 1.",
    "unclaimed": "The run ends with 1.",
    "inconclusive": "The run ends with 8 if there are more than --max-unclear.",
}
"""What it does to the exit code, beside the word."""


def explain_note(key: str, table: Table) -> str | None:
    """A note of the matrix and the cells that lead to it; None when there is no such note."""
    note = next((one for one in table.notes if one.key == key), None)
    if note is None:
        return None
    cells = [f"{row.name}/{cell.column}" for row in table.rows for cell in row.cells if key in cell.notes]
    return "\n".join([*_wrapped(_plain(" ".join(note.texts)), f"{key}   ", "     "), "",
                      *_wrapped(", ".join(cells), "  cells    ")])  # fmt: skip


def _plain(markdown: str) -> str:
    """Without the marks of Markdown; a link becomes its address."""
    return re.sub(r"[*`]", "", re.sub(r"\[[^\]]*\]\(([^)]*)\)", r"\1", markdown))


def explain_requirement(
    one: Requirement, scenarios: Iterable[Loaded], reports: Iterable[Report],
    sources: Mapping[str, str] = MappingProxyType({}),
) -> str:  # fmt: skip
    """A requirement, the scenarios that prove it, and how each backend stands with it."""
    lines = _wrapped(one.statement, f"{one.id} ({one.level})  ", "  ")
    lines += _source(one, sources)
    if one.resolution:
        lines += _wrapped(one.resolution, "  conflict   ")
    proving = [
        each for each in scenarios if any(one.id in e.requirements for _, e in expectations(each.scenario))
    ]  # fmt: skip
    lines += ["", "Scenarios" if proving else "No scenario proves it."]
    lines += [f"  {each.key:<52} {each.source}" for each in proving]
    standing = [(report, evidence(report, {one.id: one.level})[one.id]) for report in reports if report.available]
    if standing:
        lines += ["", "Backends"]
        lines += [f"  {report.row:<12} {each.standing:<15} {each.reason}".rstrip() for report, each in standing]
    return "\n".join(lines)


def explain_cell(report: Report, column: str, table: Table) -> str:
    """A cell: what is declared, what was observed, rule by rule."""
    known = {one.id.lower(): one for one in table.columns} | {one.title.lower(): one for one in table.columns}
    head = known.get(column.lower())
    if head is None:
        raise ReportError(f"there is no column {column!r}; there is {', '.join(one.id for one in table.columns)}")
    row = next((one for one in (*table.rows, *table.control) if one.name == report.row), None)
    if row is None:
        raise ReportError(f"{report.row} has no row: {report.unavailable_reason}")
    cell = row.cell(head.id)
    lines = [f"{cell.text} ({cell.id})   {row.title}, {head.title}", "", *_wrapped(cell.reason, "  why        ")]
    if head.kind is not None:
        event = report.declaration.event(head.kind)
        lines += _wrapped(event.how or event.because, f"  declared   {event.claim}: ", " " * 13)
        lines += _observed(report, head.kind)
    for note in table.notes:
        if note.key in cell.notes:
            lines += _wrapped(_plain(" ".join(note.texts)), f"  {note.key:<9}  ", " " * 13)
    lines += ["", "Rules" if head.musts else "Scenarios"]
    for id_ in head.musts:
        one = row.found[id_]
        keys = one.scenarios("fail", "unclear") or one.scenarios("pass")
        shown = ", ".join(keys[:2]) + (f" and {len(keys) - 2} more" if len(keys) > 2 else "")
        lines.append(f"  {id_}  {one.standing:<15} {shown or one.reason}")
    if report.declaration.subject.not_:
        lines += ["", *_wrapped(f"anything about {report.declaration.subject.not_}", "Not said   ")]
    return "\n".join(lines)


def _observed(report: Report, kind: EventKind) -> list[str]:
    """What supports_event and registering answered on the right side, and how often the event was delivered."""
    lines = []
    for call, word in (("supports", "supports"), ("register", "register")):
        seen = [one for one in report.observations if (one.call, one.kind, one.case) == (call, kind, "right side")]
        answers = [
            f"{(str(bool(one.code)).lower() if call == 'supports' else code_name(one.code))}, {repeatedly(one.count)}"
            for one in seen
        ]  # fmt: skip
        lines += [f"  {word:<9}  answered {'; '.join(answers)}"] if answers else []
    plays = [result for result in report.results if result.attempts]
    number = sum(result.fired.get(int(kind), 0) for result in plays)
    came = many(number, "callback") if number else "nothing"
    return [*lines, f"  fired      {came}, in {many(len(plays), 'scenario')}"]
