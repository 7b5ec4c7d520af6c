from __future__ import annotations

import dataclasses
import gc
import weakref
from collections.abc import Callable
from datetime import timedelta
from typing import Any

import pytest

from nros_conformance.node import Context, Executor, Node, Publisher, Subscription, UnsupportedError
from nros_conformance.rmw.clock import MS, VirtualClock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import CountStatus, EventKind
from nros_conformance.rmw.qos import DEFAULT, QosProfile
from tests.node.fakes import PolledSubscription, QueueSession
from tests.node.pair import MANUAL, TOPIC, TYPE, Pair, ms

# The five events.


def test_liveliness_changed_tells_the_counts_and_their_changes(pair: Pair) -> None:
    publisher, subscription, seen = pair.publisher(MANUAL), pair.subscription(), list[tuple[int, int, int, int]]()
    subscription.on_liveliness_changed(
        lambda status: seen.append(
            (status.alive_count, status.not_alive_count, status.alive_count_change, status.not_alive_count_change)
        )
    )
    pair.executor.spin(ms(150))
    publisher.publish(b"x")
    pair.executor.spin(ms(10))
    publisher.destroy()
    pair.executor.spin(ms(10))
    assert seen == [(1, 0, 1, 0), (0, 1, -1, 1), (1, 0, 1, -1), (0, 0, -1, 0)]


def test_requested_deadline_missed_counts_periods_without_a_sample(pair: Pair) -> None:
    publisher, subscription, seen = pair.publisher(), pair.subscription(), list[tuple[int, int]]()
    subscription.on_requested_deadline_missed(
        ms(15), lambda status: seen.append((status.total_count, status.total_count_change))
    )
    publisher.publish(b"x")
    pair.executor.spin(ms(40))
    pair.clock.wait(None, pair.clock.now_ns() + 40 * MS)
    pair.executor.spin_once()
    assert seen == [(1, 1), (2, 1), (5, 3)]


def test_message_lost_counts_what_did_not_fit(pair: Pair) -> None:
    publisher, subscription, seen = pair.publisher(), pair.subscription(QosProfile(depth=2)), list[CountStatus]()
    subscription.on_message_lost(seen.append)
    for number in range(5):
        publisher.publish(bytes([number]))
    pair.executor.spin_once()
    assert seen == [(3, 3)]
    assert [subscription.try_recv(), subscription.try_recv(), subscription.try_recv()] == [b"\3", b"\4", None]


def test_liveliness_lost_tells_the_publisher_that_it_did_not_assert(pair: Pair) -> None:
    publisher, seen = pair.publisher(MANUAL), list[CountStatus]()
    publisher.on_liveliness_lost(seen.append)
    for _ in range(4):
        pair.executor.spin(ms(90))
        publisher.assert_liveliness()
    assert seen == []
    pair.executor.spin(ms(350))
    assert seen == [(1, 1)]


def test_offered_deadline_missed_counts_periods_without_a_publish(pair: Pair) -> None:
    publisher, seen = pair.publisher(), list[CountStatus]()
    publisher.on_offered_deadline_missed(ms(10), seen.append)
    publisher.publish(b"x")
    pair.executor.spin(ms(25))
    assert seen == [(1, 1), (2, 1)]


def test_a_second_callback_replaces_the_first(pair: Pair) -> None:
    subscription, first, second = pair.subscription(), list[object](), list[object]()
    subscription.on_liveliness_changed(first.append)
    subscription.on_liveliness_changed(second.append)
    pair.publisher()
    pair.executor.spin_once()
    assert (first, second) == ([], [(1, 0, 1, 0)])


# What cannot be registered.

REGISTER: dict[EventKind, Callable[[Any], object]] = {
    EventKind.LIVELINESS_CHANGED: lambda end: end.on_liveliness_changed(print),
    EventKind.REQUESTED_DEADLINE_MISSED: lambda end: end.on_requested_deadline_missed(ms(15), print),
    EventKind.MESSAGE_LOST: lambda end: end.on_message_lost(print),
    EventKind.LIVELINESS_LOST: lambda end: end.on_liveliness_lost(print),
    EventKind.OFFERED_DEADLINE_MISSED: lambda end: end.on_offered_deadline_missed(ms(15), print),
}


@pytest.mark.parametrize("kind", [kind for kind in EventKind if kind is not EventKind.MESSAGE_LOST])
def test_registering_what_the_backend_refuses_raises_an_error_that_carries_unsupported(kind: EventKind) -> None:
    with Context("uorb") as context:
        node = context.create_node("node")
        ends: dict[str, Publisher | Subscription] = {
            "publisher": node.create_publisher(TYPE, TOPIC),
            "subscription": node.create_subscription(TYPE, TOPIC),
        }
        end = ends[kind.side]
        assert not end.supports_event(kind)
        with pytest.raises(UnsupportedError) as caught:
            REGISTER[kind](end)
        assert caught.value.code is ReturnCode.UNSUPPORTED
        assert str(caught.value) == f"UNSUPPORTED (-5): {kind.label} of {end}"


@pytest.mark.parametrize("kind", list(EventKind))
def test_what_supports_event_promises_can_be_registered(pair: Pair, kind: EventKind) -> None:
    ends: dict[str, Publisher | Subscription] = {"publisher": pair.publisher(), "subscription": pair.subscription()}
    for side, end in ends.items():
        assert end.supports_event(kind) == (side == kind.side)
    REGISTER[kind](ends[kind.side])


def test_entities_say_who_they_are(pair: Pair) -> None:
    assert str(pair.publisher()) == "the publisher of /chatter"
    assert str(pair.subscription()) == "the subscription to /chatter"
    assert pair.publisher(MANUAL).qos == MANUAL
    assert pair.subscription().topic == "/chatter"


def test_a_refused_registration_leaves_the_former_one_in_force(pair: Pair) -> None:
    publisher, subscription, seen = pair.publisher(), pair.subscription(), list[object]()
    subscription.on_requested_deadline_missed(ms(10), seen.append)
    with pytest.raises(
        RmwError,
        match=r"^INVALID_ARGUMENT \(-4\): no callback for RequestedDeadlineMissed of the subscription to /chatter$",
    ):
        subscription.on_requested_deadline_missed(ms(10), None)  # type: ignore[arg-type]
    with pytest.raises(
        RmwError, match=r"^INCOMPATIBLE_QOS \(-6\): RequestedDeadlineMissed of the subscription to /chatter$"
    ):
        subscription.on_requested_deadline_missed(ms(0), seen.append)
    publisher.publish(b"x")
    pair.executor.spin(ms(15))
    assert seen == [(1, 1)]


def test_a_code_that_nobody_published_is_an_error_that_names_it() -> None:
    handle = PolledSubscription()
    handle.event_code = -77
    subscription = Node(FixedSession(handle), "node", VirtualClock()).create_subscription(TYPE, TOPIC)
    with pytest.raises(RmwError) as caught:
        subscription.on_message_lost(print)
    assert str(caught.value) == "ERROR (-1): MessageLost of the subscription to /polled: unpublished code -77"


def test_events_and_messages_share_one_cap() -> None:
    handle, seen = PolledSubscription(b"one"), list[object]()
    session = FixedSession(handle)
    node = Node(session, "node", VirtualClock())
    node.create_subscription(TYPE, TOPIC, seen.append).on_message_lost(seen.append)
    session.ready.append(lambda: handle.fire(1, 1))
    executor = Executor(node)
    for count in (1, 2):
        executor.spin_once(0, 1)
        assert (len(seen), executor.ran) == (count, 1)
    assert seen == [(1, 1), b"one"]


def test_what_an_event_callback_raises_does_not_reach_the_middleware() -> None:
    handle, seen = PolledSubscription(), list[object]()
    session = FixedSession(handle)
    node = Node(session, "node", VirtualClock())

    def callback(status: CountStatus) -> None:
        seen.append(status)
        raise LookupError(f"total {status.total_count}")

    node.create_subscription(TYPE, TOPIC).on_message_lost(callback)
    session.ready.extend([lambda: handle.fire(1, 1), lambda: handle.fire(3, 2)])
    for expected in ("total 1", "total 3"):
        with pytest.raises(LookupError, match=f"^{expected}$"):
            Executor(node).spin_once()
        assert seen == [(1, 1), (3, 2)]  # the drive went on after the first


# Deadlines.


@pytest.mark.parametrize(("deadline", "period"), [
    (timedelta(microseconds=1), 1), (timedelta(microseconds=999), 1), (timedelta(microseconds=1001), 2), (ms(15), 15),
])  # fmt: skip
def test_a_fraction_of_a_millisecond_rounds_up(pair: Pair, deadline: timedelta, period: int) -> None:
    subscription, publisher, seen = pair.subscription(), pair.publisher(), list[CountStatus]()
    subscription.on_requested_deadline_missed(deadline, seen.append)
    publisher.publish(b"x")
    pair.clock.wait(None, pair.clock.now_ns() + 30 * MS)
    pair.executor.spin_once()
    assert seen == [(30 // period, 30 // period)]


def test_a_deadline_of_the_qos_takes_precedence(pair: Pair) -> None:
    qos = dataclasses.replace(DEFAULT, deadline_ms=10)
    subscription, publisher, seen = pair.subscription(qos), pair.publisher(qos), list[CountStatus]()
    subscription.on_requested_deadline_missed(ms(1000), seen.append)
    publisher.publish(b"x")
    pair.executor.spin(ms(15))
    assert seen == [(1, 1)]


@pytest.mark.parametrize("deadline", [15, 0.015, None])
def test_a_deadline_without_a_unit_is_refused(pair: Pair, deadline: Any) -> None:
    with pytest.raises(TypeError) as caught:
        pair.subscription().on_requested_deadline_missed(deadline, print)
    assert str(caught.value) == f"a deadline is a timedelta, such as timedelta(milliseconds=15), not {deadline!r}"


@pytest.mark.parametrize(("deadline", "number"), [(ms(-1), "-1"), (ms(2**32), "4294967296")])
def test_a_deadline_that_the_abi_cannot_represent_is_refused(pair: Pair, deadline: timedelta, number: str) -> None:
    with pytest.raises(RmwError) as caught:
        pair.publisher().on_offered_deadline_missed(deadline, print)
    assert str(caught.value) == f"INVALID_ARGUMENT (-4): the deadline, {number} ms, does not fit u32"


# Samples.


def test_a_callback_gets_every_sample(pair: Pair) -> None:
    got: list[bytes] = []
    pair.listener.create_subscription(TYPE, TOPIC, got.append)
    publisher = pair.publisher()
    for data in (b"one", b"", b"three"):
        publisher.publish(data)
    pair.executor.spin_once()
    assert got == [b"one", b"", b"three"]


def test_without_a_callback_samples_are_taken(pair: Pair) -> None:
    subscription, publisher = pair.subscription(), pair.publisher()
    assert not subscription.has_data()
    assert subscription.try_recv() is None
    publisher.publish(b"")
    pair.executor.spin_once()
    assert subscription.has_data()
    assert subscription.try_recv() == b""


def test_a_sample_beyond_the_room_for_it_is_refused_and_the_next_one_comes(pair: Pair) -> None:
    subscription = pair.listener.create_subscription(TYPE, TOPIC, max_size=4)
    publisher = pair.publisher()
    for data in (b"12345", b"1234"):
        publisher.publish(data)
    with pytest.raises(
        RmwError, match=r"^BUFFER_TOO_SMALL \(-12\): receiving from the subscription to /chatter$"
    ):  # fmt: skip
        subscription.try_recv()
    assert subscription.try_recv() == b"1234"


def test_what_cannot_be_published_is_an_error() -> None:
    with Context("uorb") as context:
        publisher = context.create_node("node").create_publisher(TYPE, TOPIC)
        with pytest.raises(
            RmwError, match=r"^MESSAGE_TOO_LARGE \(-13\): publishing 65534 bytes on /chatter$"
        ):  # fmt: skip
            publisher.publish(bytes(65534))


# The end.


def test_after_destroy_nothing_runs_and_calls_say_so(pair: Pair) -> None:
    seen: list[object] = []
    publisher = pair.publisher(MANUAL)
    subscription = pair.listener.create_subscription(TYPE, TOPIC, seen.append)
    subscription.on_liveliness_changed(seen.append)
    publisher.on_liveliness_lost(seen.append)
    publisher.publish(b"x")
    for end in (subscription, publisher):
        end.destroy()
        end.destroy()
    pair.executor.spin(ms(300))
    assert seen == []
    calls: dict[str, Callable[[], object]] = {
        "MessageLost of the subscription to /chatter": lambda: subscription.on_message_lost(print),
        "receiving from the subscription to /chatter": subscription.try_recv,
        "looking for data of the subscription to /chatter": subscription.has_data,
        "publishing 1 bytes on /chatter": lambda: publisher.publish(b"x"),
        "asserting the liveliness of the publisher of /chatter": publisher.assert_liveliness,
    }
    for detail, call in calls.items():
        with pytest.raises(RmwError) as caught:
            call()
        assert str(caught.value) == f"INVALID_ARGUMENT (-4): {detail}"


def test_a_subscription_may_destroy_itself_in_its_callback(pair: Pair) -> None:
    seen: list[object] = []

    def last(data: bytes) -> None:
        seen.append(data)
        subscription.destroy()

    subscription = pair.listener.create_subscription(TYPE, TOPIC, last)
    publisher = pair.publisher()
    publisher.publish(b"one")
    publisher.publish(b"two")
    pair.executor.spin(ms(20))
    assert seen == [b"one"]


def test_a_polled_subscription_may_destroy_itself_in_its_callback() -> None:
    handle, seen = PolledSubscription(b"one", b"two"), list[bytes]()
    node = Node(FixedSession(handle), "node", VirtualClock())

    def last(data: bytes) -> None:
        seen.append(data)
        handle.samples.clear()
        subscription.destroy()

    subscription = node.create_subscription(TYPE, TOPIC, last)
    executor = Executor(node)
    executor.spin_once()
    handle.samples.append(b"three")
    executor.spin_once()
    assert (seen, handle.destroyed) == ([b"one"], 1)


def test_callbacks_are_released_with_their_entity_and_their_replacement(pair: Pair) -> None:
    class Listener:
        def on_event(self, status: object) -> None:
            raise AssertionError

    subscription = pair.subscription()
    first, second = Listener(), Listener()
    references = [weakref.ref(first), weakref.ref(second)]
    subscription.on_message_lost(first.on_event)
    subscription.on_message_lost(second.on_event)
    del first, second
    gc.collect()
    assert [reference() is None for reference in references] == [True, False]
    subscription.destroy()
    gc.collect()
    assert [reference() is None for reference in references] == [True, True]


def test_a_destroyed_entity_is_not_kept_by_its_node(pair: Pair) -> None:
    references = []
    for _ in range(3):
        subscription = pair.subscription()
        references.append(weakref.ref(subscription))
        subscription.destroy()
        del subscription
    gc.collect()
    assert [reference() for reference in references] == [None, None, None]


class FixedSession(QueueSession):
    """Its only subscription is the one that it was given."""

    def __init__(self, handle: PolledSubscription) -> None:
        super().__init__()
        self.handle = handle

    def create_subscription(self, topic: str, type_name: str, qos: QosProfile) -> PolledSubscription:
        return self.handle
