"""The proof of the judge: many full runs on an idle and on a loaded host, without one false failure.

Backends whose deviations are all declared are played again and again: on an idle host, with every core kept busy by
other processes, and several runs at the same time, each the others' load. Prints each failure, and how many scenarios
were unclear, before and after repeats. Not for CI: a run of all rows takes minutes.

    python benchmarks/false_failures.py [--backend NAME]... [--runs 10] [--host idle|loaded|shared]...
"""

from __future__ import annotations

import argparse
import contextlib
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from nros_conformance.report.results import Report, read_reports

HOSTS = ("idle", "loaded", "shared")


@contextlib.contextmanager
def load(processes: int) -> Iterator[None]:
    """Busy loops in processes of their own."""
    busy = f"import os\nwhile os.getppid() == {os.getpid()}: pass"  # also when this one is killed
    hogs = [subprocess.Popen([sys.executable, "-c", busy]) for _ in range(processes)]
    try:
        yield
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()


def runs(command: Sequence[str], folders: Sequence[Path]) -> float:
    """Runs of the command as a user makes them, at the same time; the wall time of all, s."""
    begun = time.monotonic()
    started = []
    for folder in folders:
        folder.mkdir(parents=True)
        with (folder / "output.txt").open("wb") as output:
            started.append(subprocess.Popen([*command, "--results", str(folder)], stdout=output, stderr=output))
    for one in started:
        one.wait()
    return time.monotonic() - begun


def count(reports: Sequence[Report], label: str) -> Counter[str]:
    """How many were played, failed (printed), were unclear at first, and after all."""
    found = Counter[str]()
    for report in reports:
        if not report.available:
            found["failed"] += 1
            print(f"  {label}: {report.row} is not available: {report.unavailable_reason}", flush=True)
        for one in report.results:
            if not one.attempts:
                continue
            found["played"] += 1
            found["unclear at first"] += one.attempts[0].verdict.verdict == "inconclusive"
            found["unclear"] += one.verdict == "inconclusive"
            if one.verdict in ("fail", "error") and not one.known:
                found["failed"] += 1
                print(f"  {label}: {report.row} {one.key}: {one.attempts[-1].verdict.reason}", flush=True)
    return found


def series(host: str, number: int, command: Sequence[str], keep: Path) -> int:
    """That many runs on such a host; the false failures."""
    at_once = 2 if host == "shared" else 1
    totals, seconds = Counter[str](), []
    with load((os.cpu_count() or 1) if host == "loaded" else 0):
        for first in range(0, number, at_once):
            folders = [keep / f"{host}-{each}" for each in range(first, min(first + at_once, number))]
            seconds.append(runs(command, folders))
            for folder in folders:
                totals += count(read_reports(folder), folder.name)
    print(
        f"{host:<7} {number} runs, {totals['played']} scenarios: {totals['failed']} failures, "
        f"{totals['unclear at first']} unclear at first, {totals['unclear']} after repeats; "
        f"{min(seconds):.1f} to {max(seconds):.1f} s a run",
        flush=True,
    )
    return totals["failed"]


def main() -> None:
    """Run, count, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backend", action="append", default=[], help="all rows without it")
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--profile", default="publish")
    parser.add_argument("--suite", action="append", default=[])
    parser.add_argument("--host", action="append", choices=HOSTS, help="idle and loaded without it")
    parser.add_argument("--keep", type=Path, help="where the results stay")
    options = parser.parse_args()
    command = [sys.executable, "-m", "nros_conformance.cli.main", "run", "--profile", options.profile]
    command += [argument for name in options.backend for argument in ("--backend", name)]
    command += [argument for suite in options.suite for argument in ("--suite", suite)]
    with tempfile.TemporaryDirectory() as folder:
        keep = options.keep or Path(folder)
        failed = sum(series(host, options.runs, command, keep) for host in options.host or ("idle", "loaded"))
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
