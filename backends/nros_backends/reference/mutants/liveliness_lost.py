"""Defects of leases, and of what asserts liveliness (LVL)."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from nros_backends.reference.backend import ReferencePublisher
from nros_backends.reference.mutants.build import mutant
from nros_conformance.model.world import Id, Occurrence, Topic, World
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.mutants import Mutant
from nros_conformance.rmw.qos import QosProfile


class _LostOnce(World):
    def advance(self, now_ns: int) -> Iterator[Occurrence]:
        lost = self.__dict__.setdefault("lost", set())
        for one in super().advance(now_ns):
            if one.kind is EventKind.LIVELINESS_LOST:
                if one.entity in lost:
                    continue
                lost.add(one.entity)
            yield one


class _LostEachLease(World):
    def advance(self, now_ns: int) -> Iterator[Occurrence]:
        for one in super().advance(now_ns):
            yield one
            if one.kind is EventKind.LIVELINESS_LOST:
                publisher = self._publishers[one.entity]
                publisher.alive, publisher.asserted = True, one.at_ns


class _RefusesAssertion(ReferencePublisher):
    def assert_liveliness(self) -> int:
        return super().assert_liveliness() if self.qos.liveliness.is_manual else ReturnCode.UNSUPPORTED


class _Covers(World):
    """Changes which publishers an assertion covers."""

    def _assert(self, id_: Id, at_ns: int) -> list[Occurrence]:
        found: list[Occurrence] = []
        for one in self.covered(id_):
            self._publishers[one].asserted = at_ns
            if not self._publishers[one].alive:
                self._publishers[one].alive = True
                found += self._tell(one, self._publishers[one], at_ns, True)
        return found

    def covered(self, id_: Id) -> list[Id]:
        return [id_]


class _CoversAll(_Covers):
    def covered(self, id_: Id) -> list[Id]:
        node = self._publishers[id_].node
        return [other for other, one in self._publishers.items() if one.node == node and one.qos.liveliness.is_manual]


class _AutomaticLost(World):
    def create_publisher(self, id_: Id, topic: Topic, node: Id, qos: QosProfile, at_ns: int) -> list[Occurrence]:
        found = super().create_publisher(id_, topic, node, qos, at_ns)
        publisher = self._publishers[id_]
        if publisher.lease is not None and not qos.liveliness.is_manual:
            self.__dict__.setdefault("silent", {})[id_] = at_ns + publisher.lease
        return found

    def advance(self, now_ns: int) -> Iterator[Occurrence]:
        yield from super().advance(now_ns)
        silent = self.__dict__.get("silent", {})
        for id_, due in list(silent.items()):
            if due <= now_ns and id_ in self._publishers:
                del silent[id_]
                yield Occurrence(due, id_, EventKind.LIVELINESS_LOST, (1,))


class _LostAtAssertion(World):
    def advance(self, now_ns: int) -> Iterator[Occurrence]:
        held = self.__dict__.setdefault("held", [])
        for one in super().advance(now_ns):
            if one.kind is EventKind.LIVELINESS_LOST:
                held.append(one)
            else:
                yield one

    def _assert(self, id_: Id, at_ns: int) -> list[Occurrence]:
        held = self.__dict__.setdefault("held", [])
        found = [one for one in held if one.entity == id_]
        held[:] = [one for one in held if one.entity != id_]
        return found + super()._assert(id_, at_ns)


class _PublishAssertsNothing(World):
    publishing = False

    def publish(
        self, id_: Id, data: bytes, at_ns: int, *, lost: bool = False, deaf: Collection[Id] = ()
    ) -> list[Occurrence]:
        self.publishing = True
        try:
            return super().publish(id_, data, at_ns, lost=lost, deaf=deaf)
        finally:
            self.publishing = False

    def _assert(self, id_: Id, at_ns: int) -> list[Occurrence]:
        return [] if self.publishing else super()._assert(id_, at_ns)


def mutants() -> Iterator[Mutant]:
    """All of this subject."""
    yield mutant("lost-only-once", "D-LVL-03", "LVL-002", "LivelinessLost is not armed again", world=_LostOnce)
    yield mutant(
        "assertion-refused", "D-LVL-05", "LVL-003", "an assertion is refused for AUTOMATIC", publisher=_RefusesAssertion
    )
    yield mutant(
        "by-node-is-by-topic", "D-LVL-07", "LVL-006", "MANUAL_BY_NODE is treated as MANUAL_BY_TOPIC", world=_Covers
    )
    yield mutant(
        "assertion-covers-all",
        "D-LVL-08",
        "LVL-006",
        "an assertion covers all publishers of the node",
        world=_CoversAll,
    )
    yield mutant("automatic-lost", "D-LVL-09", "LVL-005", "an AUTOMATIC publisher reports a loss", world=_AutomaticLost)
    yield mutant("lost-each-lease", "", "LVL-002", "LivelinessLost comes once for each lease", world=_LostEachLease)
    yield mutant(
        "lost-at-assertion", "", "LVL-001", "a missed assertion is found at the next one", world=_LostAtAssertion
    )
    yield mutant(
        "publish-asserts-nothing",
        "",
        "LVL-004",
        "publishing does not count as an assertion",
        world=_PublishAssertsNothing,
    )
