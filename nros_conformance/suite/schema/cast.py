"""Who takes part: sessions, entities and their QoS."""

from __future__ import annotations

from typing import Literal

from nros_conformance.formats.durations import Duration, Period
from nros_conformance.suite.schema.words import Base, Identifier, KindName


class Qos(Base, frozen=True, kw_only=True):
    """QoS of an entity: a standard profile, and what differs from it."""

    profile: Literal["default", "sensor_data", "services_default", "parameters", "system_default"] = "default"
    reliability: Literal["reliable", "best_effort"] | None = None
    durability: Literal["volatile", "transient_local"] | None = None
    history: Literal["keep_last", "keep_all"] | None = None
    depth: int | None = None
    deadline: Period | None = None
    lifespan: Period | None = None
    liveliness: Literal["none", "automatic", "manual_by_topic", "manual_by_node"] | None = None
    lease: Period | None = None


class Session(Base, frozen=True, kw_only=True):
    """A session. Sessions without an entry here take their defaults."""

    process: Literal["shared", "own"] = "shared"
    domain: int = 0
    node: Identifier | None = None
    slice: Duration = Duration.parse("10ms")
    """How long one drive_io in the background may wait; up to three times that while the script lets time pass."""
    driven: bool = True
    """Whether it is driven in the background while the script waits."""
    may_fail: bool = False
    lease: Duration | None = None
    """``connection_lease_ms`` of the session; default: the backend's own, which is the declared one."""
    hard_liveliness: Duration | None = None
    """``hard_liveliness_ms``: the peer removes the session's entities when it is silent for so long."""
    reconnector: bool = False
    """Kept by the state machine of `node.reconnection`: it pings, creates the session with its entities,
    drives it, destroys it when the peer is gone, and begins anew."""


class Entity(Base, frozen=True, kw_only=True):
    """A publisher or a subscription: exactly one of the two keys, its value is the topic.

    Topic and type names are made unique per scenario; ``raw`` passes the topic on as it is written.
    """

    publisher: str | None = None
    subscription: str | None = None
    type: str = "Sample"
    raw: bool = False
    session: Identifier | None = None
    """Default: ``pub`` for publishers, ``sub`` for subscriptions, so that a wire lies between them."""
    qos: Qos = Qos()
    register: Literal["expected", "supported", "none"] | list[KindName] = "expected"
    """``expected``: the kinds that this scenario's expectations name for this entity."""
    registration_deadline: Duration | None = None
    """``deadline_ms`` of the registrations; default: the deadline of the QoS, else 1T."""
    take: Literal["withheld", "always"] = "withheld"
    """``always``: every sample is taken at once. Default: nothing but drive_io is called."""
    count: int = 1
    """More than one: entities ``name[0]``, ``name[1]``..., addressed together by ``name``."""
    deferred: bool = False
    """Created by a ``create`` step and not at the start."""
    may_fail: bool = False
    """A refused creation is an observation, not the end of the scenario."""
