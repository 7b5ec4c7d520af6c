"""``nros-conformance mutants``."""

from __future__ import annotations

import argparse
import sys

import msgspec

from nros_conformance.cli.codes import ExitCode
from nros_conformance.cli.progress import ProgressLine
from nros_conformance.explore.mutation import run_mutants
from nros_conformance.formats.places import nearest
from nros_conformance.report.mutation import MutantResult, MutationReport, write_mutation
from nros_conformance.rmw.discovery import BackendNotFound
from nros_conformance.rmw.mutants import find_mutants
from nros_conformance.suite.loader import load_suites


def run(options: argparse.Namespace) -> ExitCode:
    """Play, report, store; exit 1 when one survives that violates a must, or a must has none."""
    suites = load_suites(options.suites)
    known = [one.name for one in find_mutants().get(options.backend, ())]
    if not known:
        raise BackendNotFound(f"the backend {options.backend!r} has no mutants")
    for name in options.mutant:
        if name not in known:
            raise BackendNotFound(f"no mutant {name!r}; {nearest(name, known)}")
    total = len(options.mutant or known)
    line, done, survived = ProgressLine(sys.stderr), 0, False

    def watch(result: MutantResult) -> None:
        nonlocal done, survived
        done += 1
        survived |= not result.killed_by
        line.update("mutants", done, total, failed=survived)

    report = run_mutants(suites, options.backend, only=options.mutant, watch=watch)
    line.clear()
    if options.json:
        print(msgspec.json.format(msgspec.json.encode(report), indent=1).decode())
    else:
        print(told(report, suites.levels, whole=not options.mutant))
    if not options.mutant:  # a part must not become the published score
        file = write_mutation(options.results, report)
        if not options.json:
            print(f"written  {file}")
    return decided(report, suites.levels, whole=not options.mutant)


def decided(report: MutationReport, levels: dict[str, str], *, whole: bool = True) -> ExitCode:
    """FAILED when a mutant survives that violates a must, or, of a whole run, when a must has no mutant."""
    survives = any(levels.get(one.violates) == "must" for one in report.survivors)
    lacking = whole and any(levels[id_] == "must" for id_ in report.unexercised(levels))
    return ExitCode.FAILED if survives or lacking else ExitCode.OK


def told(report: MutationReport, levels: dict[str, str], *, whole: bool = True) -> str:
    """The report as text: one line per mutant, then survivors and requirements without one."""
    width = max(len(one.name) for one in report.mutants)
    lines = []
    for one in report.mutants:
        fate = f"killed    {one.killed_by}" if one.killed_by else f"SURVIVES  {one.played} scenarios played"
        lines.append(f"{one.name:<{width}}  {one.violates}  {one.defect or '-':<9}  {fate}")
    killed = len(report.mutants) - len(report.survivors)
    lines += ["", f"{killed} of {len(report.mutants)} mutants are killed   {report.seconds:.1f} s"]
    lines += [
        f"survives  {one.name}: {one.says} ({one.violates}, {levels.get(one.violates)})" for one in report.survivors
    ]
    if whole and (without := list(report.unexercised(levels))):
        lines.append(f"no mutant violates {', '.join(without)}")
    return "\n".join(lines)
