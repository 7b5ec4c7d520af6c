"""The stored result of a run of the mutants: ``mutants.json`` in the results directory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import msgspec
from msgspec import Struct

from nros_conformance.report.results import ReportError

FILE = "mutants.json"
FORMAT = 1


class MutantResult(Struct, frozen=True, kw_only=True):
    """One mutant: killed by a scenario on the requirement that it violates, or not."""

    name: str
    defect: str
    violates: str
    says: str
    killed_by: str = ""
    """Key of the first scenario in which an expectation that proves `violates` fails; empty: it survives."""
    because: str = ""
    """What that expectation got."""
    played: int = 0
    """Scenarios that were played."""


class MutationReport(Struct, frozen=True, kw_only=True):
    """All mutants of a backend against one state of the suites."""

    format: int = FORMAT
    digest: str
    backend: str
    mutants: tuple[MutantResult, ...]
    seconds: float

    @property
    def survivors(self) -> tuple[MutantResult, ...]:
        """Those that nothing has killed."""
        return tuple(one for one in self.mutants if not one.killed_by)

    def unexercised(self, levels: Mapping[str, str]) -> Iterator[str]:
        """Requirements above may that no mutant violates."""
        violated = {one.violates for one in self.mutants}
        return (id_ for id_, level in levels.items() if level != "may" and id_ not in violated)


def scores(report: MutationReport) -> dict[str, tuple[int, int]]:
    """Killed and all mutants, by group of the requirement."""
    found: dict[str, tuple[int, int]] = {}
    for one in report.mutants:
        killed, every = found.get(one.violates[:3], (0, 0))
        found[one.violates[:3]] = (killed + bool(one.killed_by), every + 1)
    return found


def write_mutation(results: Path, report: MutationReport) -> Path:
    """Store it."""
    results.mkdir(parents=True, exist_ok=True)
    file = results / FILE
    file.write_bytes(msgspec.json.format(msgspec.json.encode(report), indent=1) + b"\n")
    return file


def read_mutation(results: Path) -> MutationReport | None:
    """The stored run, if there is one. Raises `ReportError`."""
    file = results / FILE
    try:
        data = file.read_bytes()
    except FileNotFoundError:
        return None
    try:
        report = msgspec.json.decode(data, type=MutationReport)
    except msgspec.DecodeError as error:
        raise ReportError(f"{file}: damaged: {error}; run again: nros-conformance mutants") from None
    if report.format != FORMAT:
        raise ReportError(
            f"{file}: format {report.format}; this nros-conformance reads format {FORMAT}: "
            "run again: nros-conformance mutants"
        )
    return report


def stored_scores(results: Path, digest: str) -> tuple[dict[str, tuple[int, int]], str]:
    """The scores of the stored run, if it is of these very suites, and why there are none although it is there.

    Raises `ReportError`.
    """
    report = read_mutation(results)
    if report is None:
        return {}, ""
    if report.digest != digest:
        return {}, f"{results / FILE}: its mutants were played on other suites; run again: nros-conformance mutants"
    return scores(report), ""
