from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import Durability, History, Reliability

if TYPE_CHECKING:
    from tests.backends.cyclone.conftest import Stage

LOST = EventKind.MESSAGE_LOST


def numbered(first: int, count: int) -> list[bytes]:
    return [number.to_bytes(4, "big") for number in range(first, first + count)]


@pytest.mark.parametrize("reliability", list(Reliability))
def test_samples_arrive_in_order_and_as_they_were(stage: Stage, reliability: Reliability) -> None:
    publisher, subscription = stage.pair(reliability=reliability, depth=20)
    lost = stage.log(subscription, LOST)
    sent = [b"", b"x", bytes(range(256)) * 300, *numbered(0, 10)]
    for data in sent:
        assert publisher.publish_raw(data) == ReturnCode.OK
    assert stage.receive(subscription, len(sent)) == sent
    assert not lost.events


def test_a_session_hears_itself(stage: Stage) -> None:
    publisher = stage.publisher(stage.near)
    subscription = stage.subscription(stage.near)
    stage.match(publisher, subscription)
    publisher.publish_raw(b"x")
    assert stage.receive(subscription, 1) == [b"x"]


@pytest.mark.parametrize("k", [1, 7])
def test_exactly_what_the_network_lost_is_reported(stage: Stage, k: int) -> None:
    publisher, subscription = stage.pair(reliability=Reliability.BEST_EFFORT, depth=100)
    lost = stage.log(subscription, LOST)
    head, hole, tail = numbered(0, 5), numbered(5, k), numbered(5 + k, 5)
    for data in head:
        publisher.publish_raw(data)
    assert stage.receive(subscription, 5) == head
    stage.far.deafmute(deaf=False, mute=True)
    for data in hole:
        assert publisher.publish_raw(data) == ReturnCode.OK
    stage.far.deafmute(deaf=False, mute=False)
    stage.near.drive_io(20)
    assert not lost.events  # nothing can be known of a loss at the end
    for data in tail:
        publisher.publish_raw(data)
    assert stage.receive(subscription, 5) == tail
    stage.near.drive_io(0)
    assert lost.total == k


def test_what_is_sent_again_is_not_lost(stage: Stage) -> None:
    publisher, subscription = stage.pair(depth=100)
    lost = stage.log(subscription, LOST)
    sent = numbered(0, 9)
    for index, data in enumerate(sent):
        stage.far.deafmute(deaf=False, mute=3 <= index < 6)
        publisher.publish_raw(data)
    assert stage.receive(subscription, 9) == sent
    assert not lost.events


def test_losses_of_one_publisher_do_not_hide_in_the_numbers_of_another(stage: Stage) -> None:
    third = stage.open_session(node_name="third")
    options: dict[str, Any] = {"reliability": Reliability.BEST_EFFORT, "depth": 100}
    one, other = stage.publisher(**options), stage.publisher(third, **options)
    subscription = stage.subscription(**options)
    stage.match(one, subscription)
    stage.match(other, subscription)
    lost = stage.log(subscription, LOST)
    for index, data in enumerate(numbered(0, 30)):
        stage.far.deafmute(deaf=False, mute=10 <= index < 14)
        one.publish_raw(b"1" + data)
        other.publish_raw(b"2" + data)
    assert len(stage.receive(subscription, 56)) == 56
    stage.near.drive_io(0)
    assert lost.total == 4


@pytest.mark.parametrize(("depth", "excess"), [(1, 4), (5, 45)])
def test_overflow_of_the_receive_queue_is_lost_and_reported_by_the_next_drive(
    stage: Stage, depth: int, excess: int
) -> None:
    publisher, subscription = stage.publisher(depth=100), stage.subscription(depth=depth)
    stage.match(publisher, subscription)
    lost = stage.log(subscription, LOST)
    sent = numbered(0, depth + excess)
    for data in sent:
        publisher.publish_raw(data)
    stage.until(lambda: stage.near.drive_io(0) == ReturnCode.OK and lost.total == excess)
    assert stage.take_all(subscription) == sent[excess:]


def test_keep_all_keeps_all(stage: Stage) -> None:
    publisher, subscription = stage.pair(history=History.KEEP_ALL, depth=1)
    lost = stage.log(subscription, LOST)
    sent = numbered(0, 700)
    for data in sent:
        assert publisher.publish_raw(data) == ReturnCode.OK
    stage.until(lambda: stage.near.drive_io(5) == ReturnCode.OK and len(subscription._waiting) == 700)
    assert stage.take_all(subscription) == sent
    assert not lost.events


def test_history_comes_to_a_late_subscription_and_is_no_loss(stage: Stage) -> None:
    lasting: dict[str, Any] = {"durability": Durability.TRANSIENT_LOCAL}
    publisher = stage.publisher(depth=8, **lasting)
    sent = numbered(0, 20)
    for data in sent:
        publisher.publish_raw(data)
    whole, part = stage.subscription(depth=8, **lasting), stage.subscription(depth=3, **lasting)
    # In a session of its own: one that shares the catching up of others gets their history, too.
    volatile = stage.subscription(stage.open_session(node_name="third"), depth=8)
    logs = [stage.log(subscription, LOST) for subscription in (whole, part, volatile)]
    stage.until(
        lambda: stage.near.drive_io(5) == ReturnCode.OK and len(whole._waiting) == 8 and len(part._waiting) == 3
    )
    assert stage.take_all(whole) == sent[12:]
    assert stage.take_all(part) == sent[17:]
    assert stage.take_all(volatile) == []
    stage.match(publisher, volatile)
    publisher.publish_raw(b"now")
    assert [stage.receive(one, 1) for one in (whole, part, volatile)] == [[b"now"]] * 3
    assert [log.events for log in logs] == [[], [], []]


def test_a_publisher_that_restarts_begins_its_numbers_again(stage: Stage) -> None:
    publisher, subscription = stage.pair()
    lost = stage.log(subscription, LOST)
    for data in numbered(0, 3):
        publisher.publish_raw(data)
    stage.receive(subscription, 3)
    publisher.destroy()
    again = stage.publisher()
    stage.match(again, subscription)
    again.publish_raw(b"x")
    assert stage.receive(subscription, 1) == [b"x"]
    assert not lost.events


def test_a_sample_expires_in_the_receive_queue_and_that_is_no_loss(stage: Stage) -> None:
    mortal, subscription = stage.publisher(lifespan_ms=30), stage.subscription()
    stage.match(mortal, subscription)
    immortal = stage.publisher()
    stage.match(immortal, subscription)
    lost = stage.log(subscription, LOST)
    called: list[int] = []
    subscription.set_message_callback(lambda _: called.append(1), None)
    begin = stage.clock.now_ns()
    mortal.publish_raw(b"short")
    immortal.publish_raw(b"long")
    stage.until(lambda: stage.near.drive_io(0) == ReturnCode.OK and len(called) >= 1 + (stage.clock.now_ns() < begin))
    stage.until(lambda: stage.clock.now_ns() > begin + 35 * MS)
    stage.near.drive_io(0)
    assert stage.take_all(subscription) == [b"long"]
    mortal.publish_raw(b"shorter")
    stage.pause(35)  # nobody drives: it expires before it is looked at
    stage.near.drive_io(0)
    assert subscription.has_data() is False
    mortal.publish_raw(b"quick")
    stage.near.drive_io(0)
    assert not lost.events


def test_too_small_a_buffer_loses_the_sample_and_says_so(stage: Stage) -> None:
    publisher, subscription = stage.pair()
    lost = stage.log(subscription, LOST)
    publisher.publish_raw(b"much too long")
    publisher.publish_raw(b"fits")
    stage.until(lambda: stage.near.drive_io(5) == ReturnCode.OK and len(subscription._waiting) == 2)
    assert subscription.try_recv_raw(4) == ReturnCode.BUFFER_TOO_SMALL
    assert subscription.try_recv_raw(4) == b"fits"
    assert subscription.try_recv_raw(4) == ReturnCode.NO_DATA
    assert subscription.try_recv_raw(-1) == ReturnCode.INVALID_ARGUMENT
    stage.near.drive_io(0)
    assert lost.total == 1


def test_a_sample_above_the_capacity_is_refused_and_uses_up_no_number(stage: Stage) -> None:
    publisher, subscription = stage.pair()
    lost = stage.log(subscription, LOST)
    publisher.publish_raw(b"a")
    assert publisher.publish_raw(bytes(2**20 + 1)) == ReturnCode.MESSAGE_TOO_LARGE
    assert publisher.publish_raw("text") == ReturnCode.INVALID_ARGUMENT
    assert publisher.publish_raw(bytes(2**20)) == ReturnCode.OK
    assert [len(data) for data in stage.receive(subscription, 2)] == [1, 2**20]
    assert not lost.events


def test_message_callbacks_come_once_per_sample_and_leave_it_there(stage: Stage) -> None:
    publisher, subscription = stage.pair(depth=2)
    contexts: list[object] = []
    assert subscription.set_message_callback(contexts.append, "mine") == ReturnCode.OK
    for data in numbered(0, 2):
        publisher.publish_raw(data)
    stage.until(lambda: stage.near.drive_io(5) == ReturnCode.OK and len(contexts) == 2)
    assert contexts == ["mine", "mine"]
    assert stage.take_all(subscription) == numbered(0, 2)
    publisher.publish_raw(b"x")
    assert subscription.set_message_callback(None, None) == ReturnCode.OK
    assert stage.receive(subscription, 1) == [b"x"]
    assert len(contexts) == 2


def test_messages_and_events_run_in_the_order_in_which_they_became_ready(stage: Stage) -> None:
    publisher, subscription = stage.pair(deadline_ms=60)
    order: list[str] = []
    subscription.set_message_callback(lambda _: order.append("message"), None)
    kind = EventKind.REQUESTED_DEADLINE_MISSED
    assert subscription.register_event(kind, 0, lambda *_: order.append("event"), None) == ReturnCode.OK
    publisher.publish_raw(b"1")
    stage.pause(90)  # a miss after 60 ms
    publisher.publish_raw(b"2")
    stage.pause(10)
    for expected in (["message"], ["message", "event"], ["message", "event", "message"]):
        assert stage.near.drive_io(0, 1) == ReturnCode.OK
        assert order == expected
