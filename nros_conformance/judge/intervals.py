"""Interval arithmetic of possible worlds.

Everything that happened lies somewhere in an interval of nanoseconds. A statement holds *surely* if
it holds wherever each thing lies in its interval, *maybe* if there is a place for each where it does.
Widening an interval makes less sure and more possible.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from nros_conformance.judge.results import Outcome

INF = 2**62
"""Later than everything in a trace, so that unbounded windows need no special case."""


class Interval(NamedTuple):
    """Both ends belong to it."""

    lo: int
    hi: int

    def shifted(self, ns: int) -> Interval:
        """The same, ``ns`` later."""
        return Interval(self.lo + ns, self.hi + ns)


EVER = Interval(-INF, INF)
"""The time of something of which nothing is known."""


def instant(t: int) -> Interval:
    """The interval of something whose time is known exactly."""
    return Interval(t, t)


def surely_between(when: Interval, since: Interval, until: Interval) -> bool:
    """Whether it is certain that ``when`` lies after ``since`` and before ``until``; the borders are outside."""
    return since.hi < when.lo and when.hi < until.lo


def maybe_between(when: Interval, since: Interval, until: Interval) -> bool:
    """Whether ``when`` can lie after ``since`` and before ``until``."""
    return since.lo < when.hi and when.lo < until.hi


def decide(violated: bool, doubtful: bool) -> Outcome:
    """The outcome when every, respectively at least one, possible world violates an expectation."""
    return "fail" if violated else "unclear" if doubtful else "pass"


_ORDER: tuple[Outcome, ...] = ("fail", "unclear", "pass", "none")


def worst(outcomes: Iterable[Outcome]) -> Outcome:
    """All of them have to hold: the first of fail, unclear, pass that occurs; none if nothing else does."""
    return min(outcomes, key=_ORDER.index, default="none")
