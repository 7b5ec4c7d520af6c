"""Exit codes, with pytest's meanings where pytest has one (DESIGN 5)."""

from __future__ import annotations

import enum
from collections.abc import Iterable


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
