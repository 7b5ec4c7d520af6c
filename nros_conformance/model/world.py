"""The reference semantics of the five events: a pure state machine, readable as the specification.

Actions go in with their time, exact occurrences come out. Nothing here waits, coalesces, dispatches
or knows who is registered: that is a backend's business, and the judge's to allow for. A link
without delay is assumed, so a sample is received when it is published. Times are nanoseconds; the
caller's times must not decrease.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Hashable, Iterator
from typing import NamedTuple, TypeAlias

from nros_conformance.rmw.clock import MS, NEVER
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import History, Liveliness, QosProfile, is_finite

Id: TypeAlias = Hashable
NUMBERS = 2**32
"""The wire numbers the samples of a publisher with u32, wrapping (MSL-008)."""

Topic: TypeAlias = tuple[int, str, str]
"""Domain, topic name, type name: what has to be equal for two entities to meet."""


class Occurrence(NamedTuple):
    """Something that an entity has to be told. ``change``: of the total, or (alive, not alive)."""

    at_ns: int
    entity: Id
    kind: EventKind
    change: tuple[int, ...]


class Sample(NamedTuple):
    """A sample in a subscription's queue."""

    publisher: Id
    sequence: int
    expires_ns: int
    data: bytes


def _ns(duration_ms: int) -> int | None:
    return duration_ms * MS if is_finite(duration_ms) else None


@dataclasses.dataclass(slots=True)
class _Periodic:
    """A deadline: periods elapsed since the last sample. Not armed before the first one (RDM-008)."""

    period: int | None
    anchor: int | None = None
    counted: int = 0

    def restart(self, at_ns: int) -> None:
        self.anchor, self.counted = at_ns, 0

    @property
    def due(self) -> int:
        if self.period is None or self.anchor is None:
            return NEVER
        return self.anchor + (self.counted + 1) * self.period


@dataclasses.dataclass(slots=True)
class _Publisher:
    topic: Topic
    node: Id
    qos: QosProfile
    offered: _Periodic
    asserted: int
    lease: int | None
    alive: bool = True
    sequence: int = 0
    history: list[Sample] = dataclasses.field(default_factory=list)

    @property
    def expiry(self) -> int:
        """When its lease runs out; AUTOMATIC and NONE are asserted by the middleware (LVL-005)."""
        if not self.alive or self.lease is None or not self.qos.liveliness.is_manual:
            return NEVER
        return self.asserted + self.lease


@dataclasses.dataclass(slots=True)
class _Subscription:
    topic: Topic
    qos: QosProfile
    requested: _Periodic
    queue: list[Sample] = dataclasses.field(default_factory=list)
    heard: dict[Id, int] = dataclasses.field(default_factory=dict)
    history: list[Sample] = dataclasses.field(default_factory=list)
    """Samples of before it existed: delivered, never lost (MSL-004)."""
    believes: dict[Id, bool] = dataclasses.field(default_factory=dict)
    """The publishers that it knows of, and whether it takes them for alive."""
    severed: dict[Id, int] = dataclasses.field(default_factory=dict)
    """Publishers that cannot reach it, and when they count as not alive for that."""


class World:
    """All publishers and subscriptions of all sessions, and what has happened to them."""

    def __init__(self) -> None:
        self._publishers: dict[Id, _Publisher] = {}
        self._subscriptions: dict[Id, _Subscription] = {}
        self._apart: dict[Id, bool] = {}
        """Entities that nothing connects with the others, and whether for good."""

    # Actions. Each first lets time pass to ``at_ns``; all occurrences come back, oldest first.

    def create_publisher(self, id_: Id, topic: Topic, node: Id, qos: QosProfile, at_ns: int) -> list[Occurrence]:
        """A publisher appears; its creation is its first assertion."""
        found = list(self.advance(at_ns))
        publisher = _Publisher(topic, node, qos, _Periodic(_ns(qos.deadline_ms)), at_ns, _ns(qos.lease_ms))
        self._publishers[id_] = publisher
        return found + self._tell(id_, publisher, at_ns, True)

    def create_subscription(self, id_: Id, topic: Topic, qos: QosProfile, at_ns: int) -> list[Occurrence]:
        """A subscription appears and finds the publishers that exist, dead or alive (REG-009)."""
        found = list(self.advance(at_ns))
        subscription = _Subscription(topic, qos, _Periodic(_ns(qos.deadline_ms)))
        self._subscriptions[id_] = subscription
        for publisher_id, publisher in self._publishers.items():
            if self.matched(publisher_id, id_):
                found += self._believe(id_, subscription, publisher_id, at_ns, publisher.alive)
                subscription.heard[publisher_id] = publisher.sequence
                if subscription.qos.durability:
                    subscription.history += publisher.history
                    for sample in publisher.history:
                        found += self._deliver(id_, subscription, sample, at_ns)
        return found

    def destroy_publisher(self, id_: Id, at_ns: int) -> list[Occurrence]:
        """An orderly goodbye: what it counted as is taken back (LVC-002, LVC-003)."""
        found = list(self.advance(at_ns))
        publisher = self._publishers.pop(id_)
        self._apart.pop(id_, None)
        return found + self._tell(id_, publisher, at_ns, None)

    def destroy_subscription(self, id_: Id, at_ns: int) -> list[Occurrence]:
        """Nothing is told to anybody."""
        found = list(self.advance(at_ns))
        del self._subscriptions[id_]
        self._apart.pop(id_, None)
        return found

    def publish(
        self, id_: Id, data: bytes, at_ns: int, *, lost: bool = False, deaf: Collection[Id] = ()
    ) -> list[Occurrence]:
        """A successful publish: restarts the offered deadline, asserts liveliness, is received.

        ``lost``: the wire swallows it; the gap shows with the next sample of this publisher (MSL-001).
        ``deaf``: subscriptions that it does not reach.
        """
        found = list(self.advance(at_ns - 1))  # at the very moment of a deadline or expiry is in time
        publisher = self._publishers[id_]
        found += self._assert(id_, at_ns)
        publisher.offered.restart(at_ns)
        publisher.sequence = (publisher.sequence + 1) % NUMBERS
        lifespan = _ns(publisher.qos.lifespan_ms)
        sample = Sample(id_, publisher.sequence, NEVER if lifespan is None else at_ns + lifespan, data)
        if publisher.qos.durability:
            publisher.history = [*publisher.history, sample][-max(publisher.qos.depth, 1) :]
        if not lost:
            for subscription_id, subscription in self._subscriptions.items():
                if id_ in subscription.severed or subscription_id in deaf:
                    continue
                if self.matched(id_, subscription_id):
                    found += self._deliver(subscription_id, subscription, sample, at_ns)
        return found

    def assert_liveliness(self, id_: Id, at_ns: int) -> list[Occurrence]:
        """A manual assertion; MANUAL_BY_NODE covers its siblings of the same node (LVL-006)."""
        found = list(self.advance(at_ns - 1))  # at the very moment of a deadline or expiry is in time
        return found + self._assert(id_, at_ns)

    def take(self, id_: Id, at_ns: int) -> Sample | None:
        """The oldest sample whose lifespan is not over. Expired ones are not lost (MSL-006)."""
        queue = self._subscriptions[id_].queue
        _expire(queue, at_ns)
        return queue.pop(0) if queue else None

    def peek(self, id_: Id, at_ns: int) -> Sample | None:
        """What `take` would return."""
        queue = self._subscriptions[id_].queue
        _expire(queue, at_ns)
        return queue[0] if queue else None

    def waits(self, id_: Id, sample: Sample, at_ns: int) -> bool:
        """Whether this sample can still be taken."""
        queue = self._subscriptions[id_].queue
        _expire(queue, at_ns)
        return any(one is sample for one in queue)

    def newest(self, id_: Id, publisher: Id) -> Sample | None:
        """What this publisher sent last, if it came and can still be taken."""
        last = (self._publishers[publisher].sequence, publisher)
        queue = self._subscriptions[id_].queue
        return next((one for one in reversed(queue) if (one.sequence, one.publisher) == last), None)

    def preset(self, id_: Id, number: int) -> None:
        """Move the numbers of all publishers of an entity's topic to ``number``. Nothing is lost by it."""
        topic = (self._publishers.get(id_) or self._subscriptions[id_]).topic
        for publisher_id, publisher in self._publishers.items():
            if publisher.topic == topic:
                shift = number - publisher.sequence
                publisher.sequence = number % NUMBERS
                for subscription in self._subscriptions.values():
                    if publisher_id in subscription.heard:
                        subscription.heard[publisher_id] = (subscription.heard[publisher_id] + shift) % NUMBERS

    def set_deadline(self, id_: Id, period_ms: int) -> None:
        """A period given only at registration; it counts from the next sample on (C04)."""
        if id_ in self._publishers:
            self._publishers[id_].offered.period = _ns(period_ms)
        else:
            self._subscriptions[id_].requested.period = _ns(period_ms)

    # The link.

    def sever(self, publisher: Id, subscription: Id, lease_ms: int, at_ns: int) -> list[Occurrence]:
        """From now on nothing of this publisher reaches the subscription; a lost link shows by a lease.

        By that of the publisher, from its last assertion on, if it has one; else by ``lease_ms``, the connection's.
        """
        found = list(self.advance(at_ns))
        sender = self._publishers[publisher]
        lease = lease_ms * MS if sender.lease is None else sender.lease
        begin = sender.asserted if sender.qos.liveliness.is_manual and sender.lease is not None else at_ns
        self._subscriptions[subscription].severed.setdefault(publisher, begin + lease)
        return found

    def restore(self, publisher: Id, subscription: Id, at_ns: int) -> list[Occurrence]:
        """What it sends arrives again, beginning with whether it still lives (LVC-010)."""
        found = list(self.advance(at_ns))
        receiver = self._subscriptions[subscription]
        if receiver.severed.pop(publisher, None) is None:
            return found
        sender = self._publishers.get(publisher)
        return found + self._believe(subscription, receiver, publisher, at_ns, sender.alive if sender else None)

    def part(self, id_: Id, at_ns: int, *, for_good: bool = False) -> list[Occurrence]:
        """An entity has lost the others: to its subscriptions a publisher is not alive, ``for_good`` it is gone."""
        found = list(self.advance(at_ns))
        self._apart[id_] = for_good or self._apart.get(id_, False)
        for publisher, subscription in self._pairs(id_):
            receiver = self._subscriptions[subscription]
            if publisher in receiver.believes:
                alive = None if self._apart.get(publisher) else False
                found += self._believe(subscription, receiver, publisher, at_ns, alive)
        return found

    def rejoin(self, id_: Id, at_ns: int) -> list[Occurrence]:
        """The way is free again, unless it had parted for good."""
        found = list(self.advance(at_ns))
        if self._apart.get(id_) is False:
            del self._apart[id_]
        for publisher, subscription in self._pairs(id_):
            if self.matched(publisher, subscription):
                receiver, alive = self._subscriptions[subscription], self._publishers[publisher].alive
                found += self._believe(subscription, receiver, publisher, at_ns, alive)
        return found

    def _pairs(self, id_: Id) -> list[tuple[Id, Id]]:
        """A publisher and all that it could reach, or a subscription and all that could reach it."""
        if id_ in self._subscriptions:
            return [(publisher, id_) for publisher in self._publishers]
        return [(id_, subscription) for subscription in self._subscriptions]

    # Time.

    @property
    def next_due_ns(self) -> int:
        """When something happens by itself next; `NEVER` if nothing does."""
        return min(
            (
                *(min(publisher.offered.due, publisher.expiry) for publisher in self._publishers.values()),
                *(subscription.requested.due for subscription in self._subscriptions.values()),
                *(due for subscription in self._subscriptions.values() for due in subscription.severed.values()),
            ),
            default=NEVER,
        )

    def advance(self, now_ns: int) -> Iterator[Occurrence]:
        """Let time pass: deadlines and leases that run out by ``now_ns``, oldest first."""
        while (due := self.next_due_ns) <= now_ns:
            for id_, subscription in self._subscriptions.items():
                if subscription.requested.due == due:
                    subscription.requested.counted += 1
                    yield Occurrence(due, id_, EventKind.REQUESTED_DEADLINE_MISSED, (1,))
                for publisher_id, expiry in subscription.severed.items():
                    if expiry == due:
                        subscription.severed[publisher_id] = NEVER
                        if subscription.believes.get(publisher_id):
                            yield from self._believe(id_, subscription, publisher_id, due, False)
            for id_, publisher in self._publishers.items():
                if publisher.offered.due == due:
                    publisher.offered.counted += 1
                    yield Occurrence(due, id_, EventKind.OFFERED_DEADLINE_MISSED, (1,))
                if publisher.expiry == due:
                    publisher.alive = False
                    yield Occurrence(due, id_, EventKind.LIVELINESS_LOST, (1,))
                    yield from self._tell(id_, publisher, due, False)

    def matched(self, publisher: Id, subscription: Id) -> bool:
        """Whether the two know each other."""
        if publisher in self._apart or subscription in self._apart:
            return False
        first, second = self._publishers.get(publisher), self._subscriptions.get(subscription)
        return first is not None and second is not None and matches(first.topic, first.qos, second.topic, second.qos)

    # Parts of actions.

    def _assert(self, id_: Id, at_ns: int) -> list[Occurrence]:
        publisher = self._publishers[id_]
        kind = publisher.qos.liveliness
        covered = [id_]
        if kind is Liveliness.MANUAL_BY_NODE:
            covered = [
                id_ for id_, one in self._publishers.items() if (one.node, one.qos.liveliness) == (publisher.node, kind)
            ]
        found: list[Occurrence] = []
        for one in covered:
            self._publishers[one].asserted = at_ns
            if not self._publishers[one].alive:
                self._publishers[one].alive = True
                found += self._tell(one, self._publishers[one], at_ns, True)
        return found

    def _tell(self, id_: Id, publisher: _Publisher, at_ns: int, alive: bool | None) -> list[Occurrence]:
        """Whether a publisher is alive, to all that it can reach; None: it is gone."""
        found: list[Occurrence] = []
        for subscription_id, subscription in self._subscriptions.items():
            apart = id_ in subscription.severed or id_ in self._apart or subscription_id in self._apart
            if id_ in subscription.severed and alive is None:
                continue
            if (alive is None and id_ in subscription.believes) or (
                not apart and matches(publisher.topic, publisher.qos, subscription.topic, subscription.qos)
            ):
                found += self._believe(subscription_id, subscription, id_, at_ns, alive)
        return found

    def _believe(
        self, id_: Id, subscription: _Subscription, publisher: Id, at_ns: int, alive: bool | None
    ) -> list[Occurrence]:
        """The subscription learns it: alive_count and not_alive_count change accordingly (CNT-004)."""
        before = subscription.believes.get(publisher)
        if alive is None:
            subscription.believes.pop(publisher, None)
        else:
            subscription.believes[publisher] = alive
        change = ((alive is True) - (before is True), (alive is False) - (before is False))
        return [Occurrence(at_ns, id_, EventKind.LIVELINESS_CHANGED, change)] if any(change) else []

    def _deliver(self, id_: Id, subscription: _Subscription, sample: Sample, at_ns: int) -> list[Occurrence]:
        found = []
        step = (sample.sequence - subscription.heard.get(sample.publisher, 0)) % NUMBERS
        if step <= NUMBERS // 2:  # else it is older, from the history of before the subscription
            if step > 1:
                found.append(Occurrence(at_ns, id_, EventKind.MESSAGE_LOST, (step - 1,)))
            subscription.heard[sample.publisher] = sample.sequence
        subscription.requested.restart(at_ns)
        queue = subscription.queue
        _expire(queue, at_ns)
        queue.append(sample)
        if subscription.qos.history is History.KEEP_LAST and len(queue) > max(subscription.qos.depth, 1):
            dropped = queue.pop(0)
            if not any(dropped is one for one in subscription.history):
                found.append(Occurrence(at_ns, id_, EventKind.MESSAGE_LOST, (1,)))
        return found


def _expire(queue: list[Sample], now_ns: int) -> None:
    queue[:] = [sample for sample in queue if now_ns < sample.expires_ns]


def matches(offered: Topic, publisher: QosProfile, requested: Topic, subscription: QosProfile) -> bool:
    """Request versus offered (DDS 1.4 2.2.3): same topic, and nothing asked for that is not offered."""
    return (
        offered == requested
        and publisher.reliability >= subscription.reliability
        and publisher.durability >= subscription.durability
        and _period(publisher.deadline_ms) <= _period(subscription.deadline_ms)
        and publisher.liveliness.strength >= subscription.liveliness.strength
        and _period(publisher.lease_ms) <= _period(subscription.lease_ms)
    )


def _period(duration_ms: int) -> int:
    return duration_ms if is_finite(duration_ms) else NEVER
