"""The table of return codes that were observed."""

from __future__ import annotations

from collections.abc import Iterable

from nros_conformance.report import markdown
from nros_conformance.report.results import Observation, Report
from nros_conformance.report.table import Row, Table, label
from nros_conformance.rmw.codes import code_name
from nros_conformance.rmw.events import EventKind

HEADER = ["Backend", "Subscription", "Publisher", "Wrong side", "Unknown kind", "No callback", "Ping: answered, silent"]
NONE = "\u2013"
"""Nothing was observed."""

_SIDES = ("subscription", "publisher")


def rows(report: Report) -> list[str]:
    """The cells after the backend's: codes of registering, then of ping."""
    return [
        *(", ".join(_codes(_right(report, kind)) for kind in EventKind if kind.side.value == side) for side in _SIDES),
        *(_codes(_registering(report, case)) for case in ("wrong side", "unknown kind", "no callback")),
        ", ".join(_codes(_ping(report, case)) for case in ("reachable", "silent")),
    ]


def table(rows_: Iterable[Row]) -> list[list[str]]:
    """The rows of the table."""
    return [[label(row, 2), *rows(row.report)] for row in rows_]


def section(table_: Table) -> str:
    """The section of ``matrix.md``."""
    lines = ["## Return codes observed", "", f"{sentence(table_)}", "", markdown.table(HEADER, table(table_.rows))]
    return "\n".join(lines) + "\n"


def sentence(table_: Table) -> str:
    """What the codes in the table are called, and which kinds stand in which place."""
    reports = [row.report for row in table_.rows]
    seen = {one.code for report in reports for one in _printed(report)}
    names = ", ".join(f"{code} {code_name(code)}" for code in sorted(seen, reverse=True))
    sides = "; ".join(
        f"{', '.join(kind.words.lower() for kind in EventKind if kind.side.value == side)} on a {side}"
        for side in _SIDES
    )
    kinds = sorted(
        {one.kind for report in reports for one in _registering(report, "unknown kind") if one.kind is not None}
    )
    unknown = f" Unknown kinds: {', '.join(map(str, kinds))}." if kinds else ""
    return f"{f'{names}. ' if names else ''}Right side: {sides}.{unknown} {NONE}: not observed."


def _printed(report: Report) -> Iterable[Observation]:
    for kind in EventKind:
        yield from _right(report, kind)
    for case in ("wrong side", "unknown kind", "no callback"):
        yield from _registering(report, case)
    for case in ("reachable", "silent"):
        yield from _ping(report, case)


def _right(report: Report, kind: EventKind) -> list[Observation]:
    return [one for one in _registering(report, "right side") if one.kind == kind]


def _registering(report: Report, case: str) -> list[Observation]:
    return [one for one in report.observations if one.call == "register" and one.case == case]


def _ping(report: Report, case: str) -> list[Observation]:
    return [one for one in report.observations if one.call == "ping" and one.case == case]


def _codes(observations: Iterable[Observation]) -> str:
    return "/".join(str(code) for code in sorted({one.code for one in observations}, reverse=True)) or NONE
