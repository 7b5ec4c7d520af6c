"""Losses in the model: on the wire, across the wrap of the numbers, and what is none."""

from __future__ import annotations

import pytest

from nros_conformance.model.world import NUMBERS, Occurrence, World
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import Durability, QosProfile

TOPIC = (0, "/t", "T")


def lost(found: list[Occurrence]) -> int:
    return sum(one.change[0] for one in found if one.kind is EventKind.MESSAGE_LOST)


def world(depth: int = 100) -> World:
    made = World()
    made.create_publisher("p", TOPIC, "n", QosProfile(), 0)
    made.create_subscription("s", TOPIC, QosProfile(depth=depth), 0)
    return made


@pytest.mark.parametrize("start", [0, 7, NUMBERS - 3])
def test_what_the_wire_swallows_shows_with_the_next_sample(start: int) -> None:
    one = world()
    one.preset("p", start)
    one.publish("p", b"", 1)
    assert lost([found for at in range(2, 7) for found in one.publish("p", b"", at, lost=True)]) == 0
    assert lost(one.publish("p", b"", 8)) == 5
    assert lost(one.publish("p", b"", 9)) == 0


@pytest.mark.parametrize("entity", ["p", "s"])
def test_moving_the_numbers_loses_nothing_and_keeps_what_is_missing(entity: str) -> None:
    one = world()
    one.publish("p", b"", 1)
    one.publish("p", b"", 2, lost=True)
    one.preset(entity, NUMBERS - 1)
    assert lost(one.publish("p", b"", 3)) == 1
    assert [one.take("s", 4), one.take("s", 4), one.take("s", 4)][2] is None


def test_history_is_delivered_and_never_lost() -> None:
    one = World()
    latched = QosProfile(durability=Durability.TRANSIENT_LOCAL, depth=8)
    one.create_publisher("p", TOPIC, "n", latched, 0)
    for at in range(1, 13):
        one.publish("p", bytes([at]), at)
    small = QosProfile(durability=Durability.TRANSIENT_LOCAL, depth=3)
    assert lost(one.create_subscription("s", TOPIC, small, 20)) == 0
    assert lost(one.publish("p", bytes([13]), 21)) == 0  # pushes out history
    taken = [one.take("s", 22) for _ in range(3)]
    assert [sample.data[0] for sample in taken if sample is not None] == [11, 12, 13]
    for at in range(30, 36):
        one.publish("p", b"", at)
    assert lost(one.publish("p", b"", 40)) == 1


def test_a_sample_can_be_asked_after_until_it_is_taken_or_pushed_out() -> None:
    one = world(depth=1)
    one.publish("p", b"a", 1)
    first = one.newest("s", "p")
    assert first is not None
    assert one.waits("s", first, 2)
    one.publish("p", b"b", 3)
    assert not one.waits("s", first, 4)
    one.publish("p", b"c", 5, lost=True)
    assert one.newest("s", "p") is None
