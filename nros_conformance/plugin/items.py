"""The items: a backend's ``backend.toml`` is the file, each scenario one test in it.

``backend.toml::rdm.silence-after-data[deadline=in-qos]``; a backend with variants has one more level,
``backend.toml::router::...``. The last item of each row, ``declaration``, holds declaration against behaviour.
"""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import pytest

from nros_conformance.campaign.plans import Row
from nros_conformance.campaign.selection import Decision, decide, proven
from nros_conformance.formats.counts import many
from nros_conformance.plugin.background import NotPlayed, Settled
from nros_conformance.report.applicability import GROUP_KINDS
from nros_conformance.report.evidence import proofs_of
from nros_conformance.report.explain import explain_scenario
from nros_conformance.report.known import concerns, in_force, must_show
from nros_conformance.report.results import Report, ScenarioResult
from nros_conformance.suite.catalogue import Requirement
from nros_conformance.suite.loader import Loaded, Suites
from nros_conformance.trace.files import read_trace

DECLARATION = "declaration"


class ShouldViolation(pytest.PytestWarning):
    """A *should* that is violated: no failure, and no reason to be quiet about it."""


class Violation(Exception):
    """A must that is violated, or a declaration that behaviour contradicts. The text is all that is shown."""


class Verdicts(Protocol):
    """Where items get verdicts from; they wait there."""

    def result(self, row: str, key: str) -> Settled: ...
    def report(self, row: str) -> Report: ...


@dataclasses.dataclass(frozen=True, slots=True)
class Subject:
    """One backend: its ``backend.toml``, its rows, and what is chosen to be played on them."""

    file: Path
    rows: tuple[Row, ...]
    chosen: tuple[Loaded, ...]
    suites: Suites
    verdicts: Verdicts
    tables: Mapping[str, int]
    """The line of each table in `file`, from 0."""

    @property
    def requirements(self) -> Mapping[str, Requirement]:
        """By id."""
        return {one.id: one for one in self.suites.requirements}

    def line_of(self, one: Loaded) -> int:
        """Of the table of the declaration that a scenario is about, from 0; the first line when there is none."""
        wanted = [f"events.{one.scenario.refusal}"] if one.scenario.refusal else []
        for id_ in proven(one):
            group = id_.partition("-")[0]
            wanted.append(f"events.{GROUP_KINDS[group].label}" if group in GROUP_KINDS else _TABLES.get(group, ""))
        return next((self.tables[name] for name in wanted if name in self.tables), 0)


_TABLES = {"CON": "connection", "QOS": "qos"}
"""Tables of the declaration, by groups of requirements."""


def tables_of(file: Path) -> dict[str, int]:
    """The line of each table of a declaration, from 0."""
    lines = enumerate(file.read_text(encoding="utf-8").splitlines())
    return {line.strip()[1:].partition("]")[0]: number for number, line in lines if line.startswith("[")}


class SubjectFile(pytest.File):
    """A ``backend.toml`` whose backend is to be judged."""

    subject: Subject

    def collect(self) -> Iterator[pytest.Item | pytest.Collector]:
        if len(self.subject.rows) == 1:
            yield from items(self, self.subject, self.subject.rows[0])
            return
        for row in self.subject.rows:
            collector: RowCollector = RowCollector.from_parent(self, name=row.variant)
            collector.subject, collector.row = self.subject, row
            yield collector


class RowCollector(pytest.Class):
    """A backend in one of several variants. IDEs show a level of their own for classes, and for nothing else."""

    subject: Subject
    row: Row

    def collect(self) -> Iterator[pytest.Item]:
        yield from items(self, self.subject, self.row)


def items(parent: pytest.Collector, subject: Subject, row: Row) -> Iterator[pytest.Item]:
    """An item for every chosen scenario, and the declaration's."""
    for one in subject.chosen:
        item: ScenarioItem = ScenarioItem.from_parent(parent, name=one.key)
        item.cast(subject, row, one)
        yield item
    last: DeclarationItem = DeclarationItem.from_parent(parent, name=DECLARATION)
    last.subject, last.row = subject, row
    last.add_marker(pytest.mark.nros)
    yield last


class ScenarioItem(pytest.Item):
    """One scenario on one row."""

    subject: Subject
    row: Row
    loaded: Loaded
    decision: Decision
    seconds = 0.0
    """What its plays took; the item itself only waits."""
    unclear = ""
    """Why there is no verdict: the host was too slow, or the stimulus did not happen."""

    def cast(self, subject: Subject, row: Row, one: Loaded) -> None:
        """Say which it is, and mark it with what it proves."""
        self.subject, self.row, self.loaded = subject, row, one
        self.decision = decide(one, row.declaration, row.lacking)
        self.add_marker(pytest.mark.nros)
        self.add_marker(pytest.mark.suite(name=one.suite))
        self.user_properties.append(("scenario", one.source))
        for id_ in proven(one):
            level = subject.suites.levels[id_]
            self.add_marker(pytest.mark.requirement(id=id_, level=level))
            self.add_marker(pytest.mark.level(name=level))
            self.extra_keyword_matches |= {id_, level}
            self.user_properties.append(("requirement", id_))

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Where the declaration says what is judged: a line of `path`, since IDEs take it for one."""
        # pytest takes a name that its id ends with for one of Python, and prints its dots as ::
        return self.path, self.subject.line_of(self.loaded), f"{self.row.name} {self.name}"

    def runtest(self) -> None:
        if self.decision.status != "play":
            raise pytest.skip.Exception(f"{self.decision.status}: {self.decision.reason}", _use_item_location=True)
        settled = self.subject.verdicts.result(self.row.name, self.name)
        result = settled.result
        self.seconds = sum(attempt.seconds for attempt in result.attempts)
        verdict = result.last
        assert verdict is not None
        for text in verdict.warnings:
            self._warn(text)
        if verdict.verdict == "error":
            raise NotPlayed(verdict.reason)
        if verdict.verdict == "fail":
            if result.known:
                pytest.xfail(f"[[known]] {result.known}: {verdict.reason}")
            raise Violation(self._told(settled))
        if stale := self._stale(result):
            raise Violation(stale)
        if verdict.verdict == "inconclusive":
            tries = many(len(result.attempts), "attempt")
            self.unclear = f"{verdict.reason} ({tries})"
            raise pytest.skip.Exception(f"unclear: {self.unclear}", _use_item_location=True)
        if verdict.verdict == "none":
            raise pytest.skip.Exception(f"nothing to judge: {verdict.reason}", _use_item_location=True)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        return _plain(excinfo) or super().repr_failure(excinfo)

    def _warn(self, text: str) -> None:
        file, _, line = self.loaded.source.rpartition(":")
        place = self.subject.suites.directory.parent / file
        warnings.warn_explicit(ShouldViolation(f"{self.row.name} {self.name}: {text}"), None, str(place), int(line))

    def _told(self, settled: Settled) -> str:
        """Requirement, script, timeline and judgement, as ``explain`` shows them."""
        played = _Played(self.row.name, self.row.asked)
        attempt = settled.result.attempts[-1]
        trace = read_trace(Path(settled.folder) / attempt.trace)
        text = explain_scenario(played, settled.result, attempt, trace, self.subject.requirements)
        return f"{text}\nPytest     pytest '{self.nodeid}'"

    def _stale(self, result: ScenarioResult) -> str:
        """What is wrong with an entry of a list of known failures that this result contradicts."""
        outcomes = list(proofs_of(result))
        for known in in_force(self.row.declaration, self.row.versions):
            about = {proof.outcome for requirement, proof in outcomes if requirement == known.requirement}
            if concerns(known, result) and about == {"pass"} and must_show(known, [result]):
                return f"[[known]] {known.key} ({known.requirement}, {known.scenario}) holds; remove the entry"
        return ""


class DeclarationItem(pytest.Item):
    """Whether behaviour contradicts the declaration, within what was selected."""

    subject: Subject
    row: Row

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """The declaration itself."""
        return self.subject.file, 0, self.name

    def runtest(self) -> None:
        report = self.subject.verdicts.report(self.row.name)
        texts = [difference.text for difference in report.differences]
        texts += [
            f"{one.what}: {one.detail}, with {', '.join(one.scenarios)} in flight; "
            "not reproduced when each was played alone"
            for one in report.incidents
            if not one.reproduced
        ]
        if texts:
            raise Violation("\n".join([f"{self.subject.file} and what was observed differ:", *texts]))

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        return _plain(excinfo) or super().repr_failure(excinfo)


def _plain(excinfo: pytest.ExceptionInfo[BaseException]) -> str:
    """The text of our own exceptions, which need no traceback."""
    if isinstance(excinfo.value, Violation):
        return str(excinfo.value)
    return f"not played: {excinfo.value}" if isinstance(excinfo.value, NotPlayed) else ""


@dataclasses.dataclass(frozen=True, slots=True)
class _Played:
    """What `explain_scenario` wants to know of a row."""

    row: str
    asked: str


def select(every: Sequence[pytest.Item]) -> dict[str, tuple[Row, list[str]]]:
    """The rows of these items with the keys of their scenarios, in order of the items."""
    found: dict[str, tuple[Row, list[str]]] = {}
    for item in every:
        if isinstance(item, ScenarioItem | DeclarationItem):
            _, keys = found.setdefault(item.row.name, (item.row, []))
            if isinstance(item, ScenarioItem):
                keys.append(item.name)
    return found
