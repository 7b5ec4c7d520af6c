"""``matrix --check``: whether a published ``matrix.md`` still says what reports show.

Only conclusive observations count: what this run could not decide or exercise contradicts nothing,
and versions are ignored.

Of the section beside a table that others have published, the part that rests on that table alone has to
be there as it is. The rest follows from cells, which are compared by themselves; it is compared as well
when these cells say the same, so that nobody edits it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping

from msgspec import Struct

from nros_conformance.report import codes, printed
from nros_conformance.report import published as beside
from nros_conformance.report.cells import DEGREE, Cell
from nros_conformance.report.columns import Column
from nros_conformance.report.evidence import Evidence
from nros_conformance.report.markdown import prose
from nros_conformance.report.results import Report
from nros_conformance.report.table import Row, Table, assemble, shown
from nros_conformance.suite.published import Published

_KEY = re.compile(r"`([^`]+)`")
_COUNT = re.compile(r"(?:(?P<n>\d+)/)?(?P<m>\d+)")
_REQUIREMENT = re.compile(r"[A-Z]{3}-\d{3}")
_SHOWN_BY = re.compile(r" Shown by (?P<scenarios>`[^`]+`(?:, `[^`]+`)*)\.")
_KNOWN_IN = re.compile(r"Known in [^;]*;")
_SHOULD = "*Should*-level findings"


class _Printed(Struct, frozen=True):
    """A cell of the published table, taken apart."""

    word: str
    rules: str
    keys: frozenset[str]


def check(
    existing: str, reports: Iterable[Report], requirements: Mapping[str, str], *, published: Published | None = None
) -> list[str]:
    """What the text of a ``matrix.md`` says otherwise than these reports; empty when nothing.

    ``published`` as for `matrix.render`. Raises `ReportError` for reports that do not merge.
    """
    table = assemble(reports, requirements)
    old = printed.rows(existing)
    if not old:
        return ["there is no table in it; write it with: nros-conformance matrix"]
    notes = printed.notes(existing)
    found: list[str] = []
    for row in table.rows:
        cells = old.get(prose(row.title))
        if cells is None:
            found.append(f"{row.title}: no such row is published")
        else:
            found += _row(row, table, cells, notes)
    found += _rows_without_report(old, table)
    found += _notes(notes, table)
    found += _codes(existing, table)
    found += _should(existing, table)
    if published is not None and table.rows:
        found += _beside(existing, table, published)
    return found


def _row(row: Row, table: Table, published: Mapping[str, str], notes: Mapping[str, str]) -> Iterator[str]:
    kind = row.report.declaration.subject.kind
    if published.get(printed.RAN) != kind:
        yield f"{row.title}: published as {published.get(printed.RAN, 'nothing')}, this is {kind}"
    for column in table.columns:
        cell, old = row.cell(column.id), published.get(prose(column.title))
        if old is None:
            yield f"{row.title}: no column {column.title} is published"
        elif _contradicts(old, cell, row, column, notes):
            yield f'{row.title}, {column.title}: published "{old}", observed "{shown(cell)}"'


def _contradicts(old: str, cell: Cell, row: Row, column: Column, notes: Mapping[str, str]) -> bool:
    new = shown(cell)
    if cell.id in ("inconclusive", "no_evidence") or old == new:
        return False
    rules = [row.found[must] for must in column.musts]
    if all(rule.exercised for rule in rules if rule.applies):
        return True
    # Less was exercised than when the table was written: only what was exercised can contradict it.
    before, after = _read(old), _read(new)
    lost = {one for key in before.keys - after.keys for one in _REQUIREMENT.findall(notes.get(key, ""))}
    if any(row.found[one].exercised for one in lost if one in row.found) or not after.keys <= before.keys:
        return True
    if before.word == after.word:
        return before.rules != after.rules
    return not (lost and cell.id in ("verified", "reduced"))


def _read(text: str) -> _Printed:
    keys = frozenset(_KEY.findall(text))
    plain = _KEY.sub("", text).replace("**", "").strip()
    count = _COUNT.search(plain)
    return _Printed(
        word=_COUNT.sub("", plain).replace(DEGREE, "").strip(),
        rules=count["m"] if count else "",
        keys=keys,
    )


def _rows_without_report(published: Iterable[str], table: Table) -> Iterator[str]:
    titles = {prose(row.title) for row in table.rows}
    absent = tuple(prose(report.declaration.title) for report in table.unavailable)
    for title in published:
        if title not in titles and not any(title == one or title.startswith(f"{one} (") for one in absent):
            yield f"{title}: published, but there is no report on it"


def _notes(published: Mapping[str, str], table: Table) -> Iterator[str]:
    for note in table.notes:
        old, new = published.get(note.key), " ".join(note.texts)
        if old is None:
            continue  # a key that is not published shows in its cell
        same = _without_details(old) == _without_details(new)
        if not same or not _scenarios(new) <= _scenarios(old):
            yield f"note {note.key}: published {old!r}, now {new!r}"


def _without_details(text: str) -> str:
    return _KNOWN_IN.sub("Known;", _SHOWN_BY.sub("", text))


def _scenarios(text: str) -> frozenset[str]:
    return frozenset(key for match in _SHOWN_BY.finditer(text) for key in _KEY.findall(match["scenarios"]))


def _codes(existing: str, table: Table) -> Iterator[str]:
    published = printed.return_codes(existing)
    for row in table.rows:
        old = published.get(prose(row.title), {})
        for name, new in zip(codes.HEADER[1:], codes.rows(row.report), strict=True):
            before, after = old.get(name, codes.NONE), new
            if _codes_differ(before, after):
                yield f'{row.title}, return codes, {name}: published "{before}", observed "{after}"'


def _codes_differ(before: str, after: str) -> bool:
    old, new = before.split(", "), after.split(", ")
    if all(one == codes.NONE for one in new):
        return False
    if len(old) != len(new):
        return True
    return any(one not in (codes.NONE, two) for two, one in zip(old, new, strict=True))


def _should(existing: str, table: Table) -> Iterator[str]:
    line = next((line for line in existing.splitlines() if line.startswith(_SHOULD)), "")
    for row in table.rows:
        for one in row.found.values():
            if one.level == "must":
                continue
            published = bool(re.search(rf"(?:: |, ){re.escape(prose(row.title))} {one.requirement} ", line))
            if one.broken and not published:
                yield f"{row.title}: the finding on {one.requirement} (should) is not published"
            elif published and one.standing == "holds":
                yield f"{row.title}: the finding on {one.requirement} (should) is published, but it holds"


def _beside(existing: str, table: Table, published: Published) -> Iterator[str]:
    old = printed.section(existing, beside.TITLE)
    if not old:
        yield f'there is no section "{beside.TITLE}" in it'
        return
    new = printed.section(beside.section(table, published), beside.TITLE)
    rows = printed.rows(existing)
    same_rows = set(rows) == {prose(row.title) for row in table.rows}
    if not (same_rows and _same_cells(rows, table, published)):
        lasting = [beside.not_run(published), *([beside.intro(table, published)] if same_rows else ())]
        new = [line for line in new if line in lasting]
        old = [line for line in old if line in new]
    yield from (f"{beside.TITLE.lower()}: published {line!r}, which is not so" for line in old if line not in new)
    yield from (f"{beside.TITLE.lower()}: not published: {line!r}" for line in new if line not in old)


def _same_cells(rows: Mapping[str, Mapping[str, str]], table: Table, published: Published) -> bool:
    """Whether all cells that are compared are printed as they were observed, and what decides was exercised."""
    titles = {column.kind: prose(column.title) for column in table.columns}
    return all(
        rows[prose(one.row.title)].get(titles[one.kind]) == shown(one.cell)
        and not any(rule.applies and not rule.exercised for rule in _details(one))
        for one in beside.compare(table, published)
    )


def _details(one: beside.Compared) -> Iterator[Evidence]:
    return (one.row.found[detail.holds] for detail in one.documented.details)
