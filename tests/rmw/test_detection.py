"""The detection pieces, each against the model: same actions, same totals, at any moment of looking."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from nros_conformance.model.world import World
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.detection import CountTracker, DeadlineClock, GapTracker, LivelinessCounter, LivelinessTally
from nros_conformance.rmw.events import CountStatus, EventKind, LivelinessChangedStatus
from nros_conformance.rmw.qos import QosProfile

TOPIC = (0, "/t", "T")
gaps = st.lists(st.integers(0, 400), min_size=1, max_size=30)


@given(gaps=gaps, period=st.integers(1, 150), looks=st.lists(st.integers(0, 400), max_size=20))
def test_deadline_clock_counts_as_the_model_does(gaps: list[int], period: int, looks: list[int]) -> None:
    world = World()
    world.create_publisher("p", TOPIC, "n", QosProfile(), 0)
    world.create_subscription("s", TOPIC, QosProfile(), 0)
    world.set_deadline("s", period)
    clock = DeadlineClock(period * MS)
    now, expected, reported = 0, 0, 0
    for index, gap in enumerate(gaps):
        now += gap * MS
        expected += sum(o.kind == EventKind.REQUESTED_DEADLINE_MISSED for o in world.publish("p", b"", now))
        clock.restart(now)
        if index < len(looks):
            now += looks[index] * MS
            expected += sum(o.kind == EventKind.REQUESTED_DEADLINE_MISSED for o in world.advance(now))
            clock.update(now)
            status = clock.misses.take()
            reported += status.total_count_change if status else 0
            assert (clock.misses.total, reported) == (expected, expected)
            assert clock.next_due_ns == world.next_due_ns
    assert clock.misses.total == expected


def test_deadline_clock_misses_nothing_before_the_first_sample() -> None:
    clock = DeadlineClock(10 * MS)
    clock.update(10_000 * MS)
    assert clock.misses.take() is None


@given(
    steps=st.lists(st.tuples(st.sampled_from("abc"), st.booleans()), max_size=60),
    depth=st.integers(1, 70),
)
def test_gap_tracker_loses_what_the_model_loses(steps: list[tuple[str, bool]], depth: int) -> None:
    world = World()
    for publisher in "abc":
        world.create_publisher(publisher, TOPIC, "n", QosProfile(depth=1000), 0)
    world.create_subscription("s", TOPIC, QosProfile(depth=1000), 0)
    tracker, sequence = GapTracker(), dict.fromkeys("abc", 0)
    for publisher in "abc":  # synchronises both
        world.publish(publisher, b"", 0)
        sequence[publisher] += 1
        tracker.sample(publisher, sequence[publisher], 0)
    expected = 0
    for publisher, lost in steps:
        sequence[publisher] += 1
        found = world.publish(publisher, b"", 0, lost=lost)
        expected += sum(o.change[0] for o in found if o.kind == EventKind.MESSAGE_LOST)
        if not lost:
            tracker.sample(publisher, sequence[publisher], 0)
    assert tracker.losses.total == expected


def test_gap_tracker_takes_duplicates_reordering_and_restart_for_no_loss() -> None:
    tracker = GapTracker()
    found = [tracker.sample("p", number, 0) for number in (1, 2, 2, 4, 3, 3, 4, 5)]
    assert (found, tracker.losses.take()) == ([0, 0, 0, 1, -1, 0, 0, 0], None)
    tracker.forget("p")
    assert tracker.sample("p", 1, 0) == 0
    assert tracker.sample("q", 900, 0) == 0


def test_a_loss_that_was_reported_stays_when_the_sample_comes_after_all() -> None:
    tracker = GapTracker()
    found = [tracker.sample("p", number, 0) for number in (1, 4)]
    assert tracker.losses.take() == CountStatus(2, 2)
    found += [tracker.sample("p", number, 0) for number in (3, 8, 6, 2)]
    assert (found, tracker.losses.take()) == ([0, 2, 0, 3, -1, 0], CountStatus(4, 2))


def test_a_late_sample_of_one_publisher_fills_no_gap_of_another() -> None:
    tracker = GapTracker()
    assert [tracker.sample(*step, 0) for step in (("p", 1), ("q", 1), ("p", 3), ("q", 4), ("q", 2))] == [0, 0, 1, 2, -1]
    assert tracker.losses.total == 2


def test_after_a_restart_the_numbers_of_before_fill_no_gap() -> None:
    tracker = GapTracker()
    for number in (1, 4):
        tracker.sample("p", number, 0)
    tracker.forget("p")
    assert [tracker.sample("p", number, 0) for number in (5, 2)] == [0, 0]
    assert tracker.losses.total == 2


@given(
    numbers=st.sets(st.integers(0, 60), min_size=1).flatmap(lambda sent: st.permutations(sorted(sent))),
    start=st.sampled_from([0, 2**32 - 30]),
    looks=st.sets(st.integers(0, 60)),
)
def test_gap_tracker_counts_what_never_came_and_what_came_after_its_report(
    numbers: list[int], start: int, looks: set[int]
) -> None:
    tracker, reported = GapTracker(), 0
    missing: set[int] = set()
    told: set[int] = set()
    after_its_report = 0
    newest = numbers[0]
    for index, number in enumerate(numbers):
        tracker.sample("p", (start + number) % 2**32, index)
        after_its_report += number in told
        missing |= set(range(newest + 1, number))
        missing.discard(number)
        told.discard(number)
        newest = max(newest, number)
        if index in looks:
            status = tracker.losses.take()
            if status is not None:
                assert status.total_count_change > 0
                reported += status.total_count_change
            told |= missing
            assert reported == tracker.losses.total
        assert tracker.losses.total == len(missing) + after_its_report


def test_gap_tracker_keeps_a_bounded_number_of_gaps() -> None:
    tracker = GapTracker()
    for number in range(0, 2000, 2):
        tracker.sample("p", number, 0)
    assert [tracker.sample("p", 1, 0), tracker.sample("p", 1997, 0)] == [0, -1]


def test_what_is_retracted_before_its_report_is_no_event() -> None:
    tracker = CountTracker()
    tracker.add(2, 7)
    tracker.retract(2)
    assert (tracker.ready_ns, tracker.take(), tracker.total) == (None, None, 0)
    tracker.add(3, 8)
    tracker.take()
    tracker.add(1, 9)
    tracker.retract(5)  # no more than what is unreported
    assert (tracker.take(), tracker.total) == (None, 3)


def test_gap_tracker_is_right_across_the_wrap() -> None:
    tracker = GapTracker()
    tracker.sample("p", 2**32 - 2, 0)
    assert tracker.sample("p", 3, 0) == 4


@given(
    moves=st.lists(st.tuples(st.sampled_from("abc"), st.sampled_from(["came", "fell_silent", "left"])), max_size=40),
    looks=st.sets(st.integers(0, 39)),
)
def test_liveliness_counter_counts_publishers_and_reports_differences(
    moves: list[tuple[str, str]], looks: set[int]
) -> None:
    counter = LivelinessCounter()
    truth: dict[str, bool] = {}
    sums = [0, 0]
    for index, (publisher, move) in enumerate(moves):
        getattr(counter, move)(publisher, index)
        if move == "came":
            truth[publisher] = True
        elif move == "fell_silent" and publisher in truth:
            truth[publisher] = False
        elif move == "left":
            truth.pop(publisher, None)
        if index in looks:
            status = counter.take()
            if status is not None:
                assert (status.alive_count_change, status.not_alive_count_change) != (0, 0)
                sums = [sums[0] + status.alive_count_change, sums[1] + status.not_alive_count_change]
                assert [status.alive_count, status.not_alive_count] == sums
            alive = sum(truth.values())
            assert sums == [alive, len(truth) - alive]


def test_transitions_that_cancel_out_between_two_looks_are_no_event() -> None:
    tally = LivelinessTally()
    tally.add(1, 0, 5)
    tally.add(-1, 0, 6)
    assert (tally.ready_ns, tally.take()) == (None, None)
    tally.set(2, 1, 9)
    assert (tally.ready_ns, tally.take()) == (9, LivelinessChangedStatus(2, 1, 2, 1))


def test_a_sample_at_the_very_moment_of_the_deadline_is_in_time() -> None:
    clock = DeadlineClock(10 * MS)
    clock.restart(0)
    clock.restart(40 * MS)
    assert clock.misses.total == 3


def test_counts_coalesce_and_saturate_with_a_true_change() -> None:
    tracker = CountTracker()
    tracker.add(2, 7)
    tracker.add(3, 9)
    assert (tracker.ready_ns, tracker.take(), tracker.take()) == (7, CountStatus(5, 5), None)
    tracker.add(2**32, 10)
    assert tracker.take() == CountStatus(2**32 - 1, 2**32 - 1)
    tracker.add(1, 11)
    assert tracker.take() == CountStatus(2**32 - 1, 1)
