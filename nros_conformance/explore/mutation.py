"""Plays the scenarios that should expose a mutant until one of them does, in virtual time."""

from __future__ import annotations

import functools
import gc
import multiprocessing
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from nros_conformance.campaign.plans import Row, make_plan
from nros_conformance.campaign.selection import decide, proven
from nros_conformance.judge.judge import judge
from nros_conformance.judge.results import Finding
from nros_conformance.play.plan import expected_ns
from nros_conformance.play.player import play
from nros_conformance.report.mutation import MutantResult, MutationReport
from nros_conformance.rmw.backend import Backend
from nros_conformance.rmw.clock import Deadlock, VirtualClock
from nros_conformance.rmw.declaration import Declaration
from nros_conformance.rmw.discovery import find_backend
from nros_conformance.rmw.mutants import Mutant, find_mutants
from nros_conformance.suite.loader import Loaded, Suites, load_suites
from nros_conformance.trace.records import AnyRecord, End, Header, Trace

PLAY_S = 10
"""Of real time, far more than any play in virtual time takes: a mutant that never comes back is cut off."""

WORKERS = 2


class _Endless(BaseException):
    """A play that took too long; no backend catches it by accident."""


def _within(frame: FrameType | None, callbacks: Sequence[object]) -> bool:
    codes = [getattr(one, "__code__", None) for one in callbacks]
    while frame is not None:
        if frame.f_code in codes:
            return True
        frame = frame.f_back
    return False


@contextmanager
def _limited(seconds: float) -> Iterator[None]:
    collecting = list(gc.callbacks)

    def stop(_signal: int, frame: FrameType | None) -> None:
        if not _within(frame, collecting):
            raise _Endless
        # What a callback of the garbage collector raises goes to `sys.unraisablehook` and no further (Hypothesis has
        # one). Without them the next signal, or the one after it, is heard elsewhere.
        gc.callbacks.clear()

    former = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds, 0.01)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, former)
        gc.callbacks[:] = collecting


def play_defective(one: Loaded, row: Row, suites: Suites, adapter: type[Backend]) -> Trace:
    """One scenario on a backend that may hang or make all tasks wait for each other; main thread only."""
    plan = make_plan(one, row, suites, Path())
    records: list[Header | AnyRecord] = []
    clock = VirtualClock()
    try:
        with _limited(PLAY_S):
            clock.run(lambda: play(plan, adapter, clock, records.append))
    except _Endless:
        records.append(End(outcome="hang", t=clock.now_ns(), detail=f"the play did not end within {PLAY_S} s"))
    except Deadlock as deadlock:
        records.append(End(outcome="hang", t=clock.now_ns(), detail=str(deadlock)))
    header, *rest = records
    assert isinstance(header, Header)
    return Trace(header, tuple(rest))  # type: ignore[arg-type]


def exposed(trace: Trace, requirement: str) -> str:
    """What fails on this requirement, in words; empty when nothing does. A crash fails all that is proven."""
    verdict = judge(trace)
    if trace.end is not None and trace.end.outcome in ("crash", "hang", "raised"):
        return verdict.reason if requirement in trace.header.levels else ""
    failed: tuple[Finding, ...] = verdict.failed()
    return next((f"{one.name}: {one.got}" for one in failed if requirement in one.proves), "")


def candidates(suites: Suites, requirement: str, declaration: Declaration) -> list[Loaded]:
    """The scenarios with an expectation that proves it, the shortest first."""
    fitting = [
        one
        for one in suites.scenarios
        if requirement in proven(one) and decide(one, declaration).status == "play"
    ]  # fmt: skip
    bounds = {"tolerance": 0, "early": 0, **declaration.quantities()}
    return sorted(
        fitting, key=lambda one: expected_ns(one.scenario.script, {"T": one.scenario.scale.T.ns(bounds), **bounds})
    )


def try_mutant(mutant: Mutant, suites: Suites, row: Row) -> MutantResult:
    """Play until it is killed."""
    played = 0
    for one in candidates(suites, mutant.violates, row.declaration):
        played += 1
        why = exposed(play_defective(one, row, suites, mutant.adapter), mutant.violates)
        if why:
            return _result(mutant, played, one.key, why)
    return _result(mutant, played)


def run_mutants(
    suites: Suites, backend: str = "reference", *, only: Sequence[str] = (),
    watch: Callable[[MutantResult], None] = lambda result: None, workers: int = WORKERS,
) -> MutationReport:  # fmt: skip
    """All mutants of a backend, or those of these names, in worker processes."""
    begun = time.monotonic()
    names = [one.name for one in find_mutants().get(backend, ()) if not only or one.name in only]
    results = []
    # Forked workers would inherit locks of whatever runs here; a spawned one loads the suites once.
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        for result in pool.map(_try, [(str(suites.directory), backend, name) for name in names]):
            watch(result)
            results.append(result)
    return MutationReport(
        digest=suites.digest, backend=backend, mutants=tuple(results), seconds=round(time.monotonic() - begun, 1)
    )


def _try(job: tuple[str, str, str]) -> MutantResult:
    directory, backend, name = job
    suites, row, mutants = _prepared(directory, backend)
    return try_mutant(mutants[name], suites, row)


@functools.cache
def _prepared(directory: str, backend: str) -> tuple[Suites, Row, dict[str, Mutant]]:
    found = find_backend(backend)
    assert found.declaration is not None
    mutants = {one.name: one for one in find_mutants()[backend]}
    return load_suites(Path(directory)), Row(found.declaration, found.adapter), mutants


def _result(mutant: Mutant, played: int, killed_by: str = "", because: str = "") -> MutantResult:
    return MutantResult(
        name=mutant.name, defect=mutant.defect, violates=mutant.violates, says=mutant.says, killed_by=killed_by,
        because=because, played=played,
    )  # fmt: skip
