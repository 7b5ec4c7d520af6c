"""What the judge says, as data that reports store."""

from __future__ import annotations

from typing import Literal, TypeAlias

from msgspec import Struct

Outcome: TypeAlias = Literal["pass", "fail", "unclear", "none"]
"""Of one expectation. ``none``: it does not apply here, or the trace holds no evidence either way."""

VerdictName: TypeAlias = Literal["pass", "warn", "none", "inconclusive", "fail", "error"]


class Finding(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One expectation, implied invariant or condition, judged."""

    name: str
    """How the suite states it: ``periodic RequestedDeadlineMissed of listener``, ``changes sum to totals``."""
    proves: tuple[str, ...] = ()
    outcome: Outcome
    implied: bool = False
    wanted: str = ""
    got: str = ""
    nearest_ns: int | None = None
    """By how much a failed or unclear one missed: positive is too late, negative too early."""
    surplus: int | None = None
    """By how many a failed or unclear one missed: positive is too many, negative too few."""
    at: int | None = None
    """The moment to look at in the timeline."""


class Verdict(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One scenario on one backend, judged from one trace."""

    verdict: VerdictName
    reason: str = ""
    """One line: why not pass."""
    findings: tuple[Finding, ...] = ()
    warnings: tuple[str, ...] = ()
    """Should-requirements that are violated."""

    def failed(self) -> tuple[Finding, ...]:
        """The findings that decide a fail."""
        return tuple(f for f in self.findings if f.outcome == "fail")
