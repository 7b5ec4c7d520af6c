"""A defective backend from the reference and the parts in which it differs."""

from __future__ import annotations

from typing import Any

from nros_backends.reference.backend import (
    ReferenceBackend,
    ReferencePublisher,
    ReferenceSession,
    ReferenceSubscription,
)
from nros_conformance.model.agent import Agent
from nros_conformance.model.world import World
from nros_conformance.rmw.detection import CountTracker, LivelinessTally
from nros_conformance.rmw.dispatch import EventRegistry, ReadyQueue
from nros_conformance.rmw.mutants import Mutant


def mutant(
    name: str, defect: str, violates: str, says: str, *,
    backend: type[ReferenceBackend] = ReferenceBackend,
    session: type[ReferenceSession] = ReferenceSession,
    publisher: type[ReferencePublisher] = ReferencePublisher,
    subscription: type[ReferenceSubscription] = ReferenceSubscription,
    world: type[World] = World,
    agent: type[Agent] = Agent,
    registry: type[EventRegistry] = EventRegistry,
    queue: type[ReadyQueue] = ReadyQueue,
    tracker: type[CountTracker] = CountTracker,
    tally: type[LivelinessTally] = LivelinessTally,
) -> Mutant:  # fmt: skip
    """The reference with these parts in the place of its own."""
    parts: dict[str, Any] = {"registry_type": registry, "tracker_type": tracker, "tally_type": tally}
    ends = {
        "publisher_type": type("MutantPublisher", (publisher,), dict(parts)),
        "subscription_type": type("MutantSubscription", (subscription,), dict(parts)),
        "queue_type": queue,
    }
    sessions = type("MutantSession", (session,), ends)
    types = {"session_type": sessions, "world_type": world, "agent_type": agent}
    adapter = type("MutantBackend", (backend,), {**types, "__doc__": says})
    return Mutant(name, defect, violates, says, adapter)
