"""Waiting until publishers and subscriptions know each other."""

from __future__ import annotations

from collections.abc import Sequence

from nros_conformance.play.actors import Actor
from nros_conformance.play.remote import RemoteDriver
from nros_conformance.play.stage import Stage
from nros_conformance.rmw.backend import Publisher, Subscription
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import Side
from nros_conformance.trace.records import Matched

_LOOK_NS = 2 * MS
"""How often the ends are asked where one of them lives in another process."""


def settle(stage: Stage) -> int:
    """Wait for every pair that has a topic in common, and write down since when it knows each other.

    OK, or TIMEOUT when a pair did not meet within the declared bound.
    """
    code = ReturnCode.OK
    bound = stage.quantities["discovery_bound"]
    actors = [actor for actor in stage.actors.values() if actor.exists]
    pairs = [
        (publisher, subscription)
        for publisher in actors
        for subscription in actors
        if publisher.side is Side.PUBLISHER and subscription.side is Side.SUBSCRIPTION
        if _meet(publisher, subscription, stage)
    ]
    for publisher, subscription in pairs:
        begin = stage.clock.now_ns()
        if isinstance(publisher.driver, RemoteDriver) or isinstance(subscription.driver, RemoteDriver):
            matched = _meet_apart(publisher, subscription, pairs, stage, begin + bound)
        else:
            assert isinstance(publisher.handle, Publisher)
            assert isinstance(subscription.handle, Subscription)
            matched = stage.backend.await_matched(publisher.handle, subscription.handle, begin + bound)
        if matched is None:
            stage.sleep_until(begin + bound)
        elif not matched:
            code = ReturnCode.TIMEOUT
        how = "bound" if matched is None else "adapter" if matched else "timeout"
        stage.record(
            Matched(
                publisher=publisher.name, subscription=subscription.name, begin=begin, end=stage.clock.now_ns(), how=how
            )
        )  # fmt: skip
        stage.sleep_until(0)  # only to notice a failure
    return int(code)


def _meet(publisher: Actor, subscription: Actor, stage: Stage) -> bool:
    sessions = stage.scenario.sessions
    domains = [sessions[a.driver.name].domain if a.driver.name in sessions else 0 for a in (publisher, subscription)]
    same = (publisher.topic, publisher.spec.type) == (subscription.topic, subscription.spec.type)
    return same and domains[0] == domains[1]


def _meet_apart(
    publisher: Actor, subscription: Actor, pairs: Sequence[tuple[Actor, Actor]], stage: Stage, until: int
) -> bool | None:
    """Wait until each of the two knows as many as it has to; None when neither can tell."""
    wanted = {
        publisher.name: sum(one is publisher for one, _ in pairs),
        subscription.name: sum(one is subscription for _, one in pairs),
    }
    while True:
        known = {actor.name: _known(actor, stage) for actor in (publisher, subscription)}
        if all(count is None for count in known.values()):
            return None
        # An end that cannot tell follows the one that can.
        if all(count is None or count >= wanted[name] for name, count in known.items()):
            return True
        if stage.clock.now_ns() > until:
            return False
        stage.sleep_until(stage.clock.now_ns() + _LOOK_NS)


def _known(actor: Actor, stage: Stage) -> int | None:
    command = stage.perform(
        actor.driver, "matched", lambda: stage.backend.matched(actor.created()), actor.name
    )  # fmt: skip
    return None if command.result is None else int(command.result)
