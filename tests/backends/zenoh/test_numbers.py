"""What the publishers' numbers decide: which samples are delivered, and which ones are lost."""

from __future__ import annotations

from nros_backends.zenoh.attachment import Attachment
from nros_backends.zenoh.numbers import HOLD_NS, Numbers
from nros_conformance.rmw.clock import MS

GID = bytes(range(16))


def sample(number: int, source_ns: int | None = None) -> Attachment:
    return Attachment(number, number if source_ns is None else source_ns, GID)


def delivered(numbers: Numbers, *order: int, at_ns: int = 0, history: bool = False) -> list[int]:
    return [one for one in order if numbers.accept(sample(one), at_ns, history=history)]


def test_what_was_overtaken_is_delivered_once_and_is_no_loss() -> None:
    numbers = Numbers()
    assert delivered(numbers, 5, 4, 8, 7, 8, 6, 7, 4) == [5, 4, 8, 7, 6]
    numbers.update(HOLD_NS)
    assert numbers.losses.total == 0


def test_a_gap_that_stays_open_is_lost_and_what_fills_it_then_is_too_late() -> None:
    numbers = Numbers()
    assert delivered(numbers, 1, 5, 3) == [1, 5, 3]
    assert numbers.next_due_ns == HOLD_NS
    numbers.update(HOLD_NS - 1)
    assert numbers.losses.total == 0
    numbers.update(HOLD_NS)
    assert numbers.losses.total == 2
    assert delivered(numbers, 2, at_ns=HOLD_NS + MS) == []


def test_what_is_older_than_the_history_had_no_place_in_it() -> None:
    numbers = Numbers()
    assert delivered(numbers, 5, 6, 7, history=True) == [5, 6, 7]
    # A peer whose link was new has been sent all of them, subscribed to or not.
    assert delivered(numbers, 3, 4, 5, 6, 7, 8) == [8]
    numbers.update(HOLD_NS)
    assert numbers.losses.total == 0


def test_a_publisher_that_begins_again_is_known_by_its_clock() -> None:
    numbers = Numbers()
    assert delivered(numbers, 1, 2, 9) == [1, 2, 9]
    assert numbers.accept(sample(1, source_ns=100), MS)
    assert numbers.losses.total == 6, "what was missing before is counted with it"
    assert numbers.accept(sample(2, source_ns=101), MS)
    assert not numbers.accept(sample(2, source_ns=101), MS)
