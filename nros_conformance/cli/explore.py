"""``nros-conformance explore``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping

from nros_conformance.campaign.plans import Row
from nros_conformance.cli.codes import ExitCode
from nros_conformance.cli.progress import ProgressLine
from nros_conformance.explore.explore import Search, Stand, as_suite, compare, explore
from nros_conformance.explore.timelines import Timeline
from nros_conformance.rmw.discovery import find_backend
from nros_conformance.suite.loader import Suites, load_suites


def run(options: argparse.Namespace) -> ExitCode:
    """Search, or compare two backends; exit 1 when something was found."""
    suites = load_suites(options.suites)
    stand = _stand(options.backend, suites)
    if options.against is not None:
        differences = compare(stand, _stand(options.against, suites), options.examples, options.seed)
        print(compared(differences, options.backend, options.against, options.examples))
        return ExitCode.FAILED if differences else ExitCode.OK
    line = ProgressLine(sys.stderr)
    search = explore(
        stand, options.examples, options.seed,
        lambda played: line.update("explore", min(played, options.examples), options.examples, failed=False),
    )  # fmt: skip
    line.clear()
    print(told(search, options.backend, options.seed))
    if search.found is None:
        return ExitCode.OK
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_text(as_suite(search.found), encoding="utf-8")
    print(f"written  {options.output}")
    return ExitCode.FAILED


def told(search: Search, backend: str, seed: int) -> str:
    """What came of a search."""
    if search.found is None:
        return f"{backend}: {search.played} timelines, seed {seed}: nothing found"
    found = search.found
    lines = [f"{backend}: after {search.played} timelines, seed {seed}: {found.verdict.reason}", ""]
    lines += [f"  {number}  {_action(action)}" for number, action in enumerate(found.timeline.actions, 1)]
    return "\n".join([*lines, ""])


def compared(
    differences: Mapping[str, tuple[int, int, Timeline]], first: str, second: str, examples: int
) -> str:  # fmt: skip
    """What two backends do differently, by requirement."""
    if not differences:
        return f"{first} and {second}: {examples} timelines, no difference"
    lines = [f"{'':<8}  {first} alone fails  {second} alone fails  shortest timeline"]
    for requirement, (here, there, timeline) in differences.items():
        actions = ", ".join(_action(action) for action in timeline.actions) or "nothing but a drive"
        lines.append(f"{requirement:<8}  {here:>{len(first) + 12}}  {there:>{len(second) + 12}}  {actions}")
    return "\n".join(lines)


def _action(action: object) -> str:
    verb, subject, count = (getattr(action, name) for name in ("verb", "subject", "count"))
    if verb in ("drive", "idle"):
        return f"{verb} {count / 2:g}T"
    return f"{verb} {subject}" + (f" x{count}" if count > 1 else "")


def _stand(name: str, suites: Suites) -> Stand:
    found = find_backend(name)
    if found.error is not None:
        raise found.error
    assert found.declaration is not None
    return Stand(Row(found.declaration, found.adapter), found.load(), suites)
