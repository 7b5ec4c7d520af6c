"""What the table does not show: rules without evidence, and the coverage by group."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from nros_conformance.report import markdown
from nros_conformance.report.evidence import Evidence
from nros_conformance.report.markdown import prose, sentence
from nros_conformance.report.results import ScenarioResult
from nros_conformance.report.table import Table

GROUPS = ("REG", "DSP", "CNT", "RDM", "ODM", "LVC", "LVL", "MSL", "QOS", "CON", "LIF", "ROB")


def section(table: Table, mutation: Mapping[str, tuple[int, int]]) -> str:
    """The section of ``matrix.md``. ``mutation``: planted defects caught and planted, by group."""
    lines = ["## Gaps", ""]
    if table.rows:
        lines += [count(table), ""]
    if bullets := list(gaps(table)):
        lines += [*(f"- {bullet}" for bullet in bullets), ""]
    lines.append(markdown.table(*coverage(table, mutation), range(1, len(GROUPS) + 2)))
    return "\n".join(lines) + "\n"


def count(table: Table) -> str:
    """One sentence with the numbers of musts over all rows."""
    rules = [one for row in table.rows for one in row.must()]
    violated = [one for one in rules if one.broken]
    undeclared = sum(one.standing == "violated" for one in violated)
    aside = f" ({undeclared} not declared)" if undeclared else " (all known, all noted above)" if violated else ""
    number = {name: sum(one.standing == name for one in rules) for name in ("holds", "unexercised", "unclear")}
    return (
        f"{len(rules)} rules apply to these rows: {number['holds']} hold, {len(violated)} are violated{aside}, "
        f"{number['unexercised']} could not be exercised, {number['unclear']} unclear."
    )


def gaps(table: Table) -> Iterator[str]:
    """One line per reason: cells that say nothing, then rules that were not exercised or not decided."""
    grouped: dict[tuple[str, str], list[str]] = {}
    for column in table.columns:
        for row in table.rows:
            cell = row.cell(column.id)
            if cell.id == "no_evidence":
                grouped.setdefault((column.title, sentence(cell.reason)), []).append(row.title)
    for (title, reason), rows in grouped.items():
        yield f"{prose(title)} of {_rows(table, rows)}: {prose(reason)}"
    silent = {
        (row.name, must)
        for row in table.rows
        for column in table.columns
        if row.cell(column.id).id == "no_evidence"
        for must in column.musts
    }
    merged: dict[tuple[tuple[str, ...], str], list[str]] = {}
    for requirement in _order(table):
        reasons: dict[str, list[str]] = {}
        for row in table.rows:
            one = row.found[requirement]
            if one.level == "must" and (row.name, requirement) not in silent and (reason := _reason(one)):
                reasons.setdefault(reason + _elsewhere(table, requirement), []).append(row.title)
        for reason, rows in reasons.items():
            merged.setdefault((tuple(rows), reason), []).append(requirement)
    for (titles, reason), requirements in merged.items():
        yield f"{', '.join(requirements)} on {_rows(table, list(titles))}: {sentence(prose(reason))}"


def coverage(table: Table, mutation: Mapping[str, tuple[int, int]]) -> tuple[list[str], list[list[str]]]:
    """Header and rows: requirements by group, with a scenario, exercised, planted defects caught."""
    every = set(table.requirements)
    with_scenario = {
        requirement
        for row in (*table.rows, *table.control)
        for result in row.report.results
        for requirement in _meant(result)
    }
    exercised = {name for row in table.rows for name, one in row.found.items() if one.exercised}
    rows = [
        ["Requirements", *_by_group(every)],
        ["with a scenario", *_by_group(every & with_scenario)],
        ["exercised by a row above", *_by_group(every & exercised)],
    ]
    if mutation:
        caught = [mutation.get(group, (0, 0)) for group in GROUPS]
        total = (sum(one for one, _ in mutation.values()), sum(of for _, of in mutation.values()))
        rows.append(["planted defects caught", *(f"{one}/{of}" for one, of in (*caught, total))])
    return ["", *GROUPS, "all"], rows


def _meant(result: ScenarioResult) -> Iterator[str]:
    """What a scenario proves: by its expectations, and by the invariants that it implies."""
    yield from result.proves
    for finding in result.last.findings if result.last else ():
        yield from finding.proves


def _by_group(requirements: set[str]) -> list[str]:
    counts = [sum(one.startswith(f"{group}-") for one in requirements) for group in GROUPS]
    return [*map(str, counts), str(len(requirements))]


def _order(table: Table) -> list[str]:
    place = {group: index for index, group in enumerate(GROUPS)}
    return sorted(table.requirements, key=lambda one: (place.get(one[:3], len(place)), one))


def _reason(one: Evidence) -> str:
    if one.standing == "unexercised":
        return one.reason
    if one.standing == "unclear":
        return f"no verdict in {', '.join(f'`{scenario}`' for scenario in one.scenarios('unclear'))}"
    if one.requirement == "REG-001" and one.standing == "not-applicable":
        return f"not applicable, {one.reason}"
    return ""


def _elsewhere(table: Table, requirement: str) -> str:
    if any(row.found[requirement].exercised for row in table.rows):
        return ""
    shown = any(row.found[requirement].standing == "holds" for row in table.control)
    return "; exercised on the reference only" if shown else ""


def _rows(table: Table, titles: list[str]) -> str:
    if len(titles) == len(table.rows) > 1:
        return "every row"
    return ", ".join(prose(row.title) for row in table.rows if row.title in titles)
