"""The simulated agent against the sentences of the requirements: figures worked out by hand."""

from __future__ import annotations

from nros_conformance.model.agent import Agent, Ruling
from nros_conformance.model.world import Occurrence, World
from nros_conformance.rmw.clock import MS, NEVER
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import QosProfile

TOPIC = (0, "/t", "T")


def agent(*, answers: bool, hard_ms: int | None = 1000) -> Agent:
    one = Agent(lambda client: answers)
    one.admit("c", 500 * MS, None if hard_ms is None else hard_ms * MS, 0)
    return one


def test_a_silent_client_is_pinged_three_times_and_removed_200_ms_after_the_last() -> None:
    one = agent(answers=False)
    assert list(one.advance(1_599 * MS)) == []
    assert one.checks == 3
    assert list(one.advance(2_000 * MS)) == [Ruling(1_600 * MS, "c", "removed")]
    assert not one.knows("c")
    assert one.next_due_ns == NEVER


def test_an_idle_client_that_answers_stays_and_is_pinged_once_per_timeout() -> None:
    one = agent(answers=True)
    assert list(one.advance(5_500 * MS)) == []
    assert one.checks == 5


def test_data_is_a_sign_of_life_so_nobody_is_pinged() -> None:
    one = agent(answers=False)
    for turn in range(20):
        one.hears("c", turn * 900 * MS)
        assert list(one.advance((turn * 900 + 899) * MS)) == []
    assert one.checks == 0


def test_without_the_check_a_client_is_lost_a_lease_after_its_link_broke_and_found_again() -> None:
    one = agent(answers=False, hard_ms=None)
    assert list(one.advance(60_000 * MS)) == []
    assert not one.link("c", False, 60_000 * MS)
    assert list(one.advance(61_000 * MS)) == [Ruling(60_500 * MS, "c", "lost")]
    assert one.knows("c")
    assert one.link("c", True, 62_000 * MS)
    assert not one.link("c", True, 62_000 * MS)


def test_a_restarted_agent_knows_nobody() -> None:
    one = agent(answers=True)
    one.stop()
    one.start()
    assert one.up
    assert not one.knows("c")


def told(found: list[Occurrence]) -> list[tuple[int, ...]]:
    return [one.change for one in found if one.kind is EventKind.LIVELINESS_CHANGED]


def test_a_publisher_out_of_reach_is_not_alive_until_it_is_back_and_for_good_it_is_gone() -> None:
    world = World()
    world.create_subscription("s", TOPIC, QosProfile(), 0)
    assert told(world.create_publisher("p", TOPIC, "n", QosProfile(), 0)) == [(1, 0)]
    assert told(world.part("p", 1)) == [(-1, 1)]
    assert not world.matched("p", "s")
    assert told(world.rejoin("p", 2)) == [(1, -1)]
    assert told(world.part("p", 3, for_good=True)) == [(-1, 0)]
    assert told(world.rejoin("p", 4)) == []
    assert told(world.destroy_publisher("p", 5)) == []


def test_a_subscription_out_of_reach_counts_its_publishers_as_not_alive() -> None:
    world = World()
    world.create_publisher("p", TOPIC, "n", QosProfile(), 0)
    world.create_subscription("s", TOPIC, QosProfile(), 0)
    assert told(world.part("s", 1)) == [(-1, 1)]
    assert told(world.create_publisher("q", TOPIC, "n", QosProfile(), 2)) == []
    assert told(world.destroy_publisher("p", 3)) == [(0, -1)]
    assert told(world.rejoin("s", 4)) == [(1, 0)]
