"""Searches for timelines that a backend plays otherwise than the model, or than another backend."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from nros_conformance.explore.search import generate, shrink, size
from nros_conformance.explore.stand import CRASHED, Outcome, Stand
from nros_conformance.explore.timelines import Timeline
from nros_conformance.judge.results import Verdict

PLAYS, ENOUGH = 3, 2
"""On the real clock a timeline departs from the model when it does so in so many of so many plays."""

CANDIDATES = 6
"""Timelines that are played again, the shortest first, before a failure counts as one that does not come back."""

Watch = Callable[[str, int, int], None]
"""``watch(doing, done, total)``."""


def _quietly(_doing: str, _done: int, _total: int) -> None:
    pass


@dataclasses.dataclass(frozen=True, slots=True)
class Deviation:
    """The shortest timeline that was found, its scenario, what the judge says, and how many others failed alike."""

    timeline: Timeline
    scenario: dict[str, Any]
    verdict: Verdict
    others: int = 0


@dataclasses.dataclass(slots=True)
class Search:
    """What came of it. ``plays`` counts those of repeating and shrinking too.

    ``known``: by the key of the known deviation, how many timelines showed it. ``once``: what failed and did not do
    so again, by cause.
    """

    timelines: int
    found: list[Deviation] = dataclasses.field(default_factory=list)
    known: Counter[str] = dataclasses.field(default_factory=Counter)
    once: Counter[str] = dataclasses.field(default_factory=Counter)
    unclear: int = 0
    plays: int = 0


def explore(stand: Stand, examples: int, seed: int, watch: Watch = _quietly) -> Search:
    """Play so many generated timelines; of each cause of failure the shortest timeline is shrunk.

    Raises `HypothesisMissing`.
    """
    timelines = generate(stand.cast, examples, seed)
    before, search = stand.played, Search(len(timelines))
    failing: dict[str, list[Timeline]] = {}
    for timeline, outcome in zip(timelines, _all(stand, timelines, watch), strict=True):
        search.unclear += outcome.unclear
        if outcome.known:
            search.known[outcome.known] += 1
        elif outcome.fails:
            failing.setdefault(outcome.cause, []).append(timeline)
    for cause, guilty in sorted(failing.items()):
        alike = _Alike(stand, lambda outcome, cause=cause: outcome.fails and outcome.cause == cause)  # type: ignore[misc]
        first = next((one for one in sorted(guilty, key=size)[:CANDIDATES] if alike([one], failed=1)[0]), None)
        if first is None:
            search.once[cause] += len(guilty)
            continue
        watch(f"shrink {cause}", 0, 1)
        shortest = shrink(first, alike, _batch(stand, cause))
        raw = stand.compose(shortest, f"x.{stand.name}-{len(search.found) + 1}")
        search.found.append(Deviation(shortest, raw, alike.last[shortest], len(guilty) - 1))
    search.plays = stand.played - before
    return search


def _batch(stand: Stand, cause: str) -> int:
    """How many shorter timelines are played together: a crash is shared by all that are in flight."""
    return 1 if stand.row.virtual or cause == CRASHED else 1000


def _all(stand: Stand, timelines: Sequence[Timeline], watch: Watch) -> list[Outcome]:
    done = 0

    def step() -> None:
        nonlocal done
        done += 1
        watch(stand.name, done, len(timelines))

    return stand.play(timelines, step)


class _Alike:
    """Says which timelines fail in a given way; ``last`` is what the judge said last of each that did."""

    def __init__(self, stand: Stand, guilty: Callable[[Outcome], bool]) -> None:
        self._stand = stand
        self.guilty = guilty
        self.last: dict[Timeline, Verdict] = {}

    def __call__(self, timelines: Sequence[Timeline], failed: int = 0) -> list[bool]:
        """``failed``: so often they have failed already, in as many plays. Who does not fail at first is fine."""
        times = dict.fromkeys(timelines, failed)
        plays, enough = (1 + failed, 1 + failed) if self._stand.row.virtual else (PLAYS, ENOUGH)
        for number in range(failed, plays):
            again = [
                one for one, so_far in times.items()
                if so_far < enough and so_far >= number - (plays - enough) and (so_far or not number)
            ]  # fmt: skip
            for one, outcome in zip(again, self._stand.play(again) if again else [], strict=True):
                if self.guilty(outcome):
                    times[one] += 1
                    self.last[one] = outcome.verdict
        return [times[one] >= enough for one in timelines]


@dataclasses.dataclass(frozen=True, slots=True)
class Difference:
    """What one backend does otherwise than the model, and the other one does not.

    ``by``: which one; ``times``: in how many timelines; ``known``: the known deviation that it is.
    """

    requirement: str
    by: str
    times: int
    timeline: Timeline
    verdict: Verdict
    known: str = ""


@dataclasses.dataclass(slots=True)
class Comparison:
    """What two backends do differently. ``unclear``: timelines that one of the two left open."""

    timelines: int
    differences: list[Difference] = dataclasses.field(default_factory=list)
    once: Counter[str] = dataclasses.field(default_factory=Counter)
    unclear: int = 0


def compare(first: Stand, second: Stand, examples: int, seed: int, watch: Watch = _quietly) -> Comparison:
    """The same timelines on two backends; what only one of them claims or can do is left out.

    Raises `HypothesisMissing`.
    """
    first.cast = second.cast = first.cast.shared(second.cast)
    timelines = generate(first.cast, examples, seed)
    comparison = Comparison(len(timelines))
    outcomes = {stand: _all(stand, timelines, watch) for stand in (first, second)}
    guilty: dict[tuple[str, Stand, str], list[Timeline]] = {}
    for timeline, here, there in zip(timelines, outcomes[first], outcomes[second], strict=True):
        if here.unclear or there.unclear:
            comparison.unclear += 1
            continue
        for stand, mine, other in ((first, here, there), (second, there, here)):
            for requirement in mine.requirements - other.requirements:
                guilty.setdefault((requirement, stand, mine.known), []).append(timeline)
    for (requirement, stand, known), found in guilty.items():
        watch(f"repeat {requirement}", 0, 1)
        alike = _Alike(stand, lambda outcome, wanted=requirement: wanted in outcome.requirements)  # type: ignore[misc]
        unlike = _Alike(second if stand is first else first, alike.guilty)

        def alone(
            batch: Sequence[Timeline], failed: int = 0, alike: _Alike = alike, unlike: _Alike = unlike
        ) -> list[bool]:
            guilty = [one for one, bad in zip(batch, alike(batch, failed), strict=True) if bad]
            both = {one for one, bad in zip(guilty, unlike(guilty), strict=True) if bad}
            return [one in guilty and one not in both for one in batch]

        one = next((one for one in sorted(found, key=size)[:CANDIDATES] if alone([one], 1)[0]), None)
        if one is None:
            comparison.once[requirement] += len(found)
            continue
        shortest = shrink(one, alone, _batch(stand, requirement))
        verdict = alike.last[shortest]
        comparison.differences.append(Difference(requirement, stand.name, len(found), shortest, verdict, known))
    comparison.differences.sort(key=lambda one: (one.requirement, one.by))
    return comparison
