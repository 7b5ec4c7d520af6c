"""How fast: the real clock against its longest scenario, the virtual clock, and the judge.

python benchmarks/speed.py [--backend NAME]... [--together]
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from nros_conformance.campaign.control import find_control
from nros_conformance.campaign.plans import Row, make_plan
from nros_conformance.campaign.selection import Selection, decide
from nros_conformance.judge.judge import judge
from nros_conformance.play.adapters import load_adapter
from nros_conformance.play.player import play_virtually
from nros_conformance.report.results import read_reports
from nros_conformance.suite.loader import Suites, load_suites
from nros_conformance.trace.files import read_trace
from nros_conformance.trace.records import Header, Trace


def real(backends: Sequence[str], suites: Suites, *, together: bool) -> None:
    """Wall time of a whole run; of each row the plays that share a process, against the longest of them.

    Those in processes of their own (a thousand cycles among them) and repeats of unclear ones go on beside and after;
    ``together`` leaves the former out, so that what is timed is how well those that wait do so together.
    """
    process = {one.key: one.scenario.needs.process for one in suites.scenarios}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        command = [sys.executable, "-m", "nros_conformance.cli.main", "run"]
        if together:
            standard = Selection("standard").choose(suites)
            ids = dict.fromkeys(one.scenario.id for one in standard if process[one.key] == "shared")
            command += [argument for id_ in ids for argument in ("--scenario", id_)]
        else:
            command += ["--profile", "publish"]
        command += [argument for backend in backends for argument in ("--backend", backend)]
        begun = time.monotonic()
        subprocess.run([*command, "--results", str(folder)], capture_output=True, check=False)
        wall = time.monotonic() - begun
        reports = read_reports(folder)
        print(f"{len(reports)} rows: command {wall:.1f} s")
        shared = {
            report.row: [
                (file.stat().st_mtime, attempt.seconds)
                for result in report.results if process[result.key] == "shared"
                for attempt in result.attempts if attempt.number == 1
                for file in [folder / report.row / attempt.trace]
            ]
            for report in reports
        }  # fmt: skip
        first = min(end - seconds for plays in shared.values() for end, seconds in plays)
        longest = max(seconds for plays in shared.values() for _, seconds in plays)
        for report in reports:
            plays, ends = shared[report.row], max(end for end, _ in shared[report.row]) - first
            print(
                f"{report.row}: {len(plays)} plays in a shared process, done {ends:.1f} s after the first of all rows "
                f"began: {ends / longest:.2f} x the longest ({longest:.1f} s); one after another they take "
                f"{sum(seconds for _, seconds in plays):.0f} s"
            )
        judged([read_trace(folder / report.row / attempt.trace) for report in reports
                for result in report.results for attempt in result.attempts])  # fmt: skip


def virtual(suites: Suites, rounds: int = 5) -> None:
    """Scenarios per second on the virtual clock, play and judge."""
    control = find_control()
    assert control.declaration is not None
    adapter, row = load_adapter(control.adapter), Row(control.declaration, control.adapter)
    chosen = [one for one in Selection("publish").choose(suites) if decide(one, control.declaration).status == "play"]
    plans = [make_plan(one, row, suites, Path()) for one in chosen]
    rates = []
    for _ in range(rounds):
        begun = time.perf_counter()
        for plan in plans:
            header, *records = play_virtually(plan, adapter)
            assert isinstance(header, Header)
            judge(Trace(header, tuple(records)))  # type: ignore[arg-type]
        rates.append(len(plans) / (time.perf_counter() - begun))
    print(f"virtual clock: {statistics.median(rates):.0f} scenarios/s, play and judge ({len(plans)} scenarios)")


def judged(traces: list[Trace], rounds: int = 20) -> None:
    """Microseconds per judged trace."""
    begun = time.perf_counter()
    for _ in range(rounds):
        for trace in traces:
            judge(trace)
    each = (time.perf_counter() - begun) / rounds / len(traces)
    records = statistics.mean(len(trace.records) for trace in traces)
    print(f"judge: {each * 1e6:.0f} us a trace of {records:.0f} records on average")


def main() -> None:
    """Print all three."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backend", action="append", help="all that are available without it")
    parser.add_argument("--together", action="store_true", help="only what shares a process, of the standard profile")
    options = parser.parse_args()
    suites = load_suites()
    real(options.backend or [], suites, together=options.together)
    virtual(suites)


if __name__ == "__main__":
    main()
