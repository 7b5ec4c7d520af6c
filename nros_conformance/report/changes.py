"""``matrix --diff``: what changed between a former matrix, or former results, and the present results."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from msgspec import Struct

from nros_conformance.report import matrix, printed
from nros_conformance.report.columns import columns
from nros_conformance.report.evidence import Evidence, Standing
from nros_conformance.report.markdown import prose, without_paths
from nros_conformance.report.results import ReportError, read_reports
from nros_conformance.report.table import Row, Table, assemble

_STANDINGS: Mapping[Standing, str] = {
    "holds": "holds", "violated": "violated", "known": "violated, known", "unclear": "unclear",
    "unexercised": "not exercised", "not-applicable": "n/a",
}  # fmt: skip
_VIOLATED = (_STANDINGS["violated"], _STANDINGS["known"])
_WIDTH = 96
_SHOWN_FAILING, _SHOWN = 3, 1
"""Scenarios that are named for a requirement that they violate, and for any other."""

_KEY = re.compile(r"`([^`]+)`")
_KEYS = re.compile(r"(?: `[^`]+`)+$")
_VIOLATES = re.compile(r"\*\*violates (?P<requirements>[A-Z]{3}-\d{3}(?:, [A-Z]{3}-\d{3})*)\*\*")
_SHOWN_BY = re.compile(r" Shown by (?P<scenarios>`[^`]+`(?:, `[^`]+`)*)\.")
_RAN = re.compile(
    r"^Suites (?P<suites>\S+ \([^)]*\)), profile (?P<profile>.+), nros-conformance (?P<tool>.+?)"
    r"(?:, Python (?P<python>.+))?\.$",
    re.MULTILINE,
)


class Seen(Struct, frozen=True, kw_only=True):
    """One requirement: its standing in words, and what shows it or why it was not exercised."""

    standing: str
    scenarios: tuple[str, ...] = ()
    reason: str = ""


class SeenCell(Struct, frozen=True, kw_only=True):
    """One cell: what is printed without keys of notes, and the requirements behind it, as far as they are known."""

    text: str
    rules: dict[str, Seen] = {}
    reason: str = ""


class SeenRow(Struct, frozen=True, kw_only=True):
    """One row; ``kind`` of its subject, ``tested`` versions, cells by the title of their column."""

    kind: str
    tested: str
    cells: dict[str, SeenCell]


class Snapshot(Struct, frozen=True, kw_only=True):
    """What a matrix says. ``ran`` by name: suites, profile, tool, python."""

    ran: dict[str, str]
    columns: tuple[str, ...]
    rows: dict[str, SeenRow]
    unavailable: dict[str, str] = {}
    """Backends that could not run, by title: the reason."""


def read_old(path: Path, requirements: Mapping[str, str]) -> Snapshot:
    """A results directory or a ``matrix.md``. ``requirements``: id to level. Raises `ReportError`."""
    if path.is_dir():
        return of_table(assemble(read_reports(path), requirements))
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ReportError(f"{path}: there is no such file or directory") from None
    except (OSError, UnicodeDecodeError):
        text = ""
    if not printed.rows(text):
        raise ReportError(f"{path}: neither a directory of results nor a matrix.md")
    return of_text(text, requirements)


def of_table(table: Table) -> Snapshot:
    """What reports show, with all that is behind it."""
    return Snapshot(
        ran=_ran(matrix.what_ran(table)),
        columns=tuple(prose(column.title) for column in table.columns),
        rows={prose(row.title): _row(row, table) for row in table.rows},
        unavailable={
            prose(report.declaration.title): without_paths(report.unavailable_reason) for report in table.unavailable
        },
    )


def of_text(text: str, requirements: Mapping[str, str]) -> Snapshot:
    """What a ``matrix.md`` says; of the requirements behind a cell it names what is violated, unclear or missing."""
    notes, tested, gaps = printed.notes(text), printed.tested(text), printed.gaps(text)
    musts = {prose(column.title): column.musts for column in columns(requirements)}
    rows = {}
    for title, cells in printed.rows(text).items():
        missing = {one: _missing(reason) for one, reason in gaps.get(title, {}).items()}
        rows[title] = SeenRow(
            kind=cells.pop(printed.RAN, ""),
            tested=tested.get(title, "").replace("`", ""),
            cells={
                name: SeenCell(
                    text=_word(cell),
                    rules={
                        one: seen
                        for one, seen in {**missing, **_violated(cell, notes)}.items()
                        if name not in musts or one in musts[name]
                    },
                )
                for name, cell in cells.items()
            },
        )
    heads = dict.fromkeys(name for row in rows.values() for name in row.cells)
    return Snapshot(ran=_ran(text), columns=tuple(heads), rows=rows)


def changes(old: Snapshot, new: Snapshot, name: str) -> str:
    """What changed, as text. ``name`` is what the old one is called."""
    head = [
        *(f"{key:<8} {text}" for key in ("suites", "profile", "tool", "python")
          if (text := _arrow(old.ran.get(key, ""), new.ran.get(key, "")))),
        *_listed("rows", _rows(old, new)),
        *_listed("ran", _each(old, new, "kind")),
        *_listed("tested", _each(old, new, "tested")),
        *_listed("columns", [*(f"+ {one}" for one in new.columns if one not in old.columns),
                             *(f"- {one}" for one in old.columns if one not in new.columns)]),
    ]  # fmt: skip
    both = [title for title in new.rows if title in old.rows]
    cells = [
        (title, column) for title in both for column in new.rows[title].cells if column in old.rows[title].cells
    ]  # fmt: skip
    blocks = [
        block
        for title, column in cells
        if (block := _cell(f"{title}, {column}", old.rows[title].cells[column], new.rows[title].cells[column]))
    ]
    both_have = f"{len(cells)} cell{'s' if len(cells) != 1 else ''}"
    if not head and not blocks:
        return f"nothing changed against {name}: {both_have}"
    summary = f"{len(blocks)} of {both_have} changed against {name}"
    return "\n\n".join(["\n".join(head)] * bool(head) + ["\n".join(block) for block in blocks] + [summary])


def _row(row: Row, table: Table) -> SeenRow:
    return SeenRow(
        kind=row.report.declaration.subject.kind,
        tested=matrix.tested(row.report).replace("`", ""),
        cells={
            prose(column.title): SeenCell(
                text=row.cell(column.id).text,
                rules={must: _seen(row.found[must]) for must in column.musts},
                reason=row.cell(column.id).reason,
            )
            for column in table.columns
        },
    )


def _seen(one: Evidence) -> Seen:
    scenarios = one.scenarios("fail") if one.broken else one.scenarios("pass", "unclear") if one.applies else ()
    return Seen(standing=_STANDINGS[one.standing], scenarios=scenarios, reason=one.reason)


def _ran(text: str) -> dict[str, str]:
    match = _RAN.search(text)
    return {key: value.replace("`", "") for key, value in match.groupdict().items() if value} if match else {}


def _word(cell: str) -> str:
    """A cell without bold and without the keys of its notes."""
    return _KEYS.sub("", cell).replace("**", "")


def _violated(cell: str, notes: Mapping[str, str]) -> dict[str, Seen]:
    found = {}
    for key in _KEY.findall(cell):
        note = notes.get(key, "")
        if match := _VIOLATES.search(note):
            shown = _SHOWN_BY.search(note)
            standing = _VIOLATED[0] if key.startswith("!") else _VIOLATED[1]
            for one in match["requirements"].split(", "):
                found[one] = Seen(standing=standing, scenarios=tuple(_KEY.findall(shown["scenarios"])) if shown else ())
    return found


def _missing(reason: str) -> Seen:
    """What a line of the gaps says of a requirement."""
    words = {"no verdict in ": "unclear", "not applicable, ": "n/a"}
    standing = next((word for start, word in words.items() if reason.startswith(start)), _STANDINGS["unexercised"])
    return Seen(standing=standing, reason=reason)


def _arrow(old: str, new: str) -> str:
    """Both when they differ and both are known."""
    return f"{old} -> {new}" if old and new and old != new else ""


def _listed(name: str, texts: Sequence[str]) -> list[str]:
    return [f"{name if index == 0 else '':<8} {text}" for index, text in enumerate(texts)]


def _rows(old: Snapshot, new: Snapshot) -> list[str]:
    added = [f"+ {title}, {row.kind}" for title, row in new.rows.items() if title not in old.rows]
    gone = []
    for title, row in old.rows.items():
        if title not in new.rows:
            reasons = (why for one, why in new.unavailable.items() if title == one or title.startswith(f"{one} ("))
            why = next(reasons, "")
            gone.append(f"- {title}, {row.kind}" + (f" (not available here: {why})" if why else ""))
    return added + gone


def _each(old: Snapshot, new: Snapshot, field: str) -> list[str]:
    return [
        f"{title}: {text}"
        for title, row in new.rows.items()
        if title in old.rows and (text := _arrow(getattr(old.rows[title], field), getattr(row, field)))
    ]


def _cell(name: str, old: SeenCell, new: SeenCell) -> list[str]:
    """The lines on one cell; none when nothing changed."""
    rules = list(_rules(old.rules, new.rules))
    if old.text == new.text and not rules:
        return []
    lines = [line for text in rules or [new.reason] for line in _wrapped(text)]
    return [f"{name}: {_arrow(old.text, new.text) or new.text}", *lines]


def _rules(old: Mapping[str, Seen], new: Mapping[str, Seen]) -> Iterator[str]:
    for requirement in sorted({*old, *new}):
        before, after = old.get(requirement), new.get(requirement)
        if after is None:
            continue
        if before is None:
            # A matrix.md does not name what holds.
            if after.standing in _VIOLATED:
                yield f"{requirement}  {after.standing}   {_behind(after)}"
        elif before.standing != after.standing:
            gone = before.standing in _VIOLATED and after.standing not in _VIOLATED
            behind = _behind(before, after.reason) if gone else _behind(after)
            yield f"{requirement}  {before.standing} -> {after.standing}   {behind}"


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(
        text, _WIDTH, initial_indent="  ", subsequent_indent="    ", break_long_words=False, break_on_hyphens=False
    )


def _behind(seen: Seen, reason: str = "") -> str:
    number = _SHOWN_FAILING if seen.standing in _VIOLATED else _SHOWN
    more = f" and {len(seen.scenarios) - number} more" if len(seen.scenarios) > number else ""
    return "; ".join(filter(None, (", ".join(seen.scenarios[:number]) + more, reason or seen.reason)))
