"""Defects of counting lost samples (MSL)."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from nros_backends.reference.backend import ReferencePublisher, ReferenceSubscription
from nros_backends.reference.mutants.build import mutant
from nros_conformance.model.world import Id, Occurrence, Sample, Topic, World, _Subscription
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import CountTracker
from nros_conformance.rmw.events import CountStatus, EventKind
from nros_conformance.rmw.mutants import Mutant
from nros_conformance.rmw.qos import QosProfile


class _Losses(World):
    """Changes how many a delivery finds lost: in gaps, and by overflow."""

    def _deliver(self, id_: Id, subscription: _Subscription, sample: Sample, at_ns: int) -> list[Occurrence]:
        gap = sample.sequence - subscription.heard.get(sample.publisher, 0)
        found = super()._deliver(id_, subscription, sample, at_ns)
        lost = [one for one in found if one.kind is EventKind.MESSAGE_LOST]
        others = [one for one in found if one.kind is not EventKind.MESSAGE_LOST]
        gaps = lost[:1] if gap > 1 else []
        return others + self.lost(subscription, sample, gaps, lost[len(gaps) :])

    def lost(
        self, subscription: _Subscription, sample: Sample, gaps: list[Occurrence], overflow: list[Occurrence]
    ) -> list[Occurrence]:
        return gaps + overflow


class _NoWire(_Losses):
    def lost(
        self, subscription: _Subscription, sample: Sample, gaps: list[Occurrence], overflow: list[Occurrence]
    ) -> list[Occurrence]:
        return overflow


class _NoOverflow(_Losses):
    def lost(
        self, subscription: _Subscription, sample: Sample, gaps: list[Occurrence], overflow: list[Occurrence]
    ) -> list[Occurrence]:
        return gaps


class _GapsNotSamples(_Losses):
    def lost(
        self, subscription: _Subscription, sample: Sample, gaps: list[Occurrence], overflow: list[Occurrence]
    ) -> list[Occurrence]:
        return [one._replace(change=(1,)) for one in gaps] + overflow


class _OneMore(_Losses):
    def lost(
        self, subscription: _Subscription, sample: Sample, gaps: list[Occurrence], overflow: list[Occurrence]
    ) -> list[Occurrence]:
        return [one._replace(change=(one.change[0] + 1,)) for one in gaps] + overflow


class _Masks(_Losses):
    def lost(
        self, subscription: _Subscription, sample: Sample, gaps: list[Occurrence], overflow: list[Occurrence]
    ) -> list[Occurrence]:
        return overflow or gaps


class _OverflowWithTheNext(_Losses):
    """An overflow is noticed when a sample is taken."""

    def lost(
        self, subscription: _Subscription, sample: Sample, gaps: list[Occurrence], overflow: list[Occurrence]
    ) -> list[Occurrence]:
        self.__dict__.setdefault("late", []).extend(overflow)
        return gaps

    def publish(
        self, id_: Id, data: bytes, at_ns: int, *, lost: bool = False, deaf: Collection[Id] = ()
    ) -> list[Occurrence]:
        late, self.__dict__["late"] = self.__dict__.get("late", []), []
        before = [one for one in late if one.at_ns < at_ns]
        found = super().publish(id_, data, at_ns, lost=lost, deaf=deaf)
        self.__dict__["late"] += [one for one in late if one.at_ns >= at_ns]
        return found + before


class _FalseLoss(_Losses):
    def lost(
        self, subscription: _Subscription, sample: Sample, gaps: list[Occurrence], overflow: list[Occurrence]
    ) -> list[Occurrence]:
        if sample.sequence % 16 == 0:
            id_ = next(id_ for id_, one in self._subscriptions.items() if one is subscription)
            at_ns = max(0, subscription.requested.anchor or 0)
            overflow = [*overflow, Occurrence(at_ns, id_, EventKind.MESSAGE_LOST, (1,))]
        return gaps + overflow


class _OneTracker(World):
    def _deliver(self, id_: Id, subscription: _Subscription, sample: Sample, at_ns: int) -> list[Occurrence]:
        last = self.__dict__.setdefault("last", {}).get(id_)
        if last is not None:
            subscription.heard[sample.publisher] = last
        self.__dict__["last"][id_] = sample.sequence
        return super()._deliver(id_, subscription, sample, at_ns)


class _NoWrap(World):
    def _deliver(self, id_: Id, subscription: _Subscription, sample: Sample, at_ns: int) -> list[Occurrence]:
        before = subscription.heard.get(sample.publisher, 0)
        found = super()._deliver(id_, subscription, sample, at_ns)
        if sample.sequence < before:
            found.append(Occurrence(at_ns, id_, EventKind.MESSAGE_LOST, (before - sample.sequence,)))
        return found


class _Unadvertised(World):
    """Numbers are those of the topic, and the first sample of whoever comes next is compared with them."""

    def destroy_publisher(self, id_: Id, at_ns: int) -> list[Occurrence]:
        gone = self._publishers[id_]
        self.__dict__.setdefault("left", {})[gone.topic] = gone.sequence
        return super().destroy_publisher(id_, at_ns)

    def create_publisher(self, id_: Id, topic: Topic, node: Id, qos: QosProfile, at_ns: int) -> list[Occurrence]:
        found = super().create_publisher(id_, topic, node, qos, at_ns)
        self._publishers[id_].sequence = self.__dict__.get("left", {}).get(topic, 0)
        return found


class _TenRecords(CountTracker):
    def __init__(self) -> None:
        super().__init__()
        self.records: list[int] = []

    def add(self, count: int, at_ns: int) -> None:
        super().add(count, at_ns)
        self.records = [*self.records, count]

    def take(self) -> CountStatus | None:
        status = super().take()
        kept, self.records = sum(self.records[-10:]), []
        return status._replace(total_count_change=kept) if status is not None else None


class _Vanishes(ReferencePublisher):
    def publish_raw(self, data: bytes) -> int:
        if len(data) > 100_000 and not self.destroyed:
            return ReturnCode.OK
        return super().publish_raw(data)


class _DuplicateIsLoss(ReferenceSubscription):
    def repeated(self, publisher: int, now_ns: int) -> None:
        self.backend.tell([Occurrence(now_ns, self.id, EventKind.MESSAGE_LOST, (1,))])


class _ExpiredIsLost(World):
    def _deliver(self, id_: Id, subscription: _Subscription, sample: Sample, at_ns: int) -> list[Occurrence]:
        expired = sum(one.expires_ns <= at_ns for one in subscription.queue)
        found = super()._deliver(id_, subscription, sample, at_ns)
        return found + ([Occurrence(at_ns, id_, EventKind.MESSAGE_LOST, (expired,))] if expired else [])


def mutants() -> Iterator[Mutant]:
    """All of this subject."""
    yield mutant("one-tracker", "D-MSL-02", "MSL-003", "all publishers share one number", world=_OneTracker)
    yield mutant("no-wire-loss", "D-MSL-05", "MSL-001", "what the wire loses is not reported", world=_NoWire)
    yield mutant(
        "ten-loss-records", "D-MSL-07", "MSL-005", "only the newest ten records of losses survive", tracker=_TenRecords
    )
    yield mutant("gaps-not-samples", "D-MSL-08", "MSL-005", "gaps are counted and not samples", world=_GapsNotSamples)
    yield mutant("one-more", "D-MSL-09", "MSL-001", "one more is counted than was lost", world=_OneMore)
    yield mutant(
        "unadvertised", "D-MSL-11", "MSL-004", "numbers of a topic go on with its next publisher", world=_Unadvertised
    )
    yield mutant("no-wrap", "D-MSL-13", "MSL-008", "numbers that wrap are a huge loss", world=_NoWrap)
    yield mutant("large-samples-vanish", "D-MSL-16", "MSL-001", "large samples vanish", publisher=_Vanishes)
    yield mutant(
        "overflow-masks-gap", "D-MSL-17", "MSL-001", "a gap is not counted when the queue overflows", world=_Masks
    )
    yield mutant("no-overflow", "", "MSL-001", "an overflow is not reported", world=_NoOverflow)
    yield mutant("false-loss", "", "MSL-002", "one in sixteen samples counts as lost besides", world=_FalseLoss)
    yield mutant(
        "expired-is-lost", "", "MSL-006", "a sample whose lifespan is over counts as lost", world=_ExpiredIsLost
    )
    yield mutant(
        "overflow-with-the-next", "", "MSL-007", "an overflow shows with the next sample", world=_OverflowWithTheNext
    )
    yield mutant("duplicate-is-loss", "", "MSL-004", "a duplicate counts as lost", subscription=_DuplicateIsLoss)
