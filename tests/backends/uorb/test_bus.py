from __future__ import annotations

import pytest

from nros_backends.uorb.bus import Bus, Metadata, Rules, Subscription
from nros_backends.uorb.interval import SubscriptionInterval


def _bus(queue: int = 4, rules: Rules | None = None) -> Bus:
    bus = Bus(rules or Rules())
    bus.define(Metadata("t", 1, queue))
    return bus


def _subscribe(bus: Bus) -> Subscription:
    subscription = bus.subscribe("t")
    assert subscription is not None
    return subscription


def _drain(subscription: Subscription) -> bytes:
    samples = []
    while (sample := subscription.update()) is not None:
        samples.append(sample)
    return b"".join(samples)


def test_any_one_unadvertise_hides_what_is_unread_until_somebody_advertises_again() -> None:
    bus = _bus()
    first, second = bus.advertise("t"), bus.advertise("t")
    assert first is second
    subscription = _subscribe(bus)
    first.publish(b"a")
    second.publish(b"b")
    second.unadvertise()
    assert (subscription.unread, subscription.updated(), subscription.copy()) == (0, False, None)
    assert not bus.exists("t", 0)
    bus.advertise("t")
    assert _drain(subscription) == b"ab"


def test_publishers_are_counted_where_unadvertising_hides_nothing() -> None:
    bus = _bus(rules=Rules(unadvertise_hides=False))
    node = bus.advertise("t")
    bus.advertise("t")
    node.publish(b"a")
    node.unadvertise()
    assert bus.exists("t", 0)
    node.unadvertise()
    assert not bus.exists("t", 0)
    assert _subscribe(bus).copy() == b"a"


def test_ten_instances_and_no_more() -> None:
    bus = _bus()
    nodes = [bus.advertise_multi("t") for _ in range(11)]
    assert [node and node.instance for node in nodes] == [*range(10), None]
    assert bus.group_count("t") == 10
    assert bus.subscribe("t", 9) is not None
    assert bus.subscribe("t", 10) is None
    nodes[3].unadvertise()  # type: ignore[union-attr]
    again = bus.advertise_multi("t")
    assert again is nodes[3]


def test_the_generation_outlives_unadvertise() -> None:
    bus = _bus()
    node = bus.advertise("t", b"a")
    node.unadvertise()
    assert bus.advertise("t", b"b").generation == 2


def test_advertising_with_data_publishes_it() -> None:
    bus = _bus()
    bus.advertise("t", b"a")
    assert _drain(_subscribe(bus)) == b"a"
    multi = bus.advertise_multi("t", b"b")
    assert multi is not None
    assert (multi.instance, multi.generation) == (1, 1)


@pytest.mark.parametrize("queue", [1, 4, 16])
def test_a_late_subscriber_sees_exactly_one_sample_whatever_the_queue(queue: int) -> None:
    bus = _bus(queue)
    node = bus.advertise("t")
    for sample in b"abc":
        node.publish(bytes([sample]))
    assert _drain(_subscribe(bus)) == b"c"


def test_a_subscription_without_node_attaches_at_its_first_use_after_the_node_exists() -> None:
    bus = _bus()
    lazy, idle = Subscription(bus, "t"), Subscription(bus, "t")
    assert (lazy.unread, lazy.copy(), bus.find("t")) == (0, None, None)
    node = bus.advertise("t")
    assert lazy.updated() is False  # attached now
    for sample in b"abc":
        node.publish(bytes([sample]))
    assert _drain(lazy) == b"abc"
    assert _drain(idle) == b"c"  # what was published before its first use is neither seen nor lost


def test_lost_on_a_take_is_what_the_generation_jumps_over() -> None:
    bus = _bus(4)
    node, subscription = bus.advertise("t"), _subscribe(bus)
    for sample in range(11):
        node.publish(bytes([sample]))
    unread, before = subscription.unread, subscription.last
    assert subscription.copy() == bytes([7])
    assert subscription.last - before - 1 == max(0, unread - 4) == 7


@pytest.mark.parametrize(("queue", "order"), [(8, b"abcdefgh"), (5, None)])
def test_only_a_power_of_two_keeps_the_order_across_the_wrap(queue: int, order: bytes | None) -> None:
    bus = _bus(queue)
    node, subscription = bus.advertise("t"), _subscribe(bus)
    node.preset(2**32 - 3)
    for sample in b"abcdefgh"[:queue]:
        node.publish(bytes([sample]))
    read = _drain(subscription)
    assert (read == b"abcdefgh"[:queue]) is (order is not None)
    assert len(read) == queue


@pytest.mark.parametrize("generation", [0, 3, 2**32 - 2, 2**31])
def test_a_preset_loses_nothing_and_repeats_nothing(generation: int) -> None:
    bus = _bus(4)
    node, subscription = bus.advertise("t"), _subscribe(bus)
    for sample in b"abcdef":
        node.publish(bytes([sample]))
    assert subscription.copy() == b"c"
    node.preset(generation)
    assert node.generation == generation
    assert subscription.last == (generation - 3) % 2**32
    assert subscription.unread == 3
    node.publish(b"g")
    assert _drain(subscription) == b"defg"


def test_a_sample_of_the_wrong_size_is_not_published() -> None:
    bus = _bus()
    node = bus.advertise("t")
    assert node.publish(b"ab") is False
    assert node.generation == 0


def test_a_framed_slot_holds_its_length_too() -> None:
    meta = Metadata("t", 10, framed=True)
    assert [meta.fits(length) for length in (0, 8, 9)] == [True, True, False]


def test_a_topic_has_one_definition() -> None:
    bus = _bus(4)
    bus.define(Metadata("t", 1, 4))
    with pytest.raises(
        ValueError, match=r"^topic 't' is defined as Metadata\(name='t', size=1, queue=4, framed=False\)"
    ):
        bus.define(Metadata("t", 1, 8))


def test_callbacks_run_in_publish_before_the_first_sample_counts_as_valid() -> None:
    bus = _bus()
    node = bus.advertise("t")
    seen: list[tuple[int, int]] = []
    node.callbacks.append(lambda: seen.append((node.generation, node.initial_generation)))
    node.publish(b"a")
    node.publish(b"b")
    assert seen == [(1, 1), (2, 1)]


def test_detaching_forgets_the_subscription_and_using_it_attaches_it_anew() -> None:
    bus = _bus()
    node = bus.advertise("t", b"a")
    subscription = _subscribe(bus)
    subscription.detach()
    subscription.detach()
    assert node.subscriptions == []
    assert subscription.copy() == b"a"


def test_trimming_skips_what_lies_further_back() -> None:
    bus = _bus(8)
    node, subscription = bus.advertise("t"), _subscribe(bus)
    for sample in b"abcdef":
        node.publish(bytes([sample]))
    assert subscription.trim(2) == 4
    assert subscription.trim(2) == 0
    assert _drain(subscription) == b"ef"


def test_a_rate_limited_subscription_is_set_to_now_while_the_clock_is_below_the_interval() -> None:
    bus = _bus(1)
    node = bus.advertise("t", b"a")
    limited = SubscriptionInterval(_subscribe(bus), interval_us=1000)
    assert limited.copy(500) == b"a"
    assert limited.last_update_us == 500
    node.publish(b"b")
    assert [limited.update(now) for now in (1499, 1500)] == [None, b"b"]


def test_a_rate_limited_subscription_is_not_updated_when_nobody_advertises() -> None:
    bus = _bus(1)
    node = bus.advertise("t", b"a")
    limited = SubscriptionInterval(_subscribe(bus))
    node.unadvertise()
    assert not limited.updated(10_000)
