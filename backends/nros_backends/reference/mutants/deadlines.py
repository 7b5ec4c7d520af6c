"""Defects of the two deadlines (RDM, ODM)."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

from nros_backends.reference.backend import ReferenceBackend, ReferenceSession
from nros_backends.reference.mutants.build import mutant
from nros_conformance.model.world import Id, Occurrence, Sample, Topic, World, _Periodic, _Publisher, _Subscription
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.detection import CountTracker
from nros_conformance.rmw.dispatch import EventRegistry
from nros_conformance.rmw.events import CountStatus, EventKind
from nros_conformance.rmw.mutants import Mutant
from nros_conformance.rmw.qos import QosProfile


class _Deliver(World):
    """Changes when a sample restarts the period of the subscription."""

    def _deliver(self, id_: Id, subscription: _Subscription, sample: Sample, at_ns: int) -> list[Occurrence]:
        before = (subscription.requested.anchor, subscription.requested.counted)
        empty = not subscription.queue
        found = super()._deliver(id_, subscription, sample, at_ns)
        if before[0] is not None and not self.restarts(subscription, sample, empty):
            subscription.requested.anchor, subscription.requested.counted = before
        return found

    def restarts(self, subscription: _Subscription, sample: Sample, empty: bool) -> bool:
        return True


class _AtTake(_Deliver):
    def restarts(self, subscription: _Subscription, sample: Sample, empty: bool) -> bool:
        return False

    def take(self, id_: Id, at_ns: int) -> Sample | None:
        sample = super().take(id_, at_ns)
        if sample is not None:
            self._subscriptions[id_].requested.restart(at_ns)
        return sample


class _AtHead(_Deliver):
    def restarts(self, subscription: _Subscription, sample: Sample, empty: bool) -> bool:
        return empty


class _EverySecond(_Deliver):
    def restarts(self, subscription: _Subscription, sample: Sample, empty: bool) -> bool:
        return sample.sequence % 2 == 0


class _FirstOnly(_Deliver):
    def restarts(self, subscription: _Subscription, sample: Sample, empty: bool) -> bool:
        return sample.publisher == next(iter(subscription.heard))


class _NotAfterAMiss(World):
    def _deliver(self, id_: Id, subscription: _Subscription, sample: Sample, at_ns: int) -> list[Occurrence]:
        before = subscription.requested.anchor, subscription.requested.counted
        found = super()._deliver(id_, subscription, sample, at_ns)
        if before[1]:
            subscription.requested.anchor, subscription.requested.counted = before
        return found


class _FixedWindows(_Deliver):
    """Periods lie one after the other, and one with a sample in it is good."""

    def restarts(self, subscription: _Subscription, sample: Sample, empty: bool) -> bool:
        return False

    def _deliver(self, id_: Id, subscription: _Subscription, sample: Sample, at_ns: int) -> list[Occurrence]:
        found = super()._deliver(id_, subscription, sample, at_ns)
        self.__dict__.setdefault("heard", {})[id_] = at_ns
        return found

    def advance(self, now_ns: int) -> Iterator[Occurrence]:
        heard = self.__dict__.get("heard", {})
        for one in super().advance(now_ns):
            subscription = self._subscriptions.get(one.entity)
            period = subscription.requested.period if subscription is not None else None
            missed = one.kind is EventKind.REQUESTED_DEADLINE_MISSED and period is not None
            if not (missed and heard.get(one.entity, 0) > one.at_ns - (period or 0)):
                yield one


class _HalfPeriod(World):
    def create_subscription(self, id_: Id, topic: Topic, qos: QosProfile, at_ns: int) -> list[Occurrence]:
        found = super().create_subscription(id_, topic, qos, at_ns)
        self._halve(id_)
        return found

    def set_deadline(self, id_: Id, period_ms: int) -> None:
        super().set_deadline(id_, period_ms)
        self._halve(id_)

    def _halve(self, id_: Id) -> None:
        subscription = self._subscriptions.get(id_)
        if subscription is not None and subscription.requested.period is not None:
            subscription.requested.period //= 2


class _Grid(ReferenceSession):
    def poll(self) -> bool:
        now = self.clock.now_ns()
        return super().poll() if now % (100 * MS) < 10 * MS else False

    def next_due_ns(self) -> int:
        now = self.clock.now_ns()
        return now + 100 * MS - now % (100 * MS)


class _Uninitialised(World):
    def create_subscription(self, id_: Id, topic: Topic, qos: QosProfile, at_ns: int) -> list[Occurrence]:
        found = super().create_subscription(id_, topic, qos, at_ns)
        self._subscriptions[id_].requested.restart(at_ns)
        return found

    def set_deadline(self, id_: Id, period_ms: int) -> None:
        super().set_deadline(id_, period_ms)
        subscription = self._subscriptions.get(id_)
        period = subscription.requested.period if subscription is not None else None
        if subscription is not None and period is not None and subscription.requested.anchor is not None:
            subscription.requested.anchor -= period


class _Overflows(World):
    def create_subscription(self, id_: Id, topic: Topic, qos: QosProfile, at_ns: int) -> list[Occurrence]:
        found = super().create_subscription(id_, topic, qos, at_ns)
        self._overflow(self._subscriptions[id_].requested)
        return found

    def set_deadline(self, id_: Id, period_ms: int) -> None:
        super().set_deadline(id_, period_ms)
        if id_ in self._subscriptions:
            self._overflow(self._subscriptions[id_].requested)

    def _overflow(self, deadline: _Periodic) -> None:
        if deadline.period is not None and deadline.period >= 2**31 * MS:
            deadline.period = 20 * MS


class _SharedTimer(World):
    def set_deadline(self, id_: Id, period_ms: int) -> None:
        super().set_deadline(id_, period_ms)
        self._share(id_)

    def create_subscription(self, id_: Id, topic: Topic, qos: QosProfile, at_ns: int) -> list[Occurrence]:
        found = super().create_subscription(id_, topic, qos, at_ns)
        self._share(id_)
        return found

    def _share(self, id_: Id) -> None:
        mine = self._subscriptions.get(id_)
        if mine is None:
            return
        others = [one for one in self._subscriptions.values() if one.topic == mine.topic and one.requested.period]
        if others:
            mine.requested.period = others[0].requested.period


class _Storm(EventRegistry):
    def _call_event(self, kind: EventKind) -> bool:
        registration, source = self._registered.get(kind), self._sources[kind]
        status = source.take() if registration is not None and source is not None and kind.is_deadline else None
        if registration is None or not isinstance(status, CountStatus):
            return super()._call_event(kind)
        registration.queued = False
        total, change = status
        for number in range(change):
            registration.callback(int(kind), CountStatus(total - change + number + 1, 1), registration.context)
        return True


class _OnePerPoll(CountTracker):
    def take(self) -> CountStatus | None:
        if self._since is not None:
            self.total = min(self.total, self._reported + 1)
        return super().take()


class _WallClock(ReferenceBackend):
    """Deadlines and leases are measured with the wall clock."""

    def inject(self, fault: str, **arguments: Any) -> int:
        code = super().inject(fault, **arguments)
        if fault == "clock_step":
            step = arguments["by_ns"]
            for entity in self.world._subscriptions.values():
                if entity.requested.anchor is not None:
                    entity.requested.anchor -= step
                    if step > 0 and entity.requested.period:  # once is enough
                        entity.requested.counted = step // entity.requested.period
        return code


class _DropsPeers(ReferenceBackend):
    def inject(self, fault: str, **arguments: Any) -> int:
        code = super().inject(fault, **arguments)
        if fault == "clock_step":
            now = self.clock.now_ns()
            for id_, subscription in list(self.world._subscriptions.items()):
                for publisher in list(subscription.believes):
                    self.tell(self.world._believe(id_, subscription, publisher, now, False))
        return code


class _StepCrashes(ReferenceSession):
    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        if self.wall_clock_step_ns < 0:
            raise OverflowError("the clock went backwards")
        return super().drive_io(timeout_ms, max_callbacks)


class _Unwatched(World):
    def publish(
        self, id_: Id, data: bytes, at_ns: int, *, lost: bool = False, deaf: Collection[Id] = ()
    ) -> list[Occurrence]:
        found = super().publish(id_, data, at_ns, lost=lost, deaf=deaf)
        if not any(self.matched(id_, subscription) for subscription in self._subscriptions):
            self._publishers[id_].offered.anchor = None
        return found


class _StaleExpiry(World):
    def create_publisher(self, id_: Id, topic: Topic, node: Id, qos: QosProfile, at_ns: int) -> list[Occurrence]:
        found = super().create_publisher(id_, topic, node, qos, at_ns)
        self.__dict__.setdefault("made", {})[id_] = at_ns
        return found

    def publish(
        self, id_: Id, data: bytes, at_ns: int, *, lost: bool = False, deaf: Collection[Id] = ()
    ) -> list[Occurrence]:
        offered = self._publishers[id_].offered
        first, made = offered.anchor is None, self.__dict__["made"][id_]
        found = super().publish(id_, data, at_ns, lost=lost, deaf=deaf)
        if first and offered.period is not None and at_ns - made > offered.period:
            found.append(Occurrence(at_ns, id_, EventKind.OFFERED_DEADLINE_MISSED, (1,)))
        return found


class _AssertRestarts(World):
    def assert_liveliness(self, id_: Id, at_ns: int) -> list[Occurrence]:
        found = super().assert_liveliness(id_, at_ns)
        self._publishers[id_].offered.restart(at_ns)
        return found


class _SharedOffer(World):
    def publish(
        self, id_: Id, data: bytes, at_ns: int, *, lost: bool = False, deaf: Collection[Id] = ()
    ) -> list[Occurrence]:
        found = super().publish(id_, data, at_ns, lost=lost, deaf=deaf)
        for other in self._publishers.values():
            if other.topic == self._publishers[id_].topic and other.offered.anchor is not None:
                other.offered.restart(at_ns)
        return found


class _Once(World):
    """Tells of the first miss of each silence only."""

    kind = EventKind.OFFERED_DEADLINE_MISSED

    def advance(self, now_ns: int) -> Iterator[Occurrence]:
        for one in super().advance(now_ns):
            if one.kind is self.kind and self._counted(one.entity) > 1:
                continue
            yield one

    def _counted(self, id_: Id) -> int:
        publisher: _Publisher | None = self._publishers.get(id_)
        return publisher.offered.counted if publisher else self._subscriptions[id_].requested.counted


class _OnceRequested(_Once):
    kind = EventKind.REQUESTED_DEADLINE_MISSED


class _OnlyOnPublish(World):
    def advance(self, now_ns: int) -> Iterator[Occurrence]:
        late = self.__dict__.setdefault("held", [])
        for one in super().advance(now_ns):
            if one.kind is EventKind.OFFERED_DEADLINE_MISSED:
                late.append(one)
            else:
                yield one

    def publish(
        self, id_: Id, data: bytes, at_ns: int, *, lost: bool = False, deaf: Collection[Id] = ()
    ) -> list[Occurrence]:
        found = super().publish(id_, data, at_ns, lost=lost, deaf=deaf)
        held = self.__dict__.get("held", [])
        found += [one for one in held if one.entity == id_]
        held[:] = [one for one in held if one.entity != id_]
        return found


def mutants() -> Iterator[Mutant]:
    """All of this subject."""
    yield mutant("deadline-at-take", "D-RDM-01", "RDM-005", "the period is measured at the take", world=_AtTake)
    yield mutant("deadline-at-head", "D-RDM-03", "RDM-005", "a sample behind others is not noticed", world=_AtHead)
    yield mutant("fires-early", "D-RDM-07", "RDM-001", "a miss is reported after half the period", world=_HalfPeriod)
    yield mutant("fires-on-a-grid", "D-RDM-08", "RDM-001", "misses are looked for every 100 ms", session=_Grid)
    yield mutant("fixed-windows", "D-RDM-09", "RDM-004", "periods are fixed windows", world=_FixedWindows)
    yield mutant(
        "uninitialised-time", "D-RDM-10", "RDM-008", "a miss is reported before any sample", world=_Uninitialised
    )
    yield mutant("period-overflows", "D-RDM-12", "RDM-008", "a huge period overflows and fires", world=_Overflows)
    yield mutant("shared-timer", "D-RDM-16", "RDM-007", "subscriptions on one topic share a period", world=_SharedTimer)
    yield mutant("storm", "D-RDM-17", "RDM-009", "a backlog comes as one callback for each period", registry=_Storm)
    yield mutant("every-second-sample", "", "RDM-002", "every second sample restarts no period", world=_EverySecond)
    yield mutant(
        "one-miss-per-poll",
        "",
        "RDM-003",
        "one miss is counted per drive, however many periods have elapsed",
        tracker=_OnePerPoll,
    )
    yield mutant("single-miss", "", "RDM-003", "only the first miss of a silence is reported", world=_OnceRequested)
    yield mutant("not-rearmed", "", "RDM-004", "no sample restarts the period after a miss", world=_NotAfterAMiss)
    yield mutant(
        "first-publisher-only",
        "",
        "RDM-007",
        "only the samples of the first publisher restart the period",
        world=_FirstOnly,
    )
    yield mutant("wall-clock-deadline", "", "RDM-006", "deadlines are measured with the wall clock", backend=_WallClock)
    yield mutant(
        "wall-clock-drops-peers",
        "D-LVC-26",
        "RDM-006",
        "a step of the wall clock drops the publishers",
        backend=_DropsPeers,
    )
    yield mutant(
        "wall-clock-crashes", "D-ROB-09", "RDM-006", "a wall clock that goes back crashes", session=_StepCrashes
    )
    yield mutant(
        "no-offer-without-subscription",
        "D-ODM-02",
        "ODM-001",
        "nothing is monitored without a subscription",
        world=_Unwatched,
    )
    yield mutant("stale-expiry", "D-ODM-05", "ODM-002", "the time before the first publish counts", world=_StaleExpiry)
    yield mutant(
        "assertion-restarts-offer",
        "D-ODM-07",
        "ODM-004",
        "an assertion restarts the offered deadline",
        world=_AssertRestarts,
    )
    yield mutant(
        "shared-offer",
        "D-ODM-08",
        "ODM-002",
        "any publisher of the topic restarts the offered deadline",
        world=_SharedOffer,
    )
    yield mutant("single-offered-miss", "", "ODM-003", "only the first miss of a silence is reported", world=_Once)
    yield mutant(
        "offered-miss-on-publish", "", "ODM-001", "a missed publish is found at the next one", world=_OnlyOnPublish
    )
