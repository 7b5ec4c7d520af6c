"""The model against the sentences of the requirements: figures worked out by hand."""

from __future__ import annotations

import pytest

from nros_conformance.model.world import Occurrence, World
from nros_conformance.rmw.clock import MS, NEVER
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import Durability, Liveliness, QosProfile, Reliability

TOPIC = (0, "/t", "T")
LVC, RDM, MSL, LVL, ODM = EventKind


def world(publisher: QosProfile | None = None, subscription: QosProfile | None = None) -> World:
    made = World()
    made.create_publisher("p", TOPIC, "node", publisher or QosProfile(), 0)
    made.create_subscription("s", TOPIC, subscription or QosProfile(), 0)
    return made


def told(found: list[Occurrence], kind: EventKind) -> list[tuple[int, tuple[int, ...]]]:
    return [(one.at_ns // MS, one.change) for one in found if one.kind is kind]


def test_a_subscription_misses_one_sample_per_elapsed_period_after_the_last() -> None:
    one = world(subscription=QosProfile(deadline_ms=100), publisher=QosProfile(deadline_ms=100))
    assert one.next_due_ns == NEVER  # nothing before the first sample (RDM-008)
    one.publish("p", b"", 0)
    found = [*one.publish("p", b"", 90 * MS), *one.advance(320 * MS)]
    assert told(found, RDM) == [(190, (1,)), (290, (1,))]
    assert told([*one.publish("p", b"", 350 * MS), *one.advance(500 * MS)], RDM) == [(450, (1,))]


def test_a_sample_at_the_very_moment_of_the_deadline_is_in_time() -> None:
    one = world(subscription=QosProfile(deadline_ms=100), publisher=QosProfile(deadline_ms=100))
    one.publish("p", b"", 0)
    assert told(one.publish("p", b"", 100 * MS), RDM) == []


def test_a_publisher_falls_behind_without_any_subscription_and_assertions_do_not_help() -> None:
    one = World()
    qos = QosProfile(deadline_ms=100, liveliness=Liveliness.MANUAL_BY_TOPIC, lease_ms=1000)
    one.create_publisher("p", TOPIC, "node", qos, 0)
    one.publish("p", b"", 0)
    found = [*one.assert_liveliness("p", 50 * MS), *one.advance(250 * MS)]
    assert told(found, ODM) == [(100, (1,)), (200, (1,))]


def test_liveliness_counts_arrival_loss_return_and_goodbye() -> None:
    manual = QosProfile(liveliness=Liveliness.MANUAL_BY_TOPIC, lease_ms=100)
    one = World()
    one.create_subscription("s", TOPIC, manual, 0)
    found = one.create_publisher("p", TOPIC, "node", manual, 0)
    found += one.advance(350 * MS)
    found += one.assert_liveliness("p", 400 * MS)
    found += one.destroy_publisher("p", 450 * MS)
    assert told(found, LVC) == [(0, (1, 0)), (100, (-1, 1)), (400, (1, -1)), (450, (-1, 0))]
    assert told(found, LVL) == [(100, (1,))]  # once per loss, not per lease (LVL-002)


def test_destroying_one_that_is_not_alive_lowers_the_other_count() -> None:
    manual = QosProfile(liveliness=Liveliness.MANUAL_BY_TOPIC, lease_ms=100)
    one = world(manual, manual)
    list(one.advance(200 * MS))
    assert told(one.destroy_publisher("p", 300 * MS), LVC) == [(300, (0, -1))]


def test_publishing_asserts_and_automatic_publishers_are_never_lost() -> None:
    one = world(QosProfile(liveliness=Liveliness.MANUAL_BY_TOPIC, lease_ms=100))
    assert told([*one.publish("p", b"", 90 * MS), *one.advance(185 * MS)], LVL) == []
    assert told(list(one.advance(195 * MS)), LVL) == [(190, (1,))]
    assert told(list(world(QosProfile(lease_ms=100)).advance(10_000 * MS)), LVL) == []


@pytest.mark.parametrize(("kind", "lost"), [(Liveliness.MANUAL_BY_NODE, []), (Liveliness.MANUAL_BY_TOPIC, ["q"])])
def test_an_assertion_by_node_covers_the_node_and_one_by_topic_its_publisher(kind: Liveliness, lost: list[str]) -> None:
    one = World()
    qos = QosProfile(liveliness=kind, lease_ms=100)
    one.create_publisher("p", TOPIC, "node", qos, 0)
    one.create_publisher("q", TOPIC, "node", qos, 0)
    one.create_publisher("elsewhere", TOPIC, "other", qos, 0)
    one.assert_liveliness("p", 60 * MS)
    found = list(one.advance(150 * MS))
    assert [each.entity for each in found if each.kind is LVL] == [*lost, "elsewhere"]


@pytest.mark.parametrize(
    ("offered", "asked", "meet"),
    [
        (Liveliness.MANUAL_BY_TOPIC, Liveliness.MANUAL_BY_NODE, True),
        (Liveliness.MANUAL_BY_NODE, Liveliness.MANUAL_BY_TOPIC, False),
        (Liveliness.MANUAL_BY_NODE, Liveliness.AUTOMATIC, True),
        (Liveliness.AUTOMATIC, Liveliness.MANUAL_BY_NODE, False),
        (Liveliness.NONE, Liveliness.AUTOMATIC, True),
        (Liveliness.AUTOMATIC, Liveliness.NONE, True),
    ],
)
def test_by_topic_is_more_than_by_node_and_that_more_than_automatic(
    offered: Liveliness, asked: Liveliness, meet: bool
) -> None:
    one = world(QosProfile(liveliness=offered, lease_ms=100), QosProfile(liveliness=asked, lease_ms=100))
    assert one.matched("p", "s") is meet


def test_overflow_and_gaps_are_lost_and_conserved() -> None:
    one = world(subscription=QosProfile(depth=4))
    found: list[Occurrence] = []
    for number in range(20):
        found += one.publish("p", bytes([number]), number, lost=number in (3, 4, 5))
    lost = sum(each.change[0] for each in found if each.kind is MSL)
    received = 0
    while one.take("s", 100) is not None:
        received += 1
    assert (lost, received) == (16, 4)


def test_expired_samples_are_not_delivered_and_not_lost() -> None:
    one = world(publisher=QosProfile(lifespan_ms=100))
    found = one.publish("p", b"old", 0)
    assert one.take("s", 100 * MS) is None
    assert told([*found, *one.publish("p", b"new", 200 * MS)], MSL) == []
    assert one.peek("s", 250 * MS) == one.take("s", 250 * MS) != None  # noqa: E711 - reads as the chain it is


def test_a_late_subscription_finds_publishers_as_they_are_and_history_only_if_latched() -> None:
    latched = QosProfile(durability=Durability.TRANSIENT_LOCAL, depth=2)
    one = World()
    one.create_publisher("p", TOPIC, "node", latched, 0)
    for number in range(5):
        one.publish("p", bytes([number]), number)
    found = one.create_subscription("late", TOPIC, latched, 10)
    assert told(found, LVC) == [(0, (1, 0))]
    assert told(found, MSL) == []
    assert [sample.data for sample in iter(lambda: one.take("late", 20), None)] == [b"\x03", b"\x04"]
    one.create_subscription("volatile", TOPIC, QosProfile(), 10)
    assert one.take("volatile", 20) is None


@pytest.mark.parametrize(("offered", "requested"), [
    ({"reliability": Reliability.BEST_EFFORT}, {}),
    ({}, {"durability": Durability.TRANSIENT_LOCAL}),
    ({"deadline_ms": 200}, {"deadline_ms": 100}),
    ({}, {"deadline_ms": 100}),
    ({}, {"liveliness": Liveliness.MANUAL_BY_TOPIC}),
    ({"lease_ms": 200}, {"lease_ms": 100}),
])  # fmt: skip
def test_who_asks_for_more_than_is_offered_is_not_matched(offered: dict[str, int], requested: dict[str, int]) -> None:
    one = world(QosProfile(**offered), QosProfile(**requested))  # type: ignore[arg-type]
    assert not one.matched("p", "s")
    one.publish("p", b"", 1)
    assert one.take("s", 1) is None


@pytest.mark.parametrize("other", [(1, "/t", "T"), (0, "/u", "T"), (0, "/t", "U")])
def test_another_domain_topic_or_type_is_never_met(other: tuple[int, str, str]) -> None:
    one = world()
    assert told(one.create_publisher("q", other, "node", QosProfile(), 5), LVC) == []
    assert not one.matched("q", "s")
