"""Exit codes, with pytest's meanings where pytest has one (DESIGN 5)."""

from __future__ import annotations

import argparse
import enum
import shlex
from collections.abc import Iterable
from pathlib import Path

RESULTS = Path(".nros-conformance")
"""Where runs leave their results unless told otherwise."""


class ExitCode(enum.IntEnum):
    """What a command's exit code means."""

    OK = 0
    FAILED = 1
    INTERRUPTED = 2
    INTERNAL = 3
    USAGE = 4
    NOTHING = 5
    UNCLEAR = 8


_PRECEDENCE = (
    ExitCode.INTERNAL, ExitCode.USAGE, ExitCode.INTERRUPTED, ExitCode.FAILED, ExitCode.NOTHING, ExitCode.UNCLEAR,
)  # fmt: skip


def strongest(codes: Iterable[ExitCode]) -> ExitCode:
    """Of several codes at once the one that is reported."""
    present = set(codes)
    return next((code for code in _PRECEDENCE if code in present), ExitCode.OK)


def user_errors() -> tuple[type[Exception], ...]:
    """Exceptions whose text is the whole message: somebody gave us something that cannot be used."""
    from nros_conformance.campaign.selection import SelectionError
    from nros_conformance.explore.search import HypothesisMissing
    from nros_conformance.play.leases import NoPorts
    from nros_conformance.play.pool import WorkerBroken
    from nros_conformance.report.results import ReportError
    from nros_conformance.scaffold.project import ScaffoldError

    return (SelectionError, NoPorts, ReportError, HypothesisMissing, ScaffoldError, WorkerBroken)


def repeated(options: argparse.Namespace) -> str:
    """Where results and suites are, if not where every command looks: for the hints that name a command."""
    given = (("--results", options.results, RESULTS), ("--suites", options.suites, None))
    return "".join(f" {name} {shlex.quote(str(path))}" for name, path, usual in given if path != usual)
