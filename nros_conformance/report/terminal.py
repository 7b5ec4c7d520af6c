"""What a run prints, as text: the opening lines, the table of rows, what was known, unclear or left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol, TypeAlias

from nros_conformance.formats.counts import many
from nros_conformance.report.columns import Column
from nros_conformance.report.evidence import evidence
from nros_conformance.report.results import NARROWED, Control, Report, ScenarioResult, Status
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


_NAME = 8
"""Characters of a row's name at least: those of the words that stand before other lines."""

_SHOWN = 2
"""Scenarios that are named when many were not played for one reason."""


_LISTED = 12
"""Scenarios that passed are listed up to so many."""


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
    row: str, declaration: Declaration, versions: Mapping[str, str], virtual: bool, apply: int, chosen: int,
    width: int = _NAME,
) -> str:  # fmt: skip
    """What is about to be played, and how much of it applies. ``width``: characters of the longest name."""
    tested = ", ".join(f"{name} {version}" for name, version in versions.items())
    clock = "virtual clock" if virtual else "real clock"
    parts = ", ".join(part for part in (tested, declaration.subject.kind, clock) if part)
    return f"{row:<{max(width, _NAME)}} {parts:<58} {apply} apply, {chosen - apply} do not"


def closing(
    reports: Sequence[Report], levels: Mapping[str, str], results: Path, selection: _Selection,
    apart: Collection[str] = (), options: str = "",
) -> str:  # fmt: skip
    """Everything after the last scenario.

    ``apart``: rows whose results do not replace those of a whole run. ``options``: of the command, to be
    repeated in its hints.
    """
    available = [report for report in reports if report.available]
    lines = ["", *_counts(available)] if available else []
    # The control has no cells, and a few scenarios decide none.
    if any(not report.declaration.control for report in available) and not selection.narrowed:
        lines += ["", *_cells(available, levels)]
    lines.append("")
    for report in reports:
        if selection.narrowed and report.available:
            lines += _named(report)
        lines += _remarks(report, levels, gaps=not selection.narrowed)
    files = (f"{NARROWED}/{report.row}" if report.row in apart else report.row for report in reports)
    lines.append(f"written  {results}/   " + ", ".join(f"{file}/report.json" for file in files))
    lines += [f"kept     {results}/{row}: the results of the last whole run" for row in apart]
    lines += [f"partial  {report.row}: {report.why_partial}" for report in reports if report.partial]
    if not selection.narrowed and selection.profile != "publish":
        lines.append(f"next     nros-conformance matrix{options}   (a published matrix needs --profile publish)")
    return "\n".join(lines)


def without_control(control: Control) -> str:
    """Why nothing was played: a run that cannot be shown to fail proves nothing."""
    if "unclear" in control.planted:
        return "exit 3: this host was too busy for the control, so nothing was played; run again when it is less loaded"
    if control.planted:
        return "exit 3: a planted defect went unnoticed, so nothing was played; please report it with the lines above"
    return (
        "exit 3: the reference does not pass, so nothing was played; with suites of your own mend the scenario "
        "that the control names, else please report it"
    )


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
        5: ": no scenario that was selected applies"
        if _nothing_applied(reports)
        else ": a named backend is not available, or nothing was judged",
        8: ": more scenarios stayed unclear than --max-unclear allows",
    }
    return texts.get(code, "")


def _nothing_applied(reports: Sequence[Report]) -> bool:
    results = [result for report in reports for result in report.results]
    return bool(results) and all(result.status == "not-applicable" for result in results)


def _counts(reports: Sequence[Report]) -> list[str]:
    name = _name(report.row for report in reports)
    lines = [f"{'':<{name}}scenarios   pass  warn  known  FAIL  unclear  none      time"]
    for report in reports:
        played = [result for result in report.results if result.attempts]
        counts = Counter(_word(result) for result in played)
        lines.append(
            f"{report.row:<{name}}{len(played):>9}{counts['pass']:>7}{counts['warn']:>6}{counts['known']:>7}"
            f"{counts['fail']:>6}{counts['inconclusive']:>9}{counts['none']:>6}{report.seconds:>8.1f} s"
        )
    return lines


def _name(names: Iterable[str]) -> int:
    """The width of a column of names, with the gap behind it."""
    return max([_NAME, *map(len, names)]) + 2


def _word(result: ScenarioResult) -> str:
    return "known" if result.verdict == "fail" and result.known else str(result.verdict)


def _cells(reports: Sequence[Report], levels: Mapping[str, str]) -> list[str]:
    shown: Table = assemble(reports, levels)
    rows = shown.rows
    lines: list[str] = []
    for number in (1, 2):
        heads = [column for column in shown.columns if column.table == number]
        lines += ["", *_grid(rows, heads)] if lines else _grid(rows, heads)
    return lines


def _grid(rows: Sequence[Row], columns: Sequence[Column]) -> list[str]:
    name = _name(row.name for row in rows)
    widths = [max(11, *(len(row.cell(column.id).text) + 2 for row in rows), *_widths(column)) for column in columns]
    grid = [("", [_head(column)[line] for column in columns]) for line in (0, 1)]
    grid += [(row.name, [row.cell(column.id).text for column in columns]) for row in rows]
    return [
        f"{first:<{name}}{''.join(f'{text:<{width}}' for text, width in zip(texts, widths, strict=True))}".rstrip()
        for first, texts in grid
    ]


def _head(column: Column) -> tuple[str, str]:
    """Two short lines: of a pattern, its first word and the others."""
    first, _, rest = column.title.partition(" ")
    return _HEADS.get(column.id, (first, rest))


def _widths(column: Column) -> Iterator[int]:
    return (len(text) + 2 for text in _head(column))


def _remarks(report: Report, levels: Mapping[str, str], *, gaps: bool = True) -> list[str]:
    if not report.available:
        return [f"missing  {report.row}: {report.unavailable_reason}; install it: {report.declaration.subject.install}"]
    claimed = sum(claim != "no" for claim in report.declaration.claims().values())
    lines = [f"claims   {report.row}: {claimed} of {len(EventKind)} events claimed"]
    for result in report.results:
        if result.verdict == "fail" and result.known:
            lines.append(f"known    {report.row} {result.key} ({result.known}) fails as declared")
        elif result.verdict == "inconclusive":
            tries = many(len(result.attempts), "attempt")
            lines.append(f"unclear  {report.row} {result.key}: {result.last.reason if result.last else ''} ({tries})")
        elif result.verdict == "warn":
            lines += [
                f"warn     {report.row} {result.key}: {text}" for text in (result.last.warnings if result.last else ())
            ]
    lines += _left_out(report, "untested", "untested")
    lines += [f"differs  {difference.text}" for difference in report.differences]
    for incident in report.incidents:
        again = "" if incident.reproduced else "; not reproduced when each was played alone"
        lines.append(
            f"{incident.what:<8} {report.row}: {incident.detail}, with {', '.join(incident.scenarios)} in flight{again}"
        )
    unexercised = [one.requirement for one in evidence(report, levels).values() if one.applies and not one.exercised]
    musts = [id_ for id_ in unexercised if levels[id_] == "must"]
    if musts and gaps:
        number = "1 must that applies was" if len(musts) == 1 else f"{len(musts)} musts that apply were"
        lines.append(f"gaps     {report.row}: {number} not exercised: {_shorten(musts)}")
    return lines


def _named(report: Report) -> Iterator[str]:
    """Of scenarios that were asked for: each that passed, and why others do not apply."""
    passed = [result for result in report.results if result.verdict == "pass"]
    if len(passed) <= _LISTED:
        yield from (f"pass     {report.row} {result.key}   {', '.join(result.proves)}" for result in passed)
    yield from _left_out(report, "not-applicable", "n/a")


def _left_out(report: Report, status: Status, word: str) -> Iterator[str]:
    """One line per reason; each scenario with its reason stands in the report, and `explain` shows it."""
    reasons: dict[str, list[str]] = {}
    for result in report.results:
        if result.status == status:
            reasons.setdefault(result.reason, []).append(result.id)
    for reason, ids in reasons.items():
        names = list(dict.fromkeys(ids))
        shown = ", ".join(names[:_SHOWN]) + (", ..." if len(names) > _SHOWN else "")
        yield f"{word:<8} {report.row}: {many(len(ids), 'scenario')}, {reason} ({shown})"


def _shorten(ids: Sequence[str]) -> str:
    return ", ".join(ids[:6]) + (f" and {len(ids) - 6} more" if len(ids) > 6 else "")
