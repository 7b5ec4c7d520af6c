"""The section that puts a published support table beside what was observed.

A row speaks for its own subject. Where that is not the subject of the published table, no cell of the
table is called right or wrong: what works here is *possible*, which is not to say *wired* there.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Literal, TypeAlias

from msgspec import Struct

from nros_conformance.report import markdown
from nros_conformance.report.applicability import limits
from nros_conformance.report.cells import WORDS, Cell
from nros_conformance.report.markdown import prose
from nros_conformance.report.table import Row, Table, label
from nros_conformance.rmw.codes import code_name
from nros_conformance.rmw.events import EventKind
from nros_conformance.suite.published import Compiled, Documented, Published, PublishedBackend

Drift: TypeAlias = Literal["overstated", "understated", "detail", "agrees", "untested"]

TITLE = "Against the published table"
HEADER = ["Backend", "Event", "Documented", "Observed", "Drift"]

_STRONGEST: tuple[Drift, ...] = ("overstated", "understated", "detail", "agrees", "untested")
"""Of several rows of one backend, the one that differs most counts for a cell of the table."""

_REVISION = 7
"""Characters of the revision that are printed."""

_DEADLINES = {EventKind.REQUESTED_DEADLINE_MISSED, EventKind.OFFERED_DEADLINE_MISSED}


class Compared(Struct, frozen=True, kw_only=True):
    """One cell of the published table beside the cell of one row."""

    row: Row
    kind: EventKind
    documented: Documented
    cell: Cell
    drift: Drift
    about: tuple[str, ...] = ()
    """What differs in detail, or how the cell here is."""
    observed: tuple[str, ...] = ()
    """What was observed beyond the word."""


def compare(table: Table, published: Published) -> tuple[Compared, ...]:
    """All rows of backends that the published table has, event by event, in the order of the rows."""
    return tuple(
        _compared(row, kind, there.cell(kind), published)
        for row in table.rows
        if (there := published.row(row.report.backend)) is not None
        for kind in EventKind
    )


def same_subject(row: Row, published: Published) -> bool:
    """Whether a row ran what the published table is about, so that it can contradict it."""
    return row.report.declaration.subject.kind in published.subject.kinds


def section(table: Table, published: Published) -> str:
    """The section of ``matrix.md``."""
    lines = [f"## {TITLE}", "", intro(table, published), ""]
    if rows := differing(table, published):
        lines += [markdown.table(HEADER, rows), ""]
    lines += [count(table, published), ""]
    if read := not_run(published):
        lines += [read, ""]
    return "\n".join(lines)


def intro(table: Table, published: Published) -> str:
    """What the published table is, what it is about, and what therefore can be said."""
    number = len(published.backends)
    used = {cell.word for one in published.backends for cell in one.cells.values()}
    words = ", ".join(
        f'"{word}" is *{prose(meaning.says)}*' for word, meaning in published.legend.items() if word in used
    )
    return (
        f"{_capital(prose(published.name))} at [{published.revision[:_REVISION]}]({published.link}), has "
        f"{number * len(EventKind)} such cells ({number} backend{'' if number == 1 else 's'}, {len(EventKind)} "
        f"events); {words} there. "
        f"It describes {prose(published.subject.says)}{_who_else(table, published)}"
    )


def differing(table: Table, published: Published) -> list[list[str]]:
    """The rows of the table: what does not agree. Events with the same drift stand together."""
    groups: dict[tuple[str, str, Drift, tuple[str, ...], tuple[str, ...]], list[Compared]] = {}
    for one in compare(table, published):
        if one.drift not in ("agrees", "untested"):
            groups.setdefault((one.row.name, one.documented.word, one.drift, one.about, one.observed), []).append(one)
    return [_line(group, published) for group in groups.values()]


def count(table: Table, published: Published) -> str:
    """How many cells of the published table agree and differ, which were not compared, and what is not in it."""
    found: dict[tuple[str, EventKind], Drift] = {}
    for one in compare(table, published):
        place = (one.row.report.backend, one.kind)
        found[place] = min(found.get(place, one.drift), one.drift, key=_STRONGEST.index)
    number = {drift: sum(each == drift for each in found.values()) for drift in _STRONGEST}
    total = len(published.backends) * len(EventKind)
    texts = [
        f"Of its {total} cells {number['agrees']} agree{_s(number['agrees'])}, "
        f"{number['detail']} differ{_s(number['detail'])} in detail, "
        f"{number['understated']} {_are(number['understated'])} understated, "
        f"{number['overstated']} {_are(number['overstated'])} overstated."
    ]
    if lacking := "; ".join(_not_compared(table, published, found)):
        texts.append(f"Not compared: {lacking}.")
    others = [prose(row.title) for row in table.rows if published.row(row.report.backend) is None]
    others += [prose(column.title).lower() for column in table.columns if column.table == 2 and not column.pattern]
    if others:
        texts.append(f"{_capital(_and(others))} {'is' if len(others) == 1 else 'are'} not in it.")
    return " ".join(texts)


def not_run(published: Published) -> str:
    """What the sources of the compiled backends say at that revision; empty when nothing was read."""
    read = [(one, one.compiled) for one in published.backends if one.compiled is not None]
    empty = [(one, compiled) for one, compiled in read if compiled.event_slots == "empty"]
    texts = []
    if empty:
        wrong = [f"{prose(one.title)} ({events})" for one, _ in empty if (events := _claimed(one, published))]
        more = f', and its "yes" for {_and(wrong)} is overstated there' if wrong else ""
        texts.append(
            f"the event slots of the compiled {_sources(empty)} {'backend' if len(empty) == 1 else 'backends'} are "
            "`NULL` at that revision, so a nano-ros application gets `UNSUPPORTED` from "
            f"{'it' if len(empty) == 1 else 'each'}{more}"
        )
    for one, compiled in read:
        if compiled.event_slots == "filled":
            texts.append(
                f"the event slots of the compiled {_sources([(one, compiled)])} are filled{_answers(compiled)}"
            )
    return f"Read, not run: {'; '.join(texts)}." if texts else ""


def _compared(row: Row, kind: EventKind, documented: Documented, published: Published) -> Compared:
    cell, works = row.cell(kind.label), published.works(documented)
    drift, about = _drift(cell, works=works)
    observed: list[str] = []
    if works and drift in ("agrees", "detail"):
        declaration = row.report.declaration
        flags = {one.unless for one in documented.details if one.unless}
        documented_limits = {flag for flag in flags if getattr(declaration.event(kind), flag)}
        restrictions = limits(declaration, kind)
        if cell.id == "reduced" and restrictions and documented_limits.issuperset(restrictions):
            drift, about = "agrees", []  # the limit is what the remark says
        for detail in documented.details:
            if row.found[detail.holds].standing == "holds" and detail.unless not in documented_limits:
                drift = "detail"
                about = [*about, detail.about]
                observed.append(detail.observed)
    return Compared(
        row=row, kind=kind, documented=documented, cell=cell, drift=drift, about=tuple(about), observed=tuple(observed)
    )  # fmt: skip


def _drift(cell: Cell, *, works: bool) -> tuple[Drift, list[str]]:
    """What a word beside a documented one comes to, and what differs."""
    if cell.id in ("no_evidence", "inconclusive", "not_applicable"):
        return "untested", []
    if cell.id == "broken":
        return ("overstated", ["broken"]) if works else ("detail", ["it is broken"])
    if cell.id == "refused":
        return ("overstated", ["absent"]) if works else ("agrees", [])
    if not works:
        return "understated", []
    details = {"reduced": ["the limit"], "deviates": ["rules violated"]}.get(cell.id, [])
    return ("detail" if details else "agrees"), details


def _line(group: Sequence[Compared], published: Published) -> list[str]:
    first = group[0]
    remarks = "; ".join(dict.fromkeys(f'"{prose(one.documented.remark)}"' for one in group))
    words = [WORDS[one.cell.id] for one in group]
    observed = "; ".join([", ".join(words if len(set(words)) > 1 else words[:1]), *map(prose, first.observed)])
    return [
        label(first.row, 2), _events([one.kind for one in group]), f"{first.documented.word}: {remarks}", observed,
        _verdict(first, same_subject(first.row, published)),
    ]  # fmt: skip


def _verdict(one: Compared, same: bool) -> str:
    if one.drift == "understated":
        return f"understated: {'it works' if same else 'possible'}"
    about = ", ".join(prose(text) for text in one.about)
    if one.drift == "overstated":
        return f"overstated: {about}" + ("" if same else " here")
    return f"detail: {about}"


def _who_else(table: Table, published: Published) -> str:
    """Which rows here ran the same, and what the words mean of the others."""
    rows = [row for row in table.rows if published.row(row.report.backend) is not None]
    same = [row for row in rows if same_subject(row, published)]
    if same and len(same) == len(rows):
        return ", as do the rows here."
    who = "no row here does"
    if same:
        who = f"of the rows here only {_and([prose(row.title) for row in same])} {'do' if len(same) > 1 else 'does'}"
    return (
        f", and {who}: by the {'others' if same else 'rows here'} no cell of it is right or wrong. "
        '*Understated* means "possible", not "wired"; *overstated* means "absent from what ran here", not "wrong".'
    )


def _not_compared(
    table: Table, published: Published, found: dict[tuple[str, EventKind], Drift]
) -> Iterator[str]:  # fmt: skip
    untested = {
        one: kinds
        for one in (each.backend for each in published.backends)
        if (kinds := [kind for kind in EventKind if found.get((one, kind)) == "untested"])
    }
    if untested:
        titles = {row.report.backend: row.report.declaration.title for row in table.rows}
        places = "; ".join(f"{prose(titles[one])}: {_events(kinds)}" for one, kinds in untested.items())
        yield f"{sum(map(len, untested.values()))} untested or unclear here ({places})"
    absent = [one for one in published.backends if (one.backend, EventKind.MESSAGE_LOST) not in found]
    if absent:
        yield f"{len(absent) * len(EventKind)} without a row here ({', '.join(prose(one.title) for one in absent)})"


def _claimed(one: PublishedBackend, published: Published) -> str:
    return _events([kind for kind in EventKind if published.works(one.cell(kind))])


def _sources(read: Iterable[tuple[PublishedBackend, Compiled]]) -> str:
    return _and([f"[{prose(one.title)}]({compiled.source})" for one, compiled in read])


def _answers(compiled: Compiled) -> str:
    if compiled.answers is None:
        return ""
    right, wrong, without = (
        f"{code} {code_name(code)}"
        for code in (compiled.answers.right_side, compiled.answers.wrong_side, compiled.answers.no_callback)
    )
    return f": registering answers {right}, on the wrong side {wrong}, without a callback {without}"


def _events(kinds: Sequence[EventKind]) -> str:
    if len(kinds) == len(EventKind):
        return "all five"
    if set(kinds) == _DEADLINES:
        return "both deadlines"
    return ", ".join(kind.words.lower() for kind in kinds)


def _and(texts: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(texts[:-1]), texts[-1]))) if texts else ""


def _capital(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}"


def _s(number: int) -> str:
    return "s" if number == 1 else ""


def _are(number: int) -> str:
    return "is" if number == 1 else "are"
