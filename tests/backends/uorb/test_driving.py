from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import pytest

from nros_backends.uorb import UorbBackend
from nros_conformance.rmw.backend import Host, Publisher, Session, SessionOptions, Subscription
from nros_conformance.rmw.clock import MS, MonotonicClock, VirtualClock
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import CountStatus
from nros_conformance.rmw.qos import DEFAULT, QosProfile

if TYPE_CHECKING:
    from tests.backends.uorb.conftest import Talk


def _pair(session: Session, depth: int = 10) -> tuple[Publisher, Subscription]:
    publisher = session.create_publisher("/t", "Sample", DEFAULT)
    return publisher, session.create_subscription("/t", "Sample", QosProfile(depth=depth))


def test_with_nothing_to_do_a_drive_waits_its_whole_timeout(clock: VirtualClock, session: Session) -> None:
    begin = clock.now_ns()
    assert session.drive_io(250) == ReturnCode.OK
    assert clock.now_ns() - begin == 250 * MS


@pytest.mark.parametrize("timeout_ms", [0, -1])
def test_a_drive_without_timeout_returns_at_once_and_still_dispatches(
    clock: VirtualClock, talk: Talk, timeout_ms: int
) -> None:
    talk.publish(11)
    begin = clock.now_ns()
    talk.drive(timeout_ms)
    assert clock.now_ns() == begin
    assert talk.lost == 1


def test_a_sample_ends_the_waiting_once(clock: VirtualClock, session: Session) -> None:
    publisher, subscription = _pair(session)
    returned: list[int] = []

    def script() -> None:
        begin = clock.now_ns()

        def talk() -> None:
            clock.wait(None, begin + 30 * MS)
            publisher.publish_raw(b"a")

        clock.spawn("talk", talk)
        for _ in range(3):
            session.drive_io(100)
            returned.append((clock.now_ns() - begin) // MS)

    clock.run(script)
    assert returned == [30, 130, 230]  # untaken data does not make the next drives spin
    assert subscription.has_data()


def test_an_event_is_delivered_inside_the_drive_that_waits(clock: VirtualClock, talk: Talk) -> None:
    def script() -> None:
        begin = clock.now_ns()

        def burst() -> None:
            clock.wait(None, begin + 30 * MS)
            talk.publish(15)

        clock.spawn("burst", burst)
        talk.drive(100)
        assert talk.losses == [CountStatus(5, 5)]
        assert clock.now_ns() == begin + 30 * MS

    clock.run(script)


def test_callbacks_run_only_inside_drive_io(talk: Talk) -> None:
    called: list[object] = []
    talk.subscription.set_message_callback(called.append, "m")
    talk.publish(15)
    talk.take()
    talk.subscription.has_data()
    talk.publisher.assert_liveliness()
    talk.session.ping(10)
    assert called == talk.losses == []


def test_a_drive_from_inside_a_callback_returns_would_block_and_runs_nothing(talk: Talk) -> None:
    inner: list[int] = []
    nested: list[object] = []

    def callback(context: object) -> None:
        nested.append(context)
        inner.append(talk.session.drive_io(1000))

    talk.subscription.set_message_callback(callback, None)
    talk.publish(3)
    talk.drive()
    assert inner == [ReturnCode.WOULD_BLOCK] * 3
    assert len(nested) == 3


def test_a_message_callback_runs_once_for_each_sample_that_can_be_taken(talk: Talk) -> None:
    taken: list[list[int]] = []
    talk.subscription.set_message_callback(lambda context: taken.append(talk.take(1)), None)
    talk.publish(14)
    talk.drive()
    assert taken == [[number] for number in range(4, 14)]
    talk.drive()
    assert len(taken) == 10
    talk.publish(1)
    talk.drive()
    assert taken[10:] == [[14]]


def test_a_message_callback_also_runs_for_samples_that_were_there_before_it(talk: Talk) -> None:
    calls: list[object] = []
    talk.publish(2)
    talk.drive()
    talk.subscription.set_message_callback(calls.append, "m")
    talk.drive(100)
    assert calls == ["m", "m"]
    talk.subscription.set_message_callback(None, None)
    talk.publish(1)
    talk.drive()
    assert calls == ["m", "m"]


def test_no_message_callback_runs_for_a_sample_that_is_gone(talk: Talk) -> None:
    calls: list[int] = []
    talk.subscription.set_message_callback(lambda context: calls.append(len(talk.take())), None)
    talk.publish(4)
    talk.drive()
    assert calls == [4]


def test_a_cap_bounds_the_callbacks_and_the_rest_comes_later_in_order(clock: VirtualClock, talk: Talk) -> None:
    order: list[object] = []
    talk.subscription.set_message_callback(lambda context: order.append(talk.take(1)[0]), None)
    talk.subscription.register_event(2, 0, lambda kind, status, context: order.append(status), None)
    for _ in range(12):
        talk.publish(1)
        clock.wait(None, clock.now_ns() + MS)
    # Overflow was ready when sample 10 came, so after samples 2 to 9 and before 11.
    spins = []
    for _ in range(12):
        before = len(order)
        assert talk.session.drive_io(0, 1) == ReturnCode.OK
        spins.append(len(order) - before)
    assert spins == [1] * 11 + [0]
    assert order[:8] == list(range(2, 10))
    assert {order.index(10), order.index(CountStatus(2, 2))} == {8, 9}
    assert order[10] == 11


def test_a_cap_of_nothing_runs_nothing(talk: Talk) -> None:
    talk.publish(15)
    assert talk.session.drive_io(0, 0) == ReturnCode.OK
    assert talk.losses == []
    talk.drive()
    assert talk.lost == 5


def test_a_callback_that_raises_leaves_the_session_working(talk: Talk) -> None:
    calls: list[int] = []

    def callback(context: object) -> None:
        calls.append(len(calls))
        if len(calls) == 1:
            raise ZeroDivisionError

    talk.subscription.set_message_callback(callback, None)
    talk.publish(3)
    with pytest.raises(ZeroDivisionError):
        talk.session.drive_io(0)
    talk.drive()
    assert calls == [0, 1, 2]


def test_a_callback_may_publish_take_register_and_destroy(session: Session, talk: Talk) -> None:
    done: list[object] = []

    def callback(kind: int, status: Any, context: object) -> None:
        talk.publish(1)
        done.extend(talk.take(1))
        done.append(talk.subscription.register_event(2, 0, callback, None))
        done.append(talk.subscription.destroy())

    talk.subscription.register_event(2, 0, callback, None)
    talk.publish(12)
    talk.drive()
    assert done == [3, ReturnCode.OK, ReturnCode.OK]
    talk.publish(20)
    talk.drive()
    assert len(done) == 3


def test_a_callback_may_destroy_its_session(talk: Talk) -> None:
    calls: list[object] = []

    def callback(context: object) -> None:
        calls.append(context)
        talk.session.destroy()

    talk.subscription.set_message_callback(callback, "m")
    talk.publish(3)
    talk.drive()
    assert calls == ["m"]


def test_destroying_a_session_ends_its_waiting_drive(clock: VirtualClock, session: Session) -> None:
    def script() -> int:
        begin = clock.now_ns()

        def destroy() -> None:
            clock.wait(None, begin + 40 * MS)
            session.destroy()

        clock.spawn("destroy", destroy)
        session.drive_io(60_000)
        return (clock.now_ns() - begin) // MS

    assert clock.run(script) == 40


def test_driving_one_session_runs_nothing_of_another(backend: UorbBackend, talk: Talk) -> None:
    other = backend.create_session(SessionOptions(node_name="other"))
    foreign: list[object] = []
    subscription = other.create_subscription("/sensor", "Sample", QosProfile(depth=2))
    subscription.register_event(2, 0, lambda kind, status, context: foreign.append(status), None)
    talk.publish(12)
    talk.drive(10)
    assert talk.lost == 2
    assert foreign == []
    other.drive_io(10)
    assert foreign == [CountStatus(10, 10)]


def test_on_the_real_clock_a_publisher_in_another_thread_wakes_the_driver() -> None:
    session = UorbBackend(Host(MonotonicClock())).create_session(SessionOptions())
    publisher, subscription = _pair(session, depth=3)
    threads: list[int] = []
    totals: list[Any] = []
    waiting = threading.Event()

    def note(kind: int, status: Any, context: object) -> None:
        threads.append(threading.get_ident())
        totals.append(status.total_count)

    subscription.register_event(2, 0, note, None)

    def publish() -> None:
        waiting.wait(10)
        for _ in range(100):
            publisher.publish_raw(b"x")

    thread = threading.Thread(target=publish)
    thread.start()
    waiting.set()
    while not totals or totals[-1] < 97:
        assert session.drive_io(10_000) == ReturnCode.OK
    thread.join()
    assert set(threads) == {threading.get_ident()}
    assert totals[-1] == 97
