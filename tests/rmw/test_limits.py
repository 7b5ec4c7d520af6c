"""Counters at the limits of the ABI's integers (CNT-007), and the hook that brings them there."""

from __future__ import annotations

from nros_conformance.rmw.detection import CountTracker, LivelinessTally
from nros_conformance.rmw.dispatch import EventRegistry, ReadyQueue
from nros_conformance.rmw.events import CountStatus, LivelinessChangedStatus


def test_a_total_saturates_and_its_change_stays_true() -> None:
    tracker = CountTracker()
    tracker.preset(2**32 - 2)
    assert tracker.take() is None  # what is preset has been reported
    for change, total in ((1, 2**32 - 1), (1, 2**32 - 1), (7, 2**32 - 1)):
        tracker.add(change, 5)
        assert tracker.take() == CountStatus(total, change)


def test_what_is_pending_when_a_total_is_preset_stays_pending() -> None:
    tracker = CountTracker()
    tracker.add(3, 5)
    tracker.preset(100)
    assert tracker.take() == CountStatus(100, 3)


def test_alive_and_not_alive_saturate_at_u16() -> None:
    tally = LivelinessTally()
    tally.preset(2**16 - 1)
    assert tally.take() is None
    tally.add(1, 0, 5)
    assert tally.take() == LivelinessChangedStatus(2**16 - 1, 0, 1, 0)
    tally.add(-2, 1, 6)
    assert tally.take() == LivelinessChangedStatus(2**16 - 2, 1, -2, 1)


def test_changes_saturate_at_i16() -> None:
    tally = LivelinessTally()
    tally.add(2**15, 0, 5)
    assert tally.take() == LivelinessChangedStatus(2**15, 0, 2**15 - 1, 0)
    tally.add(-(2**15), 0, 6)
    tally.add(-1, 2**15, 6)
    status = tally.take()
    assert status is not None
    assert (status.alive_count_change, status.not_alive_count_change) == (-(2**15), 2**15 - 1)


def test_a_message_is_announced_only_while_that_very_sample_waits() -> None:
    queue, calls = ReadyQueue(), []
    registry = EventRegistry(queue, {})
    registry.set_message_callback(lambda _: calls.append(1), None)
    waiting = {"first": False, "second": True}
    registry.message(1, lambda: waiting["first"])
    registry.message(2, lambda: waiting["second"])
    assert queue.drain(1) == 1
    assert calls == [1]
