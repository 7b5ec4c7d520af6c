"""Plays generated timelines on a backend, many at once where time is real, and judges them against the model."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any

import msgspec

from nros_conformance.campaign.plans import ATTEMPTS, Row, make_plan
from nros_conformance.campaign.run import AT_ONCE
from nros_conformance.explore.cast import Cast, cast_for
from nros_conformance.explore.mutation import play_defective
from nros_conformance.explore.timelines import T, Timeline, behind, scenario
from nros_conformance.formats.places import FormatError, nearest
from nros_conformance.judge.judge import judge
from nros_conformance.judge.results import Verdict
from nros_conformance.model.deviations import DEVIATIONS, deviating
from nros_conformance.model.world import World
from nros_conformance.play.launch import PLAIN, Launch
from nros_conformance.play.plan import Plan
from nros_conformance.play.pool import Casualty, Ended, Pool
from nros_conformance.report.known import in_force
from nros_conformance.rmw.backend import Backend
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.declaration import Declaration
from nros_conformance.suite.loader import Loaded, Suites, typed
from nros_conformance.trace.files import read_trace
from nros_conformance.trace.records import Trace

SLACK_NS = {"virtual": 30 * MS, "real": 45 * MS}
"""By how much a play may be behind its timeline: creating four entities and pausing, each up to a drive of 5 ms; on
the real clock as much again as the judge allows for, and a drive."""

PER_WORKER = 200
"""Plays before a fresh worker process: one that plays several at once collects no garbage."""

DIED, CRASHED = "the backend ", "the backend crashed"
"""How the cause of a play begins that the backend did not survive, and the one that costs its process."""

_DIED = ("crash", "hang", "raised")


@dataclasses.dataclass(frozen=True, slots=True)
class Outcome:
    """What one play of a timeline showed. ``known``: the keys of declared deviations that explain a fail."""

    verdict: Verdict
    known: str = ""

    @property
    def fails(self) -> bool:
        """Whether it departs from the model in a way that is not declared."""
        return self.verdict.verdict == "fail" and not self.known

    @property
    def unclear(self) -> bool:
        """Whether it says nothing."""
        return self.verdict.verdict in ("inconclusive", "error")

    @property
    def cause(self) -> str:
        """What fails, without the figures: the requirement, or how the backend died."""
        return self.verdict.reason.partition(":")[0]

    @property
    def requirements(self) -> frozenset[str]:
        """Those that fail; of a backend that died, how it did."""
        if self.verdict.verdict != "fail":
            return frozenset()
        if self.cause.startswith(DIED):
            return frozenset([self.cause])
        return frozenset(id_ for one in self.verdict.failed() for id_ in one.proves)


class Stand:
    """A row on which timelines are played. ``folder`` takes the traces of plays on the real clock.

    ``adapter``: played in place of the row's own on the virtual clock, where plays stay in this process.

    Raises `FormatError` for a known deviation that names a model which does not exist.
    """

    def __init__(
        self, row: Row, adapter: type[Backend], suites: Suites, folder: Path = Path(), ports: range = range(0),
        launch: Launch = PLAIN,
    ) -> None:  # fmt: skip
        self.row = row
        self.adapter = adapter
        self.suites = suites
        self.cast = cast_for(row.declaration)
        self.deviations = deviations(row.declaration, row.versions)
        self.slack_ns = SLACK_NS["virtual" if row.virtual else "real"]
        self.at_once = 1 if row.virtual else max(1, min(AT_ONCE, row.declaration.bounds.sessions // 2))
        self.played = 0
        self._folder = folder
        self._ports = ports
        self._launch = launch
        self._numbers = count(1)

    @property
    def name(self) -> str:
        """Of its row."""
        return self.row.name

    def compose(self, timeline: Timeline, id_: str = "x.explored", world: type[World] = World) -> dict[str, Any]:
        """The scenario of a timeline, by the model or a deviating one."""
        return scenario(timeline, slack_ns=self.slack_ns, id_=id_, cast=self.cast, world=world)

    def play(self, timelines: Sequence[Timeline], watch: Callable[[], None] = lambda: None) -> list[Outcome]:
        """Play and judge each of them, what is unclear again: slower, fewer at once. ``watch`` is told of each."""
        if not self.row.virtual:
            parts = [timelines[first : first + PER_WORKER] for first in range(0, len(timelines), PER_WORKER)]
            return [outcome for part in parts for outcome in self._repeatedly(part, watch)]
        self.played += len(timelines)
        outcomes = []
        for timeline in timelines:
            one = self._loaded(timeline)
            outcomes.append(self._judge(timeline, play_defective(one, self.row, self.suites, self.adapter)))
            watch()
        return outcomes

    def _loaded(self, timeline: Timeline) -> Loaded:
        raw = self.compose(timeline, f"x.{self.name}-{next(self._numbers)}")
        return Loaded(raw["id"], typed(raw), raw, "explored", "", {})

    def _repeatedly(self, timelines: Sequence[Timeline], watch: Callable[[], None]) -> list[Outcome]:
        outcomes = self._together(timelines, 1, watch)
        for number in range(1, ATTEMPTS):
            again = [index for index, outcome in enumerate(outcomes) if outcome.unclear]
            if again:
                repeated = self._together([timelines[index] for index in again], 2**number)
                for index, outcome in zip(again, repeated, strict=True):
                    outcomes[index] = outcome
        return outcomes

    def _together(
        self, timelines: Sequence[Timeline], stretch: int, watch: Callable[[], None] = lambda: None
    ) -> list[Outcome]:
        """In worker processes: a crash or hang costs the timeline that caused it. ``stretch`` multiplies T."""
        self.played += len(timelines)
        found: dict[str, Outcome] = {}
        plans: dict[str, tuple[Plan, Timeline]] = {}
        for timeline in timelines:
            plan = make_plan(
                self._loaded(timeline), self.row, self.suites, self._folder, stretch=stretch, ports=self._ports
            )  # fmt: skip
            plans[plan.key] = plan, timeline

        def ended(one: Ended) -> None:
            file = Path(one.plan.trace)
            found[one.plan.key] = self._judge(plans[one.plan.key][1], read_trace(file))
            file.unlink()
            watch()

        lost: list[Casualty] = []
        pool = Pool(
            self._folder / "worker.log", virtual=False, ended=ended, casualty=lost.append, launch=self._launch,
        )  # fmt: skip
        (self._folder / "worker.log").touch()
        longest_first = sorted((plan for plan, _ in plans.values()), key=lambda plan: -plan.expected_ns)
        pool.play(longest_first, max(1, self.at_once // stretch))
        died = Verdict(verdict="inconclusive", reason="a worker process died, and not again when it was played alone")
        return [found.get(key, Outcome(died)) for key in plans]

    def _judge(self, timeline: Timeline, trace: Trace) -> Outcome:
        verdict = judge(trace)
        if verdict.verdict != "fail" or (trace.end is not None and trace.end.outcome in _DIED):
            return Outcome(verdict)
        late = behind(timeline, trace.records, trace.header.quantities["T"])
        if late > self.slack_ns / T:
            return Outcome(Verdict(verdict="inconclusive", reason=f"the play was {late:.2f}T behind its timeline"))
        return Outcome(verdict, self._known(timeline, trace))

    def _known(self, timeline: Timeline, trace: Trace) -> str:
        """The fewest declared deviations with which the model does what the trace shows."""
        ways: list[tuple[str, ...]] = [(name,) for name in self.deviations]
        ways += [tuple(self.deviations)] if len(ways) > 1 else []
        for way in ways:
            raw = self.compose(timeline, world=deviating(way))
            expecting = msgspec.structs.replace(
                trace.header, scenario={**trace.header.scenario, "expect": raw["expect"]}
            )  # fmt: skip
            if judge(Trace(expecting, trace.records)).verdict != "fail":
                return ", ".join(dict.fromkeys(self.deviations[name] for name in way))
        return ""


def deviations(declaration: Declaration, versions: Mapping[str, str]) -> dict[str, str]:
    """The models of the known deviations that are in force, and the keys of their entries."""
    found: dict[str, str] = {}
    for known in in_force(declaration, versions):
        if known.model and known.model not in DEVIATIONS:
            raise FormatError(
                f"{declaration.name}: [[known]] {known.key}", None, f"there is no model {known.model!r}",
                nearest(known.model, list(DEVIATIONS)),
            )  # fmt: skip
        if known.model:
            found.setdefault(known.model, known.key)
    return found


def left_out(casts: Iterable[Cast]) -> list[str]:
    """Which events are not looked at although they are claimed, and why."""
    found = {kind.label: why for cast in casts for kind, why in cast.without.items()}
    return [f"{label}: {why}" for label, why in found.items()]
