from __future__ import annotations

from collections.abc import Sequence

from nros_conformance.explore.cast import Cast
from nros_conformance.explore.search import generate, shrink, size
from nros_conformance.explore.timelines import Action, Timeline
from nros_conformance.rmw.events import EventKind

LONG = Timeline(
    (
        Action("drive", count=4), Action("publish", "steady", 6), Action("take", "first"), Action("idle", count=8),
        Action("lose", "manual", 3), Action("register", "second"), Action("publish", "manual", 5), Action("drive"),
        Action("publish", "steady"), Action("take", "second"),
    )
)  # fmt: skip


def verbs(timeline: Timeline) -> list[tuple[str, str]]:
    return [(one.verb, one.subject) for one in timeline.actions]


def test_the_same_seed_gives_the_same_timelines() -> None:
    cast = Cast()
    assert generate(cast, 30, 4) == generate(cast, 30, 4)
    assert generate(cast, 30, 4) != generate(cast, 30, 5)


def test_only_what_the_cast_does_is_generated() -> None:
    cast = Cast((EventKind.MESSAGE_LOST,), ("drive", "publish"), leases=False)
    timelines = generate(cast, 30, 1)
    assert {one.verb for timeline in timelines for one in timeline.actions} <= {"drive", "publish"}
    assert {timeline.kinds for timeline in timelines} == {(EventKind.MESSAGE_LOST,)}


def test_what_is_not_needed_is_left_out_and_the_rest_is_made_small() -> None:
    played: list[int] = []

    def fails(batch: Sequence[Timeline]) -> list[bool]:
        played.append(len(batch))
        return [{("lose", "manual"), ("publish", "manual")} <= set(verbs(one)) for one in batch]

    for at_once in (1, 1000):
        played.clear()
        shortest = shrink(LONG, fails, at_once)
        assert shortest.actions == (Action("lose", "manual"), Action("publish", "manual"))
        assert len(shortest.kinds) == 1
        assert max(played) > 10 if at_once > 1 else max(played) == 1


def test_two_that_only_go_together_are_left_out_together() -> None:
    def fails(batch: Sequence[Timeline]) -> list[bool]:
        return [
            ("lose", "manual") in verbs(one) and (("take", "first") in verbs(one)) is (("drive", "") in verbs(one))
            for one in batch
        ]

    start = Timeline((Action("drive"), Action("lose", "manual"), Action("take", "first")))
    assert verbs(shrink(start, fails, 1)) == [("lose", "manual")]


def test_nothing_shorter_that_fails_leaves_it_as_it_is() -> None:
    assert shrink(LONG, lambda batch: [False] * len(batch), 1000) == LONG


def test_a_timeline_is_shorter_by_actions_then_counts_then_kinds() -> None:
    one, other = Timeline((Action("drive"),)), Timeline((Action("drive", count=2),), (EventKind.MESSAGE_LOST,))
    assert size(Timeline(())) < size(Timeline((Action("drive"),), (EventKind.MESSAGE_LOST,))) < size(one) < size(other)
