"""``nros-conformance explore``."""

from __future__ import annotations

import argparse
import contextlib
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from nros_conformance.campaign.rows import find_rows, rows_of
from nros_conformance.cli.codes import ExitCode
from nros_conformance.cli.progress import ProgressLine
from nros_conformance.explore.explore import ENOUGH, PLAYS, Comparison, Deviation, Search, compare, explore
from nros_conformance.explore.stand import Stand, left_out
from nros_conformance.explore.timelines import Timeline
from nros_conformance.explore.writing import as_suite
from nros_conformance.play.leases import lease_ports
from nros_conformance.suite.loader import Suites, load_suites

REAL = (
    "the clock is real: the seed gives the timelines, but not what they show; what is told failed in at least "
    f"{ENOUGH} of {PLAYS} plays"
)  # fmt: skip


def run(options: argparse.Namespace) -> ExitCode:
    """Search, or compare two backends; exit 1 when something was found."""
    suites = load_suites(options.suites)
    line = ProgressLine(sys.stderr)

    def watch(doing: str, done: int, total: int) -> None:
        line.update(doing, done, total, failed=False)

    with contextlib.ExitStack() as stack:
        stands = _stands(options.backend, suites, stack)
        others = _stands(options.against, suites, stack) if options.against is not None else []
        if not stands or (options.against is not None and not others):
            return ExitCode.NOTHING
        for text in left_out(stand.cast for stand in [*stands, *others]):
            print(f"left out {text}")
        if others:
            first, second = stands[0], others[0]
            comparison = compare(first, second, options.examples, options.seed, watch)
            line.clear()
            print(compared(comparison, first.name, second.name, options.seed))
            _say_real([first, second])
            return ExitCode.FAILED if any(not one.known for one in comparison.differences) else ExitCode.OK
        found: list[Deviation] = []
        for stand in stands:
            search = explore(stand, options.examples, options.seed, watch)
            line.clear()
            print(told(search, stand.name, options.seed))
            found += search.found
        _say_real(stands)
    if not found:
        return ExitCode.OK
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_text(as_suite(found), encoding="utf-8")
    print(f"written  {options.output}")
    print(f"play it  nros-conformance run --backend {options.backend} --suites {options.output.parent}")
    return ExitCode.FAILED


def told(search: Search, row: str, seed: int) -> str:
    """What came of a search."""
    found = f"{len(search.found)} found" if search.found else "nothing found"
    lines = [f"{row}: {search.timelines} timelines, seed {seed}: {found}"]
    lines += [f"  known    {key} in {_timelines(times)}" for key, times in sorted(search.known.items())]
    lines += _doubtful(search.once, search.unclear)
    for number, one in enumerate(search.found, 1):
        alike = f" (and {_timelines(one.others)} more)" if one.others else ""
        lines += ["", f"{number}  {one.verdict.reason}{alike}", ""]
        lines += [f"     {index:>2}  {_action(action)}" for index, action in enumerate(one.timeline.actions, 1)]
        lines += [f"         events: {', '.join(kind.label for kind in one.timeline.kinds)}"]
    return "\n".join([*lines, ""] if search.found else lines)


def compared(comparison: Comparison, first: str, second: str, seed: int) -> str:
    """What two backends do differently, by requirement."""
    head = f"{first} and {second}: {comparison.timelines} timelines, seed {seed}: "
    lines = [head + (f"{len(comparison.differences)} differences" if comparison.differences else "no difference")]
    lines += _doubtful(comparison.once, comparison.unclear)
    for one in comparison.differences:
        known = f", known as {one.known}" if one.known else ""
        lines += ["", f"{one.requirement}  {one.by} alone fails, in {_timelines(one.times)}{known}"]
        lines += [f"         shortest: {_actions(one.timeline)}", f"         {one.verdict.reason}"]
    return "\n".join(lines)


def _doubtful(once: Mapping[str, int], unclear: int) -> Iterator[str]:
    for cause, times in sorted(once.items()):
        yield f"  once     {cause} in {_timelines(times)}, and not when played again"
    if unclear:
        yield f"  unclear  {_timelines(unclear)}"


def _timelines(number: int) -> str:
    return f"{number} timeline{'s' * (number != 1)}"


def _say_real(stands: Sequence[Stand]) -> None:
    if any(not stand.row.virtual for stand in stands):
        print(REAL)


def _actions(timeline: Timeline) -> str:
    return ", ".join(_action(action) for action in timeline.actions) or "nothing but a drive"


def _action(action: object) -> str:
    verb, subject, count = (getattr(action, name) for name in ("verb", "subject", "count"))
    if verb in ("drive", "idle"):
        return f"{verb} {count / 2:g}T"
    return f"{verb} {subject}" + (f" x{count}" if count > 1 else "")


def _stands(name: str, suites: Suites, stack: contextlib.ExitStack) -> list[Stand]:
    """One for each row of the backend; none, with the command that installs it, when its middleware is missing."""
    found = find_rows(name)
    if found.error is not None:
        raise found.error
    assert found.declaration is not None
    lacking = found.unavailable()
    if lacking is not None:
        print(f"{found.name:<8} missing: {lacking.reason}; install it: {lacking.install}", file=sys.stderr)
        return []
    asked = found.adapter if found.adapter == name else ""
    return [
        Stand(
            row, found.load(), suites, Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="nros-explore-"))),
            stack.enter_context(lease_ports()),
        )
        for row in rows_of(found, found.declaration, asked)
    ]  # fmt: skip
