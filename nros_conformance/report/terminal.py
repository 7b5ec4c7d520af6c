"""What a run prints, as text: the opening lines, the table of rows, what was known, unclear or left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol, TypeAlias

from nros_conformance.report.columns import Column
from nros_conformance.report.evidence import evidence
from nros_conformance.report.results import Report, ScenarioResult
from nros_conformance.report.table import Row, Table, assemble
from nros_conformance.rmw.declaration import Declaration
from nros_conformance.rmw.events import EventKind

Say: TypeAlias = Callable[[str], None]

_HEADS = {
    "LivelinessChanged": ("Liveliness", "changed"), "RequestedDeadlineMissed": ("Requested", "deadline"),
    "MessageLost": ("Message", "lost"), "LivelinessLost": ("Liveliness", "lost"),
    "OfferedDeadlineMissed": ("Offered", "deadline"), "base": ("Base", "rules"), "ping": ("Ping", ""),
    "reconnect": ("Recon-", "nect"), "hard_liveliness": ("Hard", "liv."), "pat.deadline-alarm": ("100 Hz,", "15 ms"),
}  # fmt: skip


class _Suites(Protocol):
    @property
    def version(self) -> str: ...
    @property
    def scenarios(self) -> Sequence[object]: ...


class _Selection(Protocol):
    @property
    def profile(self) -> str: ...
    @property
    def narrowed(self) -> bool: ...


def opening(version: str, suites: _Suites, selection: _Selection, chosen: int) -> str:
    """The first line of a run."""
    what = "selected" if selection.narrowed else f"profile {selection.profile}"
    return (
        f"nros-conformance {version}   suites {suites.version}   {what}: {chosen} of {len(suites.scenarios)} scenarios"
    )


def row_line(
    row: str, declaration: Declaration, versions: Mapping[str, str], virtual: bool, apply: int, chosen: int
) -> str:
    """What is about to be played, and how much of it applies."""
    tested = ", ".join(f"{name} {version}" for name, version in versions.items())
    clock = "virtual clock" if virtual else "real clock"
    parts = ", ".join(part for part in (tested, declaration.subject.kind, clock) if part)
    return f"{row:<8} {parts:<58} {apply} apply, {chosen - apply} do not"


def closing(reports: Sequence[Report], levels: Mapping[str, str], results: Path, selection: _Selection) -> str:
    """Everything after the last scenario."""
    available = [report for report in reports if report.available]
    lines = ["", *_counts(available)]
    if available:
        # Rows of the control are shown here too: somebody asked for them by name.
        lines += ["", *_cells(available, levels)]
    lines.append("")
    for report in reports:
        lines += _remarks(report, levels)
    lines.append(f"written  {results}/   " + ", ".join(f"{report.row}/report.json" for report in reports))
    lines += [f"partial  {report.row}: {report.why_partial}" for report in reports if report.partial]
    if not selection.narrowed and selection.profile != "publish":
        lines.append("next     nros-conformance matrix   (a published matrix needs --profile publish)")
    return "\n".join(lines)


def meaning(code: int, reports: Sequence[Report]) -> str:
    """Why the exit code is not 0, in one clause."""
    if code == 1:
        failed = [
            f"{report.row} {result.key}" for report in reports for result in report.results
            if result.verdict == "fail" and not result.known
        ]  # fmt: skip
        if failed:
            more = f" and {len(failed) - 1} more" if len(failed) > 1 else ""
            return f": a must fails that no [[known]] entry covers: {failed[0]}{more}"
        return ": declaration and behaviour differ"
    texts = {
        2: ": interrupted; what was judged is kept",
        3: ": the harness itself failed",
        4: ": something given cannot be used",
        5: ": a named backend is not available, or nothing was judged",
        8: ": more scenarios stayed unclear than --max-unclear allows",
    }
    return texts.get(code, "")


def _counts(reports: Sequence[Report]) -> list[str]:
    lines = [
        f"{'':<10}{'scenarios':>9}{'pass':>7}{'warn':>6}{'known':>7}{'FAIL':>6}{'unclear':>9}{'none':>6}{'time':>10}"
    ]
    for report in reports:
        played = [result for result in report.results if result.attempts]
        counts = Counter(_word(result) for result in played)
        lines.append(
            f"{report.row:<10}{len(played):>9}{counts['pass']:>7}{counts['warn']:>6}{counts['known']:>7}"
            f"{counts['fail']:>6}{counts['inconclusive']:>9}{counts['none']:>6}{report.seconds:>8.1f} s"
        )
    return lines


def _word(result: ScenarioResult) -> str:
    return "known" if result.verdict == "fail" and result.known else str(result.verdict)


def _cells(reports: Sequence[Report], levels: Mapping[str, str]) -> list[str]:
    shown: Table = assemble(reports, levels)
    rows = shown.rows or shown.control
    lines: list[str] = []
    for number in (1, 2):
        heads = [column for column in shown.columns if column.table == number]
        lines += ["", *_grid(rows, heads)] if lines else _grid(rows, heads)
    return lines


def _grid(rows: Sequence[Row], columns: Sequence[Column]) -> list[str]:
    widths = [max(11, *(len(row.cell(column.id).text) + 2 for row in rows), *_widths(column)) for column in columns]
    lines = []
    for line in (0, 1):
        texts = (f"{_head(column)[line]:<{width}}" for column, width in zip(columns, widths, strict=True))
        lines.append(f"{'':<10}{''.join(texts)}".rstrip())
    for row in rows:
        texts = (f"{row.cell(column.id).text:<{width}}" for column, width in zip(columns, widths, strict=True))
        lines.append(f"{row.name:<10}{''.join(texts)}".rstrip())
    return lines


def _head(column: Column) -> tuple[str, str]:
    """Two short lines: of a pattern, its first word and the others."""
    first, _, rest = column.title.partition(" ")
    return _HEADS.get(column.id, (first, rest))


def _widths(column: Column) -> Iterator[int]:
    return (len(text) + 1 for text in _head(column))


def _remarks(report: Report, levels: Mapping[str, str]) -> list[str]:
    if not report.available:
        return [f"missing  {report.row}: {report.unavailable_reason}; install it: {report.declaration.subject.install}"]
    claimed = sum(claim != "no" for claim in report.declaration.claims().values())
    lines = [f"claims   {report.row}: {claimed} of {len(EventKind)} events claimed"]
    for result in report.results:
        if result.verdict == "fail" and result.known:
            lines.append(f"known    {report.row} {result.key} ({result.known}) fails as declared")
        elif result.verdict == "inconclusive":
            tries = f"{len(result.attempts)} attempt" + ("s" if len(result.attempts) != 1 else "")
            lines.append(f"unclear  {report.row} {result.key}: {result.last.reason if result.last else ''} ({tries})")
        elif result.verdict == "warn":
            lines += [
                f"warn     {report.row} {result.key}: {text}" for text in (result.last.warnings if result.last else ())
            ]
        elif result.status == "untested":
            lines.append(f"untested {report.row} {result.key}: {result.reason}")
    lines += [f"differs  {difference.text}" for difference in report.differences]
    for incident in report.incidents:
        again = "" if incident.reproduced else "; not reproduced when each was played alone"
        lines.append(
            f"{incident.what:<8} {report.row}: {incident.detail}, with {', '.join(incident.scenarios)} in flight{again}"
        )
    unexercised = [one.requirement for one in evidence(report, levels).values() if one.applies and not one.exercised]
    musts = [id_ for id_ in unexercised if levels[id_] == "must"]
    if musts:
        lines.append(f"gaps     {report.row}: {len(musts)} musts that apply were not exercised: {_shorten(musts)}")
    return lines


def _shorten(ids: Sequence[str]) -> str:
    return ", ".join(ids[:6]) + (f" and {len(ids) - 6} more" if len(ids) > 6 else "")
