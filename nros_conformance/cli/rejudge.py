"""``nros-conformance rejudge``: every published cell can be derived again from stored traces."""

from __future__ import annotations

import argparse
from pathlib import Path

import msgspec

from nros_conformance.cli.codes import ExitCode
from nros_conformance.formats.counts import many
from nros_conformance.judge.judge import judge
from nros_conformance.report.differences import differences
from nros_conformance.report.results import Attempt, Report, ScenarioResult, read_reports, write_report
from nros_conformance.suite.loader import load_suites
from nros_conformance.trace.files import read_trace


def run(options: argparse.Namespace) -> ExitCode:
    """Judge all stored traces again, say what changed, and store the new verdicts."""
    directory = options.directory or options.results
    levels = load_suites(options.suites).levels
    changed = judged = 0
    failed = False
    for report in read_reports(directory):
        results = []
        for result in report.results:
            fresh = _rejudge(report, result, directory)
            judged += len(fresh.attempts)
            if fresh.verdict != result.verdict:
                changed += 1
                print(f"{report.row} {result.key}: was {result.verdict}, is {fresh.verdict}")
            results.append(fresh)
        new = msgspec.structs.replace(report, results=tuple(results))
        new = msgspec.structs.replace(new, differences=tuple(differences(new, levels)))
        failed |= bool(new.differences) or any(one.verdict == "fail" and not one.known for one in results)
        write_report(directory, new)
    print(f"{many(judged, 'trace')} judged again, {many(changed, 'verdict')} changed")
    return ExitCode.FAILED if failed else ExitCode.OK


def _rejudge(report: Report, result: ScenarioResult, directory: Path) -> ScenarioResult:
    attempts = []
    for attempt in result.attempts:
        verdict = judge(read_trace(directory / report.row / attempt.trace))
        attempts.append(
            Attempt(
                number=attempt.number, T_ns=attempt.T_ns, trace=attempt.trace, verdict=verdict, seconds=attempt.seconds
            )
        )  # fmt: skip
    if not attempts:
        return result
    return msgspec.structs.replace(result, attempts=tuple(attempts), verdict=attempts[-1].verdict.verdict)
