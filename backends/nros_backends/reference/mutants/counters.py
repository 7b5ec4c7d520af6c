"""Defects of the payload's counters (CNT)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from nros_backends.reference.backend import ReferenceBackend
from nros_backends.reference.mutants.build import mutant
from nros_conformance.model.world import Id, Occurrence, Topic, World
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.detection import U16, U32, CountTracker, LivelinessTally
from nros_conformance.rmw.events import CountStatus, EventKind, LivelinessChangedStatus
from nros_conformance.rmw.mutants import Mutant
from nros_conformance.rmw.qos import QosProfile


class _StaysReady(CountTracker):
    def take(self) -> CountStatus | None:
        since, status = self._since, super().take()
        self._since = since
        return status


class _KeepsCancelled(LivelinessTally):
    def set(self, alive: int, not_alive: int, at_ns: int) -> None:
        super().set(alive, not_alive, at_ns)
        self._since = at_ns if self._since is None else self._since


class _NeverNotAlive(LivelinessTally):
    def take(self) -> LivelinessChangedStatus | None:
        status = super().take()
        return status._replace(not_alive_count=0) if status is not None else None


class _Shares(ReferenceBackend):
    def tell(self, occurrences: Iterable[Occurrence]) -> None:
        for one in occurrences:
            every = [one.entity]
            if one.kind is EventKind.REQUESTED_DEADLINE_MISSED:
                every = [id_ for id_, entity in self.entities.items() if one.kind in entity.sources]
            super().tell([one._replace(entity=entity) for entity in every])


class _TotalIsChange(CountTracker):
    def take(self) -> CountStatus | None:
        status = super().take()
        return status._replace(total_count=status.total_count_change) if status is not None else None


class _GoesTwice(World):
    """Whoever is seen only at its going goes twice."""

    def create_subscription(self, id_: Id, topic: Topic, qos: QosProfile, at_ns: int) -> list[Occurrence]:
        self.__dict__.setdefault("born", {})[id_] = at_ns
        return super().create_subscription(id_, topic, qos, at_ns)

    def destroy_publisher(self, id_: Id, at_ns: int) -> list[Occurrence]:
        found = super().destroy_publisher(id_, at_ns)
        born = self.__dict__.get("born", {})
        again = [one for one in found if one.change == (-1, 0) and at_ns - born[one.entity] < 50 * MS]
        return found + again


class _Underflows(LivelinessTally):
    def take(self) -> LivelinessChangedStatus | None:
        status = super().take()
        return status._replace(alive_count=status.alive_count % U16) if status is not None else None


class _NoChange(CountTracker):
    def take(self) -> CountStatus | None:
        status = super().take()
        return status._replace(total_count_change=0) if status is not None else None


class _NoAliveChange(LivelinessTally):
    def take(self) -> LivelinessChangedStatus | None:
        status = super().take()
        return status and status._replace(alive_count_change=0, not_alive_count_change=0)


class _WrapsSilently(CountTracker):
    def take(self) -> CountStatus | None:
        status, total = super().take(), self.total
        return status._replace(total_count=total % U32) if status is not None else None


class _StartsFromOne(CountTracker):
    def __init__(self) -> None:
        super().__init__()
        self.total = 1


def mutants() -> Iterator[Mutant]:
    """All of this subject."""
    yield mutant(
        "stays-ready", "D-DSP-28", "CNT-003", "the same occurrence is delivered on every spin", tracker=_StaysReady
    )
    yield mutant(
        "keeps-cancelled",
        "D-CNT-03",
        "CNT-003",
        "transitions that cancel out are called back with no change",
        tally=_KeepsCancelled,
    )
    yield mutant(
        "never-not-alive",
        "D-CNT-04",
        "CNT-004",
        "not_alive_count stays 0 while its change says +1",
        tally=_NeverNotAlive,
    )
    yield mutant(
        "shares-counters", "D-CNT-06", "RDM-007", "the misses of one subscription count on all", backend=_Shares
    )
    yield mutant("total-is-change", "D-CNT-07", "CNT-002", "total_count reports the change", tracker=_TotalIsChange)
    yield mutant(
        "underflows", "D-CNT-09", "CNT-005", "alive_count falls below zero", world=_GoesTwice, tally=_Underflows
    )
    yield mutant("no-change", "D-CNT-11", "CNT-002", "the change is always 0", tracker=_NoChange)
    yield mutant(
        "no-alive-change", "D-CNT-11", "CNT-004", "the changes of LivelinessChanged are always 0", tally=_NoAliveChange
    )
    yield mutant("starts-from-one", "", "CNT-001", "totals do not start from zero", tracker=_StartsFromOne)
    yield mutant(
        "wraps-silently", "", "CNT-007", "totals wrap although they are declared to saturate", tracker=_WrapsSilently
    )
