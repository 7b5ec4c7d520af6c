"""``nros-conformance explain``: a scenario, a cell, a requirement, or a word of the legend."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import NamedTuple

from nros_conformance.cli.codes import ExitCode, repeated
from nros_conformance.formats.places import nearest
from nros_conformance.play.peer import LOG
from nros_conformance.report.explain import (
    explain_cell,
    explain_note,
    explain_requirement,
    explain_scenario,
    explain_word,
)
from nros_conformance.report.picture import svg
from nros_conformance.report.results import Report, ReportError, ScenarioResult, read_latest, read_reports
from nros_conformance.report.table import assemble
from nros_conformance.report.timeline import timeline
from nros_conformance.suite.loader import Suites, load_suites
from nros_conformance.trace.files import read_trace


def run(options: argparse.Namespace) -> ExitCode:
    """Find out what the subject is, and print its explanation."""
    suites = load_suites(options.suites)
    subject: list[str] = options.subject
    if len(subject) > 2:
        raise ReportError(
            "explain takes [BACKEND] SCENARIO, BACKEND/COLUMN, a requirement, a note key, or a word of the legend"
        )
    word = subject[-1]
    # A scenario's name has a dot and a cell's a slash: no need to read all reports for it first.
    text = _term(options, suites, word) if len(subject) == 1 and not {".", "/"} & set(word) else None
    if text is None and "/" in word and "." not in word.partition("/")[0]:
        row, _, column = word.partition("/")
        reports = read_reports(options.results)
        text = explain_cell(_row(reports, row), column, assemble(reports, suites.levels))
    if text is not None and options.svg is not None:
        raise ReportError("a picture is of one scenario: explain [BACKEND] SCENARIO --svg FILE")
    print(text if text is not None else _scenario(options, suites, subject))
    return ExitCode.OK


def _term(options: argparse.Namespace, suites: Suites, word: str) -> str | None:
    """A requirement, a word of the legend or the key of a note; None for anything else."""
    reports = _reports_or_none(options)
    if word in suites.levels:
        return explain_requirement(
            suites.requirements[word], suites.scenarios, reports, suites.requirements.sources
        )  # fmt: skip
    rows = any(report.available and not report.declaration.control for report in reports)
    table = assemble(reports, suites.levels) if rows else None
    note = explain_note(word, table) if table is not None else None
    return note if note is not None else explain_word(word, table)


def _reports_or_none(options: argparse.Namespace) -> Sequence[Report]:
    try:
        return read_reports(options.results)
    except ReportError:
        return ()


def _scenario(options: argparse.Namespace, suites: Suites, subject: Sequence[str]) -> str:
    stored = read_latest(options.results)
    if len(subject) == 2:
        row = _row([report for _, report in stored], subject[0]).row
        stored = tuple(one for one in stored if one[1].row == row)
    results = [_Stored(folder, report, result) for folder, report in stored for result in report.results]
    wanted = subject[-1]
    found = [one for one in results if wanted in (one.result.id, one.result.key)]
    if not found:
        found = [one for one in results if fnmatchcase(one.result.key, wanted.replace("[", "[[]"))]
    if not found:
        hint = nearest(wanted, sorted({one.result.id for one in results}))
        raise ReportError(f"nothing was played that is called {wanted!r}" + (f"; {hint}" if "did you" in hint else ""))
    latest = list({(one.report.row, one.result.key): one for one in reversed(found)}.values())[::-1]
    # Of several parameters and backends, what went wrong is what somebody wants to know.
    order = {"fail": 0, "error": 0, "inconclusive": 1, "warn": 2, "pass": 3}
    return _explained(
        options, suites, min(latest, key=lambda one: order.get(one.result.verdict or "", 4)), len(latest)
    )  # fmt: skip


class _Stored(NamedTuple):
    """A result and the results directory that it stands in."""

    folder: Path
    report: Report
    result: ScenarioResult


def _explained(options: argparse.Namespace, suites: Suites, stored: _Stored, alike: int) -> str:
    folder, report, result = stored
    if not result.attempts:
        return f"{result.status}   {result.key} on {report.row}\n\n  {result.title}\n  {result.reason}"
    attempt = result.attempts[-1]
    trace = read_trace(folder / report.row / attempt.trace)
    text = explain_scenario(
        report, result, attempt, trace, {one.id: one for one in suites.requirements}, repeated(options),
        suites.requirements.sources,
    )  # fmt: skip
    peer = Path(f"{attempt.trace}.d") / LOG
    if attempt.verdict.verdict != "pass" and (folder / report.row / peer).is_file():
        text += f"\nPeer       {report.row}/{peer.as_posix()}: what the agent, router or broker has printed"
    if options.svg is not None:
        rows = timeline(trace, attempt.verdict.findings)
        title = f"{result.key} on {report.row}: {attempt.verdict.verdict}"
        options.svg.write_text(svg(rows, trace.header.start, title), encoding="utf-8")
        text += f"\nPicture    {options.svg}"
    others = f"\nOthers     {alike - 1} more with other parameters or on other backends" if alike > 1 else ""
    return text + others


def _row(reports: Sequence[Report], name: str) -> Report:
    for report in reports:
        if report.row == name:
            return report
    rows = [report.row for report in reports]
    raise ReportError(f"there is no result of {name!r}; there is {', '.join(rows)}")
