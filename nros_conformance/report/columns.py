"""The columns of the published table. Every must belongs to exactly one of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from msgspec import Struct

from nros_conformance.report.applicability import GROUP_KINDS
from nros_conformance.report.results import Report, ReportError
from nros_conformance.rmw.events import EventKind

PATTERNS = "patterns"
"""The suite whose scenarios are columns themselves."""

_BASE_GROUPS = ("REG", "DSP", "CNT", "QOS", "LIF", "ROB")
_CONNECTION = {
    "ping": ("Ping", ("CON-001", "CON-002", "CON-003")),
    "reconnect": ("Reconnect", ("CON-004", "CON-005", "CON-006")),
    "hard_liveliness": ("Hard liveliness", ("CON-008", "CON-009", "CON-010")),
}


class Column(Struct, frozen=True, kw_only=True):
    """One column. ``id`` is an event label, ``base``, ``ping``..., or the id of a pattern's scenario."""

    id: str
    title: str
    kind: EventKind | None = None
    musts: tuple[str, ...] = ()
    table: int = 1
    """1: events and base rules; 2: connection and patterns."""
    pattern: bool = False


def columns(requirements: Mapping[str, str], reports: Iterable[Report] = ()) -> tuple[Column, ...]:
    """The columns for these requirements (id to level), and one for each pattern that was played.

    Raises `ReportError` for a must that has no column.
    """
    musts = [requirement for requirement, level in requirements.items() if level == "must"]
    found = [
        Column(id=kind.label, title=kind.words, kind=kind, musts=tuple(one for one in musts if one[:3] == group))
        for kind in EventKind
        for group, of in GROUP_KINDS.items()
        if of is kind
    ]
    found.append(Column(id="base", title="Base rules", musts=tuple(one for one in musts if one[:3] in _BASE_GROUPS)))
    for name, (title, members) in _CONNECTION.items():
        found.append(Column(id=name, title=title, musts=tuple(one for one in musts if one in members), table=2))
    homeless = sorted(set(musts) - {must for column in found for must in column.musts})
    if homeless:
        raise ReportError(f"no column of the matrix holds {', '.join(homeless)}; give it one in report/columns.py")
    return (*found, *_patterns(reports))


def _patterns(reports: Iterable[Report]) -> list[Column]:
    titles = {one.id: one.title for report in reports for one in report.results if one.suite == PATTERNS}
    return [Column(id=id_, title=title, table=2, pattern=True) for id_, title in sorted(titles.items())]
