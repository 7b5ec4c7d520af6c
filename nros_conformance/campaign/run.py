"""Play, judge, repeat the inconclusive, collect: one backend's row of a run."""

from __future__ import annotations

import collections
import contextlib
import dataclasses
import queue
import shutil
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import msgspec

from nros_conformance import __version__
from nros_conformance.campaign.host import cores, describe_host
from nros_conformance.campaign.plans import ATTEMPTS, Row, make_plan
from nros_conformance.campaign.selection import Selection, decide, proven
from nros_conformance.formats.places import FormatError
from nros_conformance.judge.judge import judge
from nros_conformance.judge.results import Verdict
from nros_conformance.play.faketime import lacking
from nros_conformance.play.launch import PLAIN, Launch
from nros_conformance.play.plan import Plan
from nros_conformance.play.pool import Casualty, Ended, Pool, WorkerBroken
from nros_conformance.report.differences import differences
from nros_conformance.report.known import covering, in_force
from nros_conformance.report.observations import fired, observe, tally
from nros_conformance.report.results import (
    FORMAT,
    Attempt,
    Control,
    Incident,
    Observation,
    Report,
    ScenarioResult,
    Status,
    folder_for,
    write_report,
)
from nros_conformance.rmw.events import EventKind
from nros_conformance.suite.kinds import claims_needed
from nros_conformance.suite.loader import Loaded, Suites
from nros_conformance.trace.files import read_trace
from nros_conformance.trace.records import Trace

AT_ONCE = 24
"""Scenarios at once in a worker on the real clock. Each is two sessions with threads of the middleware's own; with 48
at once and every core kept busy by others, one play in 640 was judged late because such a thread was."""

BESIDE = 4
"""Processes beside the one whose plays share it: a thousand cycles are mostly waiting. A row that shares the cores with
others has one until that is done."""

A_CORE, AT_LEAST = 28, 4
"""All rows of a run together on the real clock, for each core that they share, and what each row has in any case.
Seven rows keep two cores busy all the time with 28, and are done after 44 s; with 20 after 52 s."""

SET_UP_S = 0.3
"""To begin and end a play, when the cores are as busy as `A_CORE` makes them."""


@dataclasses.dataclass(slots=True)
class Progress:
    """What a watcher of the run hears: a scenario of a row was judged."""

    row: Row
    result: ScenarioResult
    done: int
    total: int


def share_out(runs: Sequence[RowRun], part: int = 1) -> None:
    """Divide the places of this machine among rows on the real clock, so that all are done at the same time.

    ``part``: of how many such runs beside each other this is one.
    """
    real = [run for run in runs if not run.row.virtual]
    places = A_CORE * cores() // part
    lasts = [run.shared_s() for run in real]
    for run, seconds in zip(real, lasts, strict=True):
        run.at_once = min(AT_ONCE, max(AT_LEAST, round(places * seconds / max(1.0, sum(lasts)))))


class RowRun:
    """One row being played; ``report`` at any time is what there is so far."""

    def __init__(
        self, row: Row, suites: Suites, selection: Selection, results: Path, *, ports: range, control: Control | None,
        watch: Callable[[Progress], None], launch: Launch = PLAIN,
    ) -> None:  # fmt: skip
        self.row = row
        self.suites = suites
        self.selection = selection
        self.results = folder_for(results, row.name, narrowed=selection.by_name)
        self.folder = self.results / row.name
        self._ports = ports
        self.at_once = AT_ONCE
        """Plays that share a process at a time; `share_out`."""
        self._control = control
        self._launch = launch
        self.watch = watch
        self._lock = threading.Lock()
        self._begun = time.monotonic()
        self._results: dict[str, ScenarioResult] = {}
        self._done = 0
        self._observations: dict[str, list[Observation]] = {}
        self._casualties: list[Casualty] = []
        self._to_play: dict[str, Loaded] = {}
        self._pool: Pool | None = None
        self.broken = ""
        missing = {**lacking(), **row.lacking}
        for one in selection.choose(suites):
            decision = decide(one, row.declaration, missing)
            if decision.status == "play":
                self._to_play[one.key] = one
            else:
                self._results[one.key] = _result(one, decision.status, reason=decision.reason)

    @property
    def total(self) -> int:
        """Scenarios to play."""
        return len(self._to_play)

    def shared_s(self) -> float:
        """How long its plays that share a process would last one after another, s."""
        shared = [one for one in self._to_play.values() if one.scenario.needs.process == "shared"]
        plans = [make_plan(one, self.row, self.suites, self.folder) for one in shared]
        return sum(SET_UP_S + plan.expected_ns / 1e9 for plan in plans)

    def settled(self, result: ScenarioResult) -> bool:
        """Whether no further attempt will follow."""
        return result.verdict != "inconclusive" or self.row.virtual or len(result.attempts) >= ATTEMPTS

    def play(self) -> Report:
        """Play all, write ``report.json``; also when interrupted."""
        traces = self.folder / "traces"
        traces.mkdir(parents=True, exist_ok=True)
        for old in traces.iterdir():
            shutil.rmtree(old) if old.is_dir() else old.unlink()
        self._pool = pool = Pool(
            self.folder / "worker.log", virtual=self.row.virtual, ended=self._ended,
            casualty=self._casualties.append, launch=self._launch,
        )  # fmt: skip
        (self.folder / "worker.log").write_bytes(b"")
        waiting = list(self._to_play.values())
        try:
            for number in range(1, ATTEMPTS + 1):
                self._round(pool, waiting, number)
                waiting = [one for one in waiting if self._results[one.key].verdict == "inconclusive"]
                if self.row.virtual:  # time stood still for it: a repeat would be the same
                    break
        except WorkerBroken as error:
            self.broken = str(error)
        finally:
            report = self.report()
            write_report(self.results, report)
        return report

    def stop(self) -> None:
        """End the run early; what was judged stays."""
        if self._pool is not None:
            self._pool.stop()

    def _round(self, pool: Pool, scenarios: Sequence[Loaded], number: int) -> None:
        plans = [
            make_plan(
                one, self.row, self.suites, self.folder / "traces",
                attempt=number, stretch=2 ** (number - 1), ports=self._ports, patience=self._launch.patience,
            )
            for one in scenarios
        ]  # fmt: skip
        wanted = {plan.key: self._to_play[plan.key].scenario.needs.process for plan in plans}
        together = [plan for plan in plans if wanted[plan.key] == "shared"]
        alone = [plan for plan in plans if wanted[plan.key] == "alone"]
        # A process each for the others; one for those that must not share it at the same time.
        parts = [part for part in (alone, *([plan] for plan in plans if wanted[plan.key] == "own")) if part]
        # The longest first, so that nothing long is left over at the end.
        together.sort(key=lambda plan: -plan.expected_ns)
        parts.sort(key=lambda part: -sum(plan.expected_ns for plan in part))
        at_once = max(1, min(self.at_once >> (number - 1), self.row.declaration.bounds.sessions // 2))
        with self._beside(pool, parts):
            if together:
                pool.play(together, at_once)

    @contextlib.contextmanager
    def _beside(self, pool: Pool, parts: Sequence[Sequence[Plan]]) -> Iterator[None]:
        """Plays each part in a process while other things go on, or after that where somebody looks at each process.

        They begin in this order.
        """
        if self._launch.wrap or self._launch.debug:
            yield
            for part in parts:
                pool.play(part, 1)
            return
        lanes = max(1, BESIDE * self.at_once // AT_ONCE)
        places = queue.SimpleQueue[int]()
        for lane in range(lanes):
            places.put(AT_ONCE + lane)

        waiting = collections.deque(parts)

        def play_next() -> None:
            place = places.get()
            try:
                pool.play(waiting.popleft(), 1, place)
            finally:
                places.put(place)

        with ThreadPoolExecutor(BESIDE, thread_name_prefix=self.row.name) as executor:
            playing = [executor.submit(play_next) for _ in parts]
            try:
                yield
            except BaseException:
                executor.shutdown(wait=False, cancel_futures=True)
                raise
            for lane in range(lanes, BESIDE):
                places.put(AT_ONCE + lane)
            for each in playing:
                each.result()

    def _ended(self, ended: Ended) -> None:
        one = self._to_play[ended.plan.key]
        file = Path(ended.plan.trace)
        try:
            trace = read_trace(file)
            verdict = judge(trace)
        except FormatError as error:  # costs this scenario, not the row
            trace = Trace(ended.plan.header)
            verdict = Verdict(verdict="error", reason=str(error))
        attempt = Attempt(
            number=trace.header.attempt,
            T_ns=trace.header.quantities["T"],
            trace=str(file.relative_to(self.folder)),
            verdict=verdict,
            seconds=round(ended.seconds, 3),
        )
        with self._lock:
            former = self._results.get(one.key)
            result = _result(
                one,
                "played",
                verdict=verdict.verdict,
                attempts=(*(former.attempts if former else ()), attempt),
                fired=fired(trace),
            )
            result = msgspec.structs.replace(result, known=self._known(result))
            self._results[one.key] = result
            self._observations[one.key] = observe(trace, pings=verdict.verdict != "inconclusive")
            self._done += former is None
            done = self._done
        self.watch(Progress(self.row, result, done, self.total))

    def _known(self, result: ScenarioResult) -> str:
        """The key of the ``[[known]]`` entries that cover all that this scenario fails on; else empty."""
        verdict = result.last
        if verdict is None or verdict.verdict != "fail":
            return ""
        failed = {id_ for finding in verdict.failed() for id_ in finding.proves if self.suites.levels[id_] == "must"}
        entries = in_force(self.row.declaration, self.row.versions)
        found = [covering(entries, result, requirement) for requirement in sorted(failed)]
        return found[0].key if found and found[0] is not None and None not in found else ""

    def report(self) -> Report:
        """What is known so far."""
        results = tuple(self._results[key] for key in sorted(self._results))
        partial, why = self._partial()
        report = Report(
            format=FORMAT,
            tool=__version__,
            suites_version=self.suites.version,
            digest=self.suites.digest,
            profile=self.selection.profile,
            partial=partial,
            narrowed=self.selection.by_name,
            why_partial=why,
            row=self.row.name,
            backend=self.row.declaration.name,
            variant=self.row.variant,
            asked=self.row.asked,
            available=not self.broken,
            unavailable_reason=self.broken,
            declaration=self.row.declaration,
            clock="virtual" if self.row.virtual else "real",
            versions=dict(self.row.versions),
            results=results,
            observations=tally(one for seen in self._observations.values() for one in seen),
            incidents=tuple(self._incidents()),
            control=self._control,
            seconds=round(time.monotonic() - self._begun, 1),
            host=describe_host(),
        )
        return msgspec.structs.replace(report, differences=tuple(differences(report, self.suites.levels)))

    def _partial(self) -> tuple[bool, str]:
        left_out = len(self.suites.scenarios) - len(self._results) - sum(k not in self._results for k in self._to_play)
        missing = sum(key not in self._results for key in self._to_play)
        reasons = [
            f"{left_out} of {len(self.suites.scenarios)} scenarios left out" if left_out else "",
            f"interrupted: {missing} of {self.total} scenarios not played" if missing and not left_out else "",
            self.row.provisional,
        ]
        return any(reasons), "; ".join(filter(None, reasons))

    def _incidents(self) -> list[Incident]:
        return [
            Incident(
                what=one.what,
                detail=one.detail,
                scenarios=one.keys,
                reproduced=any(self._died(key) for key in one.keys),
            )
            for one in self._casualties
        ]

    def _died(self, key: str) -> bool:
        result = self._results.get(key)
        return result is not None and result.verdict == "fail"


def _result(one: Loaded, status: Status, **fields: Any) -> ScenarioResult:
    scenario = one.scenario
    needed = claims_needed(scenario)
    return ScenarioResult(
        key=one.key, id=scenario.id, suite=one.suite, source=one.source, title=scenario.title, profile=scenario.profile,
        parameters=one.parameters, canonical=scenario.canonical, refusal=scenario.refusal,
        needs=tuple(kind.label for kind in EventKind if kind.label in needed),
        status=status, proves=proven(one), **fields,
    )  # fmt: skip
