"""Reports merged into the published table: rows, columns, cells, notes. Matrix and web page print it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from msgspec import Struct

from nros_conformance.report import cells, notes
from nros_conformance.report.cells import Cell
from nros_conformance.report.columns import Column, columns
from nros_conformance.report.evidence import Evidence, evidence
from nros_conformance.report.markdown import prose
from nros_conformance.report.notes import Keys, Note
from nros_conformance.report.results import Report, ReportError, same_suites

_BUILT_IN = "nros_backends."


class Row(Struct, frozen=True, kw_only=True):
    """One backend, or one variant of it."""

    name: str
    title: str
    report: Report
    found: dict[str, Evidence]
    """By requirement, as `evidence` orders it."""
    cells: tuple[Cell, ...]
    keys: Keys

    def cell(self, column: str) -> Cell:
        """The cell of a column."""
        return next(cell for cell in self.cells if cell.column == column)

    def must(self) -> list[Evidence]:
        """The musts that apply."""
        return [one for one in self.found.values() if one.level == "must" and one.applies]


class Table(Struct, frozen=True, kw_only=True):
    """All that is printed."""

    requirements: dict[str, str]
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    control: tuple[Row, ...]
    """Reports of the reference: it has no row of its own."""
    unavailable: tuple[Report, ...]
    notes: tuple[Note, ...]
    """Those whose key is printed somewhere."""

    @property
    def reports(self) -> tuple[Report, ...]:
        """What was played, the reference last."""
        return tuple(row.report for row in (*self.rows, *self.control))


def merge(reports: Iterable[Report]) -> tuple[Report, ...]:
    """Reports in the order of their rows: built-in backends first, then by name.

    Raises `ReportError` for different suites, and for two reports on one row.
    """
    ordered = sorted(reports, key=_place)
    for row, times in Counter(report.row for report in ordered).items():
        if times > 1:
            raise ReportError(f"{times} reports on {row}; keep one of them")
    same_suites({report.row: report for report in ordered})
    return tuple(ordered)


def assemble(reports: Iterable[Report], requirements: Mapping[str, str]) -> Table:
    """The table of these reports. ``requirements``: id to level, in the order of the catalogue.

    Raises `ReportError`, also when there is no backend but the control.
    """
    merged = merge(reports)
    if all(report.declaration.control for report in merged):
        raise ReportError("nothing to print: there is no report of any backend but the control")
    required = dict(sorted(requirements.items()))
    shown = [report for report in merged if report.available and not report.declaration.control]
    control = [report for report in merged if report.available and report.declaration.control]
    heads = columns(required, merged)
    found = {report.row: evidence(report, required) for report in merged if report.available}
    keys, all_notes = notes.assign([(report, found[report.row]) for report in shown])
    titles = _titles(shown)
    rows = tuple(_row(report, titles[report.row], found[report.row], heads, keys[report.row]) for report in shown)
    used = {key for row in rows for key in _keys(row)}
    return Table(
        requirements=required,
        columns=heads,
        rows=rows,
        control=tuple(_row(one, one.declaration.title, found[one.row], heads, notes.NO_KEYS) for one in control),
        unavailable=tuple(report for report in merged if not report.available and not report.declaration.control),
        notes=tuple(note for note in all_notes if note.key in used),
    )


def _row(report: Report, title: str, found: dict[str, Evidence], heads: tuple[Column, ...], keys: Keys) -> Row:
    return Row(
        name=report.row, title=title, report=report, found=found, keys=keys,
        cells=cells.cells(report, found, heads, keys),
    )  # fmt: skip


def _keys(row: Row) -> Iterable[str]:
    for cell in row.cells:
        yield from cell.notes
    for one in row.found.values():
        if one.level != "must" and one.broken:
            yield from row.keys.violations.get(one.requirement, ())


def _place(report: Report) -> tuple[bool, str, str]:
    return not report.declaration.adapter.startswith(_BUILT_IN), report.backend, report.variant


def _titles(reports: list[Report]) -> dict[str, str]:
    """By row. Titles that two rows share are told apart by the row's name."""
    titles = {one.row: _title(one) for one in reports}
    counts = Counter(titles.values())
    return {row: title if counts[title] == 1 else f"{title} [{row}]" for row, title in titles.items()}


def _title(report: Report) -> str:
    """Of a variant with what it calls itself, in brackets: titles stand in lists with commas."""
    variant, declaration = report.variant, report.declaration
    says = declaration.variants.get(variant, {}).get("title", variant)
    return f"{declaration.title} ({says})" if says else declaration.title


def label(row: Row, number: int) -> str:
    """The first cell of a row in Markdown; the first table also says what ran."""
    title = f"**{prose(row.title)}**"
    return f"{title}, {row.report.declaration.subject.kind}" if number == 1 else title


def shown(cell: Cell) -> str:
    """A cell in Markdown, with the keys of its notes."""
    text = f"**{cell.text}**" if cell.strong else cell.text
    return " ".join([text, *(f"`{key}`" for key in cell.notes)])
