from __future__ import annotations

import threading

import pytest

from nros_conformance.rmw.clock import MS, MonotonicClock, VirtualClock
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.dispatch import EventRegistry, ReadyQueue
from nros_conformance.rmw.qos import History, QosProfile
from nros_conformance.rmw.receive_queue import ReceiveQueue


class Desk:
    """A receive queue, and what stands around it in an adapter."""

    def __init__(self, **qos: int) -> None:
        self.clock = VirtualClock(0)
        self.ready = ReadyQueue()
        self.registry = EventRegistry(self.ready, {})
        self.queue = ReceiveQueue(QosProfile(**qos), self.registry, self.clock)  # type: ignore[arg-type]

    def wait(self, until_ms: int) -> None:
        self.clock.wait(None, until_ms * MS)

    def take_all(self) -> list[bytes]:
        taken = []
        while isinstance(payload := self.queue.try_recv_raw(99), bytes):
            taken.append(payload)
        return taken

    def drain(self) -> int:
        return self.ready.drain()


def test_samples_come_out_in_order_and_an_empty_one_is_a_sample() -> None:
    desk = Desk()
    assert [desk.queue.put(payload, 0) for payload in (b"1", b"", b"3")] == [0, 0, 0]
    assert (desk.queue.has_data(), len(desk.queue)) == (True, 3)
    assert desk.take_all() == [b"1", b"", b"3"]
    assert (desk.queue.has_data(), desk.queue.try_recv_raw(99)) == (False, ReturnCode.NO_DATA)


def test_a_full_queue_loses_the_oldest_and_says_so() -> None:
    desk = Desk(depth=2)
    assert [desk.queue.put(bytes([number]), 0) for number in range(4)] == [0, 0, 1, 1]
    assert desk.take_all() == [b"\2", b"\3"]


def test_history_that_is_pushed_out_is_not_lost() -> None:
    desk = Desk(depth=1)
    assert [desk.queue.put(b"", 0, history=history) for history in (True, True, False, False)] == [0, 0, 0, 1]


def test_keep_all_pushes_nothing_out() -> None:
    desk = Desk(depth=1, history=History.KEEP_ALL)
    assert sum(desk.queue.put(b"", 0) for _ in range(500)) == 0
    assert len(desk.queue) == 500


def test_a_sample_waits_until_its_lifespan_is_over_and_not_longer() -> None:
    desk = Desk()
    desk.queue.put(b"short", 0, expires_ns=20 * MS)
    desk.queue.put(b"long", 0, expires_ns=30 * MS)
    desk.queue.put(b"for ever", 0)
    desk.wait(20)
    assert desk.take_all() == [b"long", b"for ever"]
    assert desk.queue.has_data() is False


def test_has_data_does_not_see_what_has_expired() -> None:
    desk = Desk()
    desk.queue.put(b"", 0, expires_ns=20 * MS)
    assert desk.queue.has_data() is True
    desk.wait(20)
    assert desk.queue.has_data() is False


def test_what_has_expired_makes_room_before_anything_is_pushed_out() -> None:
    desk = Desk(depth=1)
    desk.queue.put(b"1", 0, expires_ns=20 * MS)
    assert desk.queue.put(b"2", 19 * MS, expires_ns=39 * MS) == 1
    assert desk.queue.put(b"3", 39 * MS) == 0


def test_an_adapter_that_looks_late_may_let_lifespans_end_when_it_looks() -> None:
    desk = Desk(depth=1)
    desk.queue.put(b"1", 0, expires_ns=20 * MS)
    assert desk.queue.put(b"2", 19 * MS, now_ns=20 * MS) == 0
    assert desk.take_all() == [b"2"]


def test_a_sample_too_large_for_the_buffer_is_gone_and_told_once() -> None:
    desk = Desk()
    desk.queue.put(b"large", 0)
    desk.queue.put(b"1", 0)
    assert [desk.queue.try_recv_raw(4), desk.queue.try_recv_raw(1)] == [ReturnCode.BUFFER_TOO_SMALL, b"1"]
    assert [desk.queue.dropped(), desk.queue.dropped()] == [1, 0]


@pytest.mark.parametrize("max_size", [-1, None, "4"])
def test_a_size_that_makes_no_sense_is_refused_and_takes_nothing(max_size: object) -> None:
    desk = Desk()
    desk.queue.put(b"1", 0)
    assert desk.queue.try_recv_raw(max_size) == ReturnCode.INVALID_ARGUMENT  # type: ignore[arg-type]
    assert desk.take_all() == [b"1"]


def test_a_destroyed_subscription_refuses_everything() -> None:
    desk = Desk()
    desk.queue.put(b"1", 0)
    desk.registry.close()
    answers = {desk.queue.has_data(), desk.queue.try_recv_raw(1), desk.queue.set_message_callback(print, None)}
    assert answers == {ReturnCode.INVALID_ARGUMENT}
    desk.queue.clear()
    assert len(desk.queue) == 0


def test_each_sample_calls_once_and_those_that_wait_by_then_call_too() -> None:
    desk, heard = Desk(), list[object]()
    desk.queue.put(b"1", 0)
    assert desk.queue.set_message_callback(heard.append, "context") == ReturnCode.OK
    desk.queue.put(b"2", 0)
    assert (desk.drain(), heard) == (2, ["context", "context"])
    desk.queue.set_message_callback(heard.append, "another")
    assert desk.drain() == 0


def test_a_callback_that_was_withdrawn_before_it_ran_leaves_its_sample_to_the_next() -> None:
    desk, heard = Desk(), list[object]()
    desk.queue.set_message_callback(heard.append, "first")
    desk.queue.put(b"1", 0)
    desk.queue.set_message_callback(None, None)
    desk.queue.set_message_callback(heard.append, "second")
    assert (desk.drain(), heard) == (1, ["second"])


def test_no_callback_runs_for_what_was_taken_pushed_out_or_has_expired() -> None:
    desk, heard = Desk(depth=3), list[object]()
    desk.queue.set_message_callback(heard.append, None)
    for payload, expires_ns in ((b"pushed out", 50 * MS), (b"taken", 50 * MS), (b"expired", 20 * MS), (b"4", 50 * MS)):
        desk.queue.put(payload, 0, expires_ns=expires_ns)
    assert desk.queue.try_recv_raw(99) == b"taken"
    desk.wait(20)
    assert (desk.drain(), len(heard)) == (1, 1)


def test_callbacks_run_in_the_order_in_which_samples_came() -> None:
    desk, order = Desk(), list[object]()

    def event() -> bool:
        order.append("event")
        return True

    desk.ready.push(15, event)
    desk.queue.put(b"", 10)
    desk.queue.set_message_callback(lambda _: order.append("message"), None)
    desk.queue.put(b"", 20)
    desk.drain()
    assert order == ["message", "event", "message"]


def test_samples_are_taken_on_another_thread_while_more_come() -> None:
    registry = EventRegistry(ReadyQueue(), {})
    queue = ReceiveQueue(QosProfile(depth=5), registry, MonotonicClock())
    taken, filled = list[bytes](), threading.Event()

    def take() -> None:
        while not filled.is_set() or queue.has_data():
            if isinstance(payload := queue.try_recv_raw(9), bytes):
                taken.append(payload)

    taker = threading.Thread(target=take)
    taker.start()
    lost = sum(queue.put(number.to_bytes(2, "big"), 0) for number in range(3000))
    filled.set()
    taker.join()
    assert len(taken) + lost == 3000
    assert taken == sorted(taken)
