"""Generates timelines, and makes the one that departs from the model as short as it can be."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from nros_conformance.explore.cast import VERBS, Cast
from nros_conformance.explore.timelines import Action, Timeline

if TYPE_CHECKING:
    from hypothesis.strategies import SearchStrategy

ROUNDS = 40
"""Of making a timeline shorter; each takes a second or two on the real clock. Most need about ten."""

PAIRS_BELOW = 9
"""So many actions, and any two of them are left out together as well."""


class HypothesisMissing(Exception):
    """The optional package is not installed; the text says how to install it."""

    def __init__(self) -> None:
        super().__init__('explore needs hypothesis; install it: pip install "nros-conformance[explore]"')


def generate(cast: Cast, examples: int, seed: int) -> list[Timeline]:
    """So many timelines; the same seed, the same ones. Raises `HypothesisMissing`."""
    try:
        import hypothesis
    except ImportError:
        raise HypothesisMissing from None
    settings = hypothesis.settings(
        max_examples=examples, database=None, deadline=None, phases=(hypothesis.Phase.generate,),
        suppress_health_check=tuple(hypothesis.HealthCheck), verbosity=hypothesis.Verbosity.quiet,
    )  # fmt: skip
    found: list[Timeline] = []
    collect = hypothesis.given(_timelines(cast))(lambda timeline: found.append(timeline.sensible()))
    hypothesis.seed(seed)(settings(collect))()
    return found


def _timelines(cast: Cast) -> SearchStrategy[Timeline]:
    from hypothesis import strategies

    most = {"drive": 6, "idle": 8, "publish": 6, "lose": 4}
    what = [(verb, subject) for verb in cast.verbs for subject in VERBS[verb]]
    what += [one for one in what if one[0] in ("drive", "idle", "publish", "lose")] * 2  # what most is about
    actions = strategies.sampled_from(what).flatmap(
        lambda one: strategies.builds(
            Action, strategies.just(one[0]), strategies.just(one[1]), strategies.integers(1, most.get(one[0], 1))
        )
    )
    together = tuple(cast.kinds)
    registered = strategies.sampled_from([together, *((kind,) for kind in together), *[together] * len(together)])
    length = strategies.sampled_from([0, 6])  # left alone, most lists are very short
    return strategies.builds(
        Timeline,
        length.flatmap(lambda least: strategies.lists(actions, min_size=least, max_size=14)).map(tuple),
        registered,
    )


def size(timeline: Timeline) -> tuple[int, int, int]:
    """What makes one timeline shorter than another: actions, then time and samples, then kinds."""
    return len(timeline.actions), sum(one.count for one in timeline.actions), len(timeline.kinds)


def shrink(timeline: Timeline, fails: Callable[[Sequence[Timeline]], Sequence[bool]], at_once: int) -> Timeline:
    """The shortest that fails in the same way, one step at a time. ``fails`` plays so many together.

    Hypothesis shrinks too, but plays one after the other, and gives up when a play fails once and not again.
    """
    for _ in range(ROUNDS):
        shorter = sorted(_shorter(timeline), key=size)
        batches = (shorter[first : first + at_once] for first in range(0, len(shorter), at_once))
        found = (one for batch in batches for one, bad in zip(batch, fails(batch), strict=True) if bad)
        smaller = next(found, None)
        if smaller is None:
            break
        timeline = smaller
    return timeline


def _shorter(timeline: Timeline) -> list[Timeline]:
    """All that can be tried next."""
    found = {dataclasses.replace(timeline, actions=one).sensible() for one in _fewer(timeline.actions)}
    if len(timeline.kinds) > 1:
        found |= {dataclasses.replace(timeline, kinds=(kind,)) for kind in timeline.kinds}
    return [one for one in found if size(one) < size(timeline)]


def _fewer(actions: tuple[Action, ...]) -> Iterator[tuple[Action, ...]]:
    length = len(actions)
    step = length
    while step:
        for first in range(0, length, step):
            yield actions[:first] + actions[first + step :]
        step //= 2
    if length < PAIRS_BELOW:
        for first in range(length):
            for second in range(first + 1, length):
                yield actions[:first] + actions[first + 1 : second] + actions[second + 1 :]
    for index, one in enumerate(actions):
        for fewer in {1, one.count // 2, one.count - 1} - {0, one.count}:
            yield (*actions[:index], dataclasses.replace(one, count=fewer), *actions[index + 1 :])
