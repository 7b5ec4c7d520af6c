"""Defects of what subscriptions are told of publishers (LVC)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from nros_backends.reference.backend import ReferenceBackend, ReferenceSession
from nros_backends.reference.mutants.build import mutant
from nros_conformance.model.world import Id, Occurrence, Topic, World, _Publisher, _Subscription
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.mutants import Mutant
from nros_conformance.rmw.qos import Liveliness, QosProfile


class _Believe(World):
    """Changes what a subscription is told of: only what `told` lets pass."""

    def _believe(
        self, id_: Id, subscription: _Subscription, publisher: Id, at_ns: int, alive: bool | None
    ) -> list[Occurrence]:
        if not self.told(id_, subscription, publisher, alive):
            return []
        return super()._believe(id_, subscription, publisher, at_ns, alive)

    def told(self, id_: Id, subscription: _Subscription, publisher: Id, alive: bool | None) -> bool:
        return True


class _NoGoing(_Believe):
    def told(self, id_: Id, subscription: _Subscription, publisher: Id, alive: bool | None) -> bool:
        return alive is not None


class _KeptAlive(_Believe):
    def told(self, id_: Id, subscription: _Subscription, publisher: Id, alive: bool | None) -> bool:
        return alive is not False or sum(subscription.believes.values()) < 2


class _FirstSubscription(_Believe):
    def told(self, id_: Id, subscription: _Subscription, publisher: Id, alive: bool | None) -> bool:
        return id_ == next(one for one, other in self._subscriptions.items() if other.topic == subscription.topic)


class _NeverBack(_Believe):
    def told(self, id_: Id, subscription: _Subscription, publisher: Id, alive: bool | None) -> bool:
        return not (alive and subscription.believes.get(publisher) is False)


class _TwinsStay(World):
    def destroy_publisher(self, id_: Id, at_ns: int) -> list[Occurrence]:
        gone = self._publishers[id_]
        found = super().destroy_publisher(id_, at_ns)
        twins = [one for one in self._publishers.values() if (one.node, one.topic) == (gone.node, gone.topic)]
        return [one for one in found if one.kind is not EventKind.LIVELINESS_CHANGED] if twins else found


class _DropsOthers(World):
    def destroy_publisher(self, id_: Id, at_ns: int) -> list[Occurrence]:
        node = self._publishers[id_].node
        found = super().destroy_publisher(id_, at_ns)
        for other, publisher in self._publishers.items():
            if publisher.node == node:
                found += self._tell(other, publisher, at_ns, None)
        return found


class _Reopened(World):
    def create_subscription(self, id_: Id, topic: Topic, qos: QosProfile, at_ns: int) -> list[Occurrence]:
        known = self.__dict__.setdefault("known", set())
        found = super().create_subscription(id_, topic, qos, at_ns)
        changes = [one for one in found if one.entity == id_ and one.kind is EventKind.LIVELINESS_CHANGED]
        if topic in known:
            found = [one for one in found if one not in changes[1:]] if len(changes) > 1 else found[len(changes) :]
        known.add(topic)
        return found


class _LeaseOfTheParticipant(World):
    """Who does not assert any more is found by the lease of its process."""

    def sever(self, publisher: Id, subscription: Id, lease_ms: int, at_ns: int) -> list[Occurrence]:
        found = super().sever(publisher, subscription, lease_ms, at_ns)
        self._subscriptions[subscription].severed[publisher] = at_ns + 20_000 * MS
        return found

    def _tell(self, id_: Id, publisher: _Publisher, at_ns: int, alive: bool | None) -> list[Occurrence]:
        return [] if alive is False else super()._tell(id_, publisher, at_ns, alive)


class _UnsetBeforeAsserting(World):
    def create_publisher(self, id_: Id, topic: Topic, node: Id, qos: QosProfile, at_ns: int) -> list[Occurrence]:
        found = super().create_publisher(id_, topic, node, qos, at_ns)
        self._publishers[id_].asserted = 2**62
        return found


class _NoLink(World):
    def part(self, id_: Id, at_ns: int, *, for_good: bool = False) -> list[Occurrence]:
        return list(self.advance(at_ns))

    def sever(self, publisher: Id, subscription: Id, lease_ms: int, at_ns: int) -> list[Occurrence]:
        found = super().sever(publisher, subscription, lease_ms, at_ns)
        self._subscriptions[subscription].severed[publisher] = 2**63 - 1
        return found


class _StaysSplit(World):
    def rejoin(self, id_: Id, at_ns: int) -> list[Occurrence]:
        return list(self.advance(at_ns))

    def restore(self, publisher: Id, subscription: Id, at_ns: int) -> list[Occurrence]:
        believes = self._subscriptions[subscription].believes
        if publisher in self._subscriptions[subscription].severed and believes.get(publisher) is False:
            return list(self.advance(at_ns))
        return super().restore(publisher, subscription, at_ns)


class _FrozenIsAlive(ReferenceBackend):
    def inject(self, fault: str, **arguments: Any) -> int:
        return ReturnCode.OK if fault in ("freeze", "thaw") else super().inject(fault, **arguments)


class _SecondRunIgnored(World):
    def create_publisher(self, id_: Id, topic: Topic, node: Id, qos: QosProfile, at_ns: int) -> list[Occurrence]:
        gone = self.__dict__.setdefault("gone", set())
        found = super().create_publisher(id_, topic, node, qos, at_ns)
        if (topic, node) in gone:
            return [one for one in found if one.kind is not EventKind.LIVELINESS_CHANGED]
        return found

    def destroy_publisher(self, id_: Id, at_ns: int) -> list[Occurrence]:
        publisher = self._publishers[id_]
        self.__dict__.setdefault("gone", set()).add((publisher.topic, publisher.node))
        return super().destroy_publisher(id_, at_ns)


class _TimesOut(ReferenceSession):
    """After a while all publishers are taken for lost, though nothing has happened."""

    after_ns = 3_000 * MS
    back = False

    def poll(self) -> bool:
        now, world = self.clock.now_ns(), self.backend.world
        with self.backend.lock:
            for entity in self.entities:
                subscription = world._subscriptions.get(entity.id)
                for publisher in list(subscription.believes) if subscription is not None else []:
                    told = self.__dict__.setdefault("told", set())
                    since = self.__dict__.setdefault("since", {}).setdefault(publisher, now)
                    if now - since > self.after_ns and publisher not in told and subscription is not None:
                        told.add(publisher)
                        self.backend.tell(world._believe(entity.id, subscription, publisher, now, False))
                        if self.back:
                            self.backend.tell(world._believe(entity.id, subscription, publisher, now + 1, True))
        return super().poll()

    def next_due_ns(self) -> int:
        return min(super().next_due_ns(), self.clock.now_ns() + 100 * MS)


class _TimesOutOnce(_TimesOut):
    """Much later, and for a moment."""

    after_ns = 9_000 * MS


class _HeartbeatCovers(World):
    def advance(self, now_ns: int) -> Iterator[Occurrence]:
        for one in self._publishers.values():
            if any(o.node == one.node and o.qos.liveliness is Liveliness.AUTOMATIC for o in self._publishers.values()):
                one.asserted = now_ns
        yield from super().advance(now_ns)


class _LeaseRoundsUp(World):
    def create_publisher(self, id_: Id, topic: Topic, node: Id, qos: QosProfile, at_ns: int) -> list[Occurrence]:
        found = super().create_publisher(id_, topic, node, qos, at_ns)
        lease = self._publishers[id_].lease
        if lease is not None:
            self._publishers[id_].lease = -(-lease // (1000 * MS)) * 1000 * MS
        return found


class _GoneIsLost(World):
    def destroy_publisher(self, id_: Id, at_ns: int) -> list[Occurrence]:
        found = super().destroy_publisher(id_, at_ns)
        return [one._replace(change=(-1, 1)) if one.change == (-1, 0) else one for one in found]


class _LostIsGone(_Believe):
    def _believe(
        self, id_: Id, subscription: _Subscription, publisher: Id, at_ns: int, alive: bool | None
    ) -> list[Occurrence]:
        return super()._believe(id_, subscription, publisher, at_ns, alive or None)


class _PublisherFirstUnseen(World):
    def create_subscription(self, id_: Id, topic: Topic, qos: QosProfile, at_ns: int) -> list[Occurrence]:
        found = super().create_subscription(id_, topic, qos, at_ns)
        return [one for one in found if one.kind is not EventKind.LIVELINESS_CHANGED]


def mutants() -> Iterator[Mutant]:
    """All of this subject."""
    yield mutant("no-going", "D-LVC-01", "LVC-002", "no event when a publisher is destroyed", world=_NoGoing)
    yield mutant("kept-alive", "D-LVC-03", "LVC-006", "one that is alive keeps a lost one alive", world=_KeptAlive)
    yield mutant(
        "participant-lease",
        "D-LVC-04",
        "LVC-004",
        "a loss is found by the lease of the process",
        world=_LeaseOfTheParticipant,
    )
    yield mutant(
        "never-asserted-lives",
        "D-LVC-07",
        "LVC-004",
        "a lease begins with the first assertion",
        world=_UnsetBeforeAsserting,
    )
    yield mutant(
        "twins-stay",
        "D-LVC-11",
        "LVC-009",
        "of two publishers of one session and topic one stays for ever",
        world=_TwinsStay,
    )
    yield mutant(
        "drops-others",
        "D-LVC-12",
        "LVC-006",
        "destroying one publisher drops those of other topics",
        world=_DropsOthers,
    )
    yield mutant(
        "reopened-sees-part",
        "D-LVC-13",
        "LVC-009",
        "a subscription that is opened again sees part of the publishers",
        world=_Reopened,
    )
    yield mutant("link-is-never-lost", "D-LVC-16", "LVC-010", "behind a broken link all stay alive", world=_NoLink)
    yield mutant(
        "stays-split", "D-LVC-17", "LVC-010", "who was lost behind a broken link stays lost", world=_StaysSplit
    )
    yield mutant("frozen-is-alive", "D-LVC-18", "LVC-004", "a stopped process stays alive", backend=_FrozenIsAlive)
    yield mutant(
        "second-run-ignored",
        "D-LVC-20",
        "LVC-009",
        "who comes again under the same identity is ignored",
        world=_SecondRunIgnored,
    )
    yield mutant("idle-is-lost", "D-LVC-24", "LVC-008", "an idle publisher is lost after a while", session=_TimesOut)
    yield mutant("lost-once", "D-LVC-25", "LVC-008", "a publisher is lost once, long after", session=_TimesOutOnce)
    yield mutant(
        "heartbeat-covers-manual",
        "D-LVC-30",
        "LVC-004",
        "a sign of life of the session covers MANUAL publishers",
        world=_HeartbeatCovers,
    )
    yield mutant(
        "unseen-publisher", "", "LVC-001", "a publisher that was first is not seen", world=_PublisherFirstUnseen
    )
    yield mutant("gone-is-lost", "", "LVC-003", "who is destroyed counts as not alive", world=_GoneIsLost)
    yield mutant("lost-is-gone", "", "LVC-005", "who is lost does not count as not alive", world=_LostIsGone)
    yield mutant(
        "first-subscription-only",
        "",
        "LVC-007",
        "only the first subscription of a topic is told",
        world=_FirstSubscription,
    )
    yield mutant("never-back", "", "LVC-009", "who was lost does not come back", world=_NeverBack)
    yield mutant("lease-rounds-up", "", "LVC-011", "leases are whole seconds", world=_LeaseRoundsUp)
