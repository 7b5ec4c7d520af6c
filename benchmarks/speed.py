"""How fast: the real clock against its longest scenario, the virtual clock, and the judge.

python benchmarks/speed.py [--backend cyclone]
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from nros_conformance.campaign.control import find_control
from nros_conformance.campaign.plans import Row, make_plan
from nros_conformance.campaign.selection import Selection, decide
from nros_conformance.judge.judge import judge
from nros_conformance.play.adapters import load_adapter
from nros_conformance.play.player import play_virtually
from nros_conformance.report.results import read_report
from nros_conformance.suite.loader import load_suites
from nros_conformance.trace.files import read_trace
from nros_conformance.trace.records import Header, Trace


def real(backend: str) -> None:
    """Wall time of a whole run against its longest scenario and against the sum of all."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        begun = time.monotonic()
        command = [
            sys.executable,
            "-m",
            "nros_conformance.cli.main",
            "run",
            "--backend",
            backend,
            "--profile",
            "publish",
        ]
        subprocess.run([*command, "--results", str(folder)], capture_output=True, check=False)
        wall = time.monotonic() - begun
        report = read_report(folder / backend)
        seconds = [attempt.seconds for result in report.results for attempt in result.attempts]
        print(
            f"{backend}: {len(seconds)} plays; command {wall:.1f} s, playing and judging {report.seconds:.1f} s; "
            f"longest {max(seconds):.1f} s, sum {sum(seconds):.1f} s: "
            f"{report.seconds / max(seconds):.2f} x the longest, {sum(seconds) / report.seconds:.0f} at once"
        )
        traces = [
            read_trace(folder / backend / attempt.trace) for result in report.results for attempt in result.attempts
        ]  # fmt: skip
    judged(traces)


def virtual(rounds: int = 5) -> None:
    """Scenarios per second on the virtual clock, play and judge."""
    suites, control = load_suites(), find_control()
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
    parser.add_argument("--backend", default="cyclone")
    options = parser.parse_args()
    real(options.backend)
    virtual()


if __name__ == "__main__":
    main()
