"""The proof of the judge: many full runs on an idle and on a loaded host, without one false failure.

A correct backend (Cyclone's deviations are all declared) is played again and again, first on an idle
host, then with every core kept busy by other processes. Prints failures and unclear scenarios, before
and after repeats. Not for CI: 20 runs take some minutes.

    python benchmarks/false_failures.py [--backend cyclone] [--runs 10]
"""

from __future__ import annotations

import argparse
import contextlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from nros_conformance.report.results import Report, read_report


@contextlib.contextmanager
def load(processes: int) -> Iterator[None]:
    """Busy loops in processes of their own."""
    hogs = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(processes)]
    try:
        yield
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()


def one_run(backend: str, folder: Path, profile: str, suites: Sequence[str]) -> tuple[Report, float]:
    """A run of the command as a user makes it: its report, and the wall time, s."""
    begun = time.monotonic()
    command = [sys.executable, "-m", "nros_conformance.cli.main", "run", "--backend", backend, "--profile", profile]
    command += [argument for suite in suites for argument in ("--suite", suite)]
    subprocess.run([*command, "--results", str(folder)], capture_output=True, check=False)
    return read_report(folder / backend), time.monotonic() - begun


def main() -> None:
    """Run, count, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backend", default="cyclone")
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--profile", default="publish")
    parser.add_argument("--suite", action="append", default=[])
    options = parser.parse_args()
    false_failures = 0
    cores = os.cpu_count() or 1
    for name, hogs in (("idle", 0), ("loaded", cores)):
        first_unclear, last_unclear, played, seconds = 0, 0, 0, []
        with load(hogs):
            for number in range(options.runs):
                with tempfile.TemporaryDirectory() as folder:
                    report, wall = one_run(options.backend, Path(folder), options.profile, options.suite)
                results = [result for result in report.results if result.attempts]
                failed = [result for result in results if result.verdict in ("fail", "error") and not result.known]
                first_unclear += sum(result.attempts[0].verdict.verdict == "inconclusive" for result in results)
                last_unclear += sum(result.verdict == "inconclusive" for result in results)
                played += len(results)
                seconds.append(wall)
                false_failures += len(failed)
                for result in failed:
                    print(
                        f"  {name} run {number}: {result.key}: {result.last.reason if result.last else ''}", flush=True
                    )
        print(
            f"{name:<7} {options.runs} runs, {played} plays of {options.backend}: {false_failures} failures so far, "
            f"{first_unclear} unclear at first, {last_unclear} after repeats; "
            f"{min(seconds):.1f} to {max(seconds):.1f} s a run",
            flush=True,
        )
    sys.exit(1 if false_failures else 0)


if __name__ == "__main__":
    main()
