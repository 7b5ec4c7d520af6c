"""``nros-conformance matrix``."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

from nros_conformance.cli.codes import ExitCode
from nros_conformance.report import badges
from nros_conformance.report.changes import changes, of_table, read_old
from nros_conformance.report.matrix import check, render
from nros_conformance.report.mutation import stored_scores
from nros_conformance.report.results import Report, ReportError, read_reports, same_suites
from nros_conformance.report.table import assemble
from nros_conformance.report.web import page
from nros_conformance.suite.loader import Suites, load_suites
from nros_conformance.suite.published import Published, load_published

_BLOCK = re.compile(r"(<!-- matrix: table[^>]*-->\n).*?(<!-- /matrix -->)", re.DOTALL)
_TABLE = re.compile(r"<!-- ANCHOR: table -->\n(\|.*?)\n\n", re.DOTALL)


def run(options: argparse.Namespace) -> ExitCode:
    """Merge the reports and write the table; with ``--check`` or ``--diff`` compare it instead."""
    suites = load_suites(options.suites)
    reports = read_reports(options.results)
    _same_suites_as_here(reports[0].digest, suites, options.results)
    same_suites({report.row: report for report in reports})
    if options.diff is not None:
        print(
            changes(
                read_old(options.diff, suites.levels), of_table(assemble(reports, suites.levels)), str(options.diff)
            )
        )
        return ExitCode.OK
    published = load_published(suites.directory, suites.levels)
    if options.check:
        return _check(options, reports, suites, published)
    mutation, stale = stored_scores(options.results, suites.digest)
    if stale:
        print(f"left out {stale}")
    text = render(reports, suites.levels, mutation=mutation, published=published)
    options.output.write_text(text, encoding="utf-8")
    print(f"written  {options.output}")
    if options.html is not None:
        options.html.parent.mkdir(parents=True, exist_ok=True)
        options.html.write_text(
            page(reports, suites.levels, statements=_statements(suites), mutation=mutation, published=published),
            encoding="utf-8",
        )
        print(f"written  {options.html}")
    if options.readme is not None:
        readme = options.readme.read_text(encoding="utf-8")
        options.readme.write_text(_with_table(options.readme, readme, text), encoding="utf-8")
        print(f"written  {options.readme}")
    if options.badges is not None:
        _write_badges(options.badges, text)
    return ExitCode.OK


def _write_badges(folder: Path, text: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in badges.files(text).items():
        (folder / name).write_text(content, encoding="utf-8")
    print(f"written  {folder}/   " + ", ".join(f"{name}.svg" for name in badges.badges(text)))


def _check(
    options: argparse.Namespace, reports: Sequence[Report], suites: Suites, published: Published | None
) -> ExitCode:
    try:
        existing = options.output.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ReportError(f"{options.output}: there is no such file; write it: nros-conformance matrix") from None
    differences = check(existing, reports, suites.levels, published=published)
    if options.readme is not None:
        readme = options.readme.read_text(encoding="utf-8")
        if _with_table(options.readme, readme, existing) != readme:
            differences.append(f"{options.readme}: its table is not the one of {options.output}")
    if options.badges is not None:
        differences += badges.stale(options.badges, existing)
    for difference in differences:
        print(difference)
    if differences:
        print(f"\n{options.output} is not what was observed; write it again: nros-conformance matrix")
        return ExitCode.FAILED
    print(f"{options.output} is what was observed")
    return ExitCode.OK


def _with_table(file: Path, readme: str, matrix: str) -> str:
    """The README with the first table of the matrix between its markers."""
    table = _TABLE.search(matrix)
    if table is None or not _BLOCK.search(readme):
        raise ReportError(f"{file}: no place for the table; add: <!-- matrix: table --> and <!-- /matrix -->")
    return _BLOCK.sub(lambda match: f"{match[1]}{table[1]}\n{match[2]}", readme)


def _statements(suites: Suites) -> dict[str, str]:
    return {one.id: one.statement for one in suites.requirements}


def _same_suites_as_here(digest: str, suites: Suites, results: Path) -> None:
    if digest != suites.digest:
        raise ReportError(
            f"{results}: these results are on other suites ({digest}) than those here ({suites.digest}); run again"
        )
