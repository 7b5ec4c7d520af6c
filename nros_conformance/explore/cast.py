"""Who acts in generated timelines, what they do, and which events are looked at: by what a backend declares."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping

from nros_conformance.rmw.declaration import Declaration, Event
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import Liveliness, QosProfile, Reliability

DEADLINE_MS, LEASE_MS, DEPTH = 127, 213, 4
"""Of T/2 neither is a multiple, nor does a sum of a few of them fall close to one."""

PUBLISHERS, SUBSCRIPTIONS = ("steady", "manual"), ("first", "second")
ENTITIES = (*PUBLISHERS, *SUBSCRIPTIONS)

TIME = ("drive", "idle")
VERBS: dict[str, tuple[str, ...]] = {
    "drive": ("",), "idle": ("",), "publish": PUBLISHERS, "assert": ("manual",), "lose": PUBLISHERS,
    "take": SUBSCRIPTIONS, "destroy": ENTITIES, "create": ENTITIES, "register": SUBSCRIPTIONS,
}  # fmt: skip
"""What can be done, and to whom."""

_DEADLINES = (EventKind.REQUESTED_DEADLINE_MISSED, EventKind.OFFERED_DEADLINE_MISSED)


@dataclasses.dataclass(frozen=True, slots=True)
class Cast:
    """``leases``: the publisher ``manual`` has MANUAL liveliness, else it is a second plain one.

    ``forgets``: to a subscription a publisher that is not alive has gone, and is a new one when it comes back.
    ``without``: events that are claimed and not looked at, and why.
    """

    kinds: tuple[EventKind, ...] = tuple(EventKind)
    verbs: tuple[str, ...] = tuple(VERBS)
    leases: bool = True
    forgets: bool = False
    without: Mapping[EventKind, str] = dataclasses.field(default_factory=dict)

    def qos(self, name: str, lossy: bool = False) -> QosProfile:
        """What an entity asks for. ``lossy``: what is lost has to stay lost, so nothing may be repaired."""
        reliability = Reliability.BEST_EFFORT if lossy else Reliability.RELIABLE
        if name in SUBSCRIPTIONS:
            return QosProfile(reliability, depth=DEPTH)
        if name == "manual" and self.leases:
            return QosProfile(reliability, depth=16, liveliness=Liveliness.MANUAL_BY_TOPIC, lease_ms=LEASE_MS)
        return QosProfile(reliability, depth=16)

    def shared(self, other: Cast) -> Cast:
        """What two backends can both do and claim."""
        return Cast(
            tuple(kind for kind in self.kinds if kind in other.kinds),
            tuple(verb for verb in self.verbs if verb in other.verbs),
            self.leases and other.leases,
            self.forgets or other.forgets,
            {**self.without, **other.without},
        )


def cast_for(declaration: Declaration) -> Cast:
    """What a backend claims and can do, without what the model does not know."""
    claimed = [kind for kind in EventKind if declaration.claims()[kind.label] != "no"]
    without = {kind: why for kind in claimed for why in _unmodelled(kind, declaration.event(kind))}
    loses = declaration.event(EventKind.LIVELINESS_LOST)
    leases = (
        loses.manual
        and loses.publish_asserts
        and not {"lease", "liveliness.manual_by_topic"} & set(declaration.qos.unsupported)
        and declaration.bounds.min_lease.ns({}) <= LEASE_MS * 1_000_000
    )
    left_out = {"lose": "lose" not in declaration.faults, "assert": not leases}
    return Cast(
        tuple(kind for kind in claimed if kind not in without),
        tuple(verb for verb in VERBS if not left_out.get(verb)),
        leases,
        declaration.event(EventKind.LIVELINESS_CHANGED).loss_class == "destroy",
        without,
    )


def _unmodelled(kind: EventKind, event: Event) -> Iterator[str]:
    if kind in _DEADLINES and event.armed_at == "create":
        yield "the model does not arm deadlines at creation"
    elif kind is EventKind.REQUESTED_DEADLINE_MISSED and event.after_publisher_gone == "stops":
        yield "the model does not stop deadlines with the publisher"
    elif kind is EventKind.LIVELINESS_CHANGED and event.presence_only:
        yield "the model counts publishers, not presence"
    elif kind is EventKind.LIVELINESS_LOST and not event.publish_asserts:
        yield "to the model a publish asserts liveliness"
