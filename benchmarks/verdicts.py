"""No false verdict: the reference, which is right by definition, gets the same verdict however often it is played.

Each scenario is played 200 times in virtual time, each time with another seed, 100 times on simulated hosts that are
too slow (`tests.suites.slow_host`), and 20 times in real time while every core is kept busy by other processes.
Anything but one same verdict is printed; inconclusive ones are allowed where time is short, and counted. Real time
leaves out what needs a process per session, because the sessions share one world.

    python -m benchmarks.verdicts [--virtual 200] [--slow 100] [--real 20] [--at-once 24] [--suite NAME]
"""

from __future__ import annotations

import argparse
import functools
import itertools
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import msgspec

from benchmarks.false_failures import load
from nros_conformance.campaign.control import find_control
from nros_conformance.campaign.plans import Row, make_plan
from nros_conformance.campaign.run import RowRun
from nros_conformance.campaign.selection import Selection, decide
from nros_conformance.judge.judge import judge
from nros_conformance.play.adapters import load_adapter
from nros_conformance.play.leases import lease_ports
from nros_conformance.play.player import play_virtually
from nros_conformance.suite.loader import Loaded, Suites, load_suites
from nros_conformance.trace.records import Header, Trace
from tests.suites.slow_host import HOSTS, play_slowly, reference_row

CYCLES = ("lif.many", "lif.session-cycles")
"""Thousands of the same take long, and tell no more."""


class Job(NamedTuple):
    """A share of the scenarios to play in virtual time, so many times each; ``slow``: see `HOSTS`."""

    keys: tuple[str, ...]
    plays: int
    slow: bool = False


def control_row() -> Row:
    """The reference on its virtual clock."""
    found = find_control()
    assert found.declaration is not None
    return Row(found.declaration, found.adapter)


@functools.cache
def everything() -> Suites:
    """The shipped suites, loaded once in each process."""
    return load_suites()


def play_share(job: Job) -> dict[str, Counter[str]]:
    """By scenario: how often each verdict came, with its reason."""
    chosen = Selection("publish", keys=frozenset(job.keys)).choose(everything())
    play = played_slowly if job.slow else played_virtually
    return {one.key: Counter(play(one, job.plays)) for one in chosen}


def played_virtually(one: Loaded, plays: int) -> Iterator[str]:
    """The verdicts of so many plays, each with another seed."""
    row = control_row()
    adapter, plan = load_adapter(row.adapter), make_plan(one, row, everything(), Path())
    for seed in range(plays):
        seeded = msgspec.structs.replace(plan, header=msgspec.structs.replace(plan.header, seed=seed))
        header, *records = play_virtually(seeded, adapter)
        assert isinstance(header, Header)
        verdict = judge(Trace(header, tuple(records)))  # type: ignore[arg-type]
        yield f"{verdict.verdict} {verdict.reason}".strip()


def played_slowly(one: Loaded, plays: int) -> Iterator[str]:
    """The verdicts of so many plays, on each of `HOSTS` in turn; why and how to see it again, if it is a false one."""
    row = reference_row()
    adapter, plan = load_adapter(row.adapter), make_plan(one, row, everything(), Path())
    for seed, host in zip(range(plays), itertools.cycle(HOSTS.values())):
        verdict = play_slowly(plan, adapter, seed, *host)
        false = verdict.verdict not in ("pass", "inconclusive")
        yield f"{verdict.verdict} {verdict.reason}, {seed=}" if false else verdict.verdict


def virtual(plays: int, suites: tuple[str, ...], *, slow: bool) -> int:
    """Play all in two processes. How many scenarios had another verdict than they may."""
    row = reference_row() if slow else control_row()
    keys = [
        one.key
        for one in Selection("publish", suites).choose(everything())
        if decide(one, row.declaration).status == "play" and not (slow and one.key.startswith(CYCLES))
    ]
    shares = [Job(tuple(keys[first : first + 20]), plays, slow) for first in range(0, len(keys), 20)]
    begun, wrong, unclear = time.monotonic(), 0, 0
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for counted in pool.map(play_share, shares):
            for key, verdicts in counted.items():
                unclear += verdicts.pop("inconclusive", 0) if slow else 0
                if set(verdicts) - {"pass"}:
                    wrong += 1
                    print(f"  {key}: {dict(verdicts)}", flush=True)
    host, doubts = ("slow hosts", f", {unclear} plays inconclusive") if slow else ("virtual time", "")
    print(
        f"{host}: {len(keys)} scenarios x {plays} plays, {wrong} with anything but passes{doubts}; "
        f"{time.monotonic() - begun:.0f} s",
        flush=True,
    )
    return wrong


def one_round(at_once: int, suites: tuple[str, ...]) -> Iterator[tuple[str, tuple[str, ...], str]]:
    """All scenarios once in real time: key, the verdicts of all attempts, the last reason."""
    chosen = Selection("publish", suites).choose(everything())
    keys = frozenset(
        one.key for one in chosen if all(session.process != "own" for session in one.scenario.sessions.values())
    )
    with lease_ports() as ports, tempfile.TemporaryDirectory() as folder:
        run = RowRun(
            reference_row(), everything(), Selection("publish", keys=keys), Path(folder), ports=ports,
            control=None, watch=lambda progress: None,
        )  # fmt: skip
        run.at_once = at_once
        for result in run.play().results:
            if result.attempts:
                verdicts = tuple(attempt.verdict.verdict for attempt in result.attempts)
                yield result.key, verdicts, result.attempts[-1].verdict.reason


def real(rounds: int, at_once: int, hogs: int, suites: tuple[str, ...]) -> int:
    """Play all in rounds, under load. The number of plays that were judged, and not passed."""
    wrong, plays, unclear, begun = 0, 0, Counter[str](), time.monotonic()
    unsettled: Counter[str] = Counter()
    with load(hogs):
        for number in range(1, rounds + 1):
            round_begun, wrong_before = time.monotonic(), wrong
            for key, verdicts, reason in one_round(at_once, suites):
                plays += len(verdicts)
                unclear[key] += sum(verdict == "inconclusive" for verdict in verdicts)
                unsettled[key] += verdicts[-1] == "inconclusive"
                if verdicts[-1] not in ("pass", "inconclusive"):
                    wrong += 1
                    print(f"  round {number}: {key}: {verdicts[-1]}: {reason}", flush=True)
            print(
                f"  round {number}: {time.monotonic() - round_begun:.0f} s, {wrong - wrong_before} false verdicts",
                flush=True,
            )
    print(
        f"real time, {hogs} busy processes: {len(unclear)} scenarios x {rounds} rounds, {plays} plays: "
        f"{wrong} false verdicts; {unclear.total()} plays inconclusive, {unsettled.total()} of them after repeats; "
        f"{time.monotonic() - begun:.0f} s"
    )
    for key, times in unclear.most_common(10):
        if times:
            print(f"  inconclusive {times} times: {key}")
    return wrong


def main() -> None:
    """Play, count, print; exit 1 after a false verdict."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--virtual", type=int, default=200, metavar="PLAYS")
    parser.add_argument("--slow", type=int, default=100, metavar="PLAYS")
    parser.add_argument("--real", type=int, default=20, metavar="ROUNDS")
    parser.add_argument("--at-once", type=int, default=24)
    parser.add_argument("--hogs", type=int, default=os.cpu_count() or 1, metavar="PROCESSES")
    parser.add_argument("--suite", action="append", default=[])
    options = parser.parse_args()
    suites = tuple(options.suite)
    wrong = virtual(options.virtual, suites, slow=False) if options.virtual else 0
    wrong += virtual(options.slow, suites, slow=True) if options.slow else 0
    wrong += real(options.real, options.at_once, options.hogs, suites) if options.real else 0
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
