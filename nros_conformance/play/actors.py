"""The entities of a scenario, as the play has them."""

from __future__ import annotations

import dataclasses

from nros_conformance.play.driver import Driver, StopPlay
from nros_conformance.play.remote import RemoteDriver
from nros_conformance.rmw.backend import Publisher, Subscription
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.events import Side
from nros_conformance.rmw.qos import INFINITE_MS, PROFILES, Durability, History, Liveliness, QosProfile, Reliability
from nros_conformance.suite import schema


@dataclasses.dataclass(slots=True)
class Actor:
    """An entity of the scenario, and its handle once created."""

    name: str
    spec: schema.Entity
    driver: Driver
    index: int
    handle: Publisher | Subscription | None = None
    gone: bool = False
    """Destroyed, itself or with its session; the handle stays, for calls on stale handles."""
    sequence: int = 0

    @property
    def side(self) -> Side:
        """Which end it is."""
        return Side.PUBLISHER if self.spec.publisher is not None else Side.SUBSCRIPTION

    @property
    def topic(self) -> str:
        """The topic as the suite writes it."""
        return self.spec.publisher if self.spec.publisher is not None else self.spec.subscription or ""

    @property
    def exists(self) -> bool:
        """Whether it has been created and not destroyed since."""
        if isinstance(self.driver, RemoteDriver):
            return self.name in self.driver.living
        return self.handle is not None and not self.gone

    def created(self) -> Publisher | Subscription:
        """The handle; StopPlay when the script uses an entity before it creates it."""
        if self.handle is None:
            raise StopPlay("error", f"the script uses {self.name} before it exists")
        return self.handle


def qos_profile(spec: schema.Qos, quantities: dict[str, int]) -> QosProfile:
    """The QoS that a suite writes, as the contract's. Durations round up to whole ms (QOS-003)."""
    fields: dict[str, object] = {}
    enums = {"reliability": Reliability, "durability": Durability, "history": History, "liveliness": Liveliness}
    for name, enum in enums.items():
        value = getattr(spec, name)
        if value is not None:
            fields[name] = enum[value.upper()]
    for name in ("deadline", "lifespan", "lease"):
        duration = getattr(spec, name)
        if duration is not None:
            fields[f"{name}_ms"] = INFINITE_MS if duration.is_infinite else -(-duration.ns(quantities) // MS)
    if spec.depth is not None:
        fields["depth"] = spec.depth
    return dataclasses.replace(PROFILES[spec.profile], **fields)  # type: ignore[arg-type]
