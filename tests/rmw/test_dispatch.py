from __future__ import annotations

import gc
import weakref

import pytest

from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import CountTracker, LivelinessTally, Source
from nros_conformance.rmw.dispatch import EventRegistry, ReadyQueue
from nros_conformance.rmw.events import EventKind

LOST, MISSED, ALIVE = EventKind.MESSAGE_LOST, EventKind.REQUESTED_DEADLINE_MISSED, EventKind.LIVELINESS_CHANGED


def registry(queue: ReadyQueue, deadline_ms: int = 0) -> tuple[EventRegistry, CountTracker, LivelinessTally]:
    lost, alive = CountTracker(), LivelinessTally()
    sources: dict[EventKind, Source] = {LOST: lost, ALIVE: alive, MISSED: CountTracker()}
    return EventRegistry(queue, sources, qos_deadline_ms=deadline_ms), lost, alive


@pytest.mark.parametrize("kind", [3, 4, -1, 5, 255, 256, 257, 65536, 2**31 - 1])
def test_kinds_that_are_not_supported_are_refused_and_alias_nothing(kind: int) -> None:
    one, *_ = registry(ReadyQueue())
    assert not one.supports(kind)
    assert one.register(kind, 10, lambda *_: None, None) == ReturnCode.UNSUPPORTED


def test_a_missing_callback_is_refused_and_the_earlier_registration_survives() -> None:
    queue, seen = ReadyQueue(), list[object]()
    one, lost, _ = registry(queue)
    assert one.register(LOST, 0, lambda *args: seen.append(args), "ctx") == ReturnCode.OK
    assert one.register(LOST, 0, None, None) == ReturnCode.INVALID_ARGUMENT
    lost.add(2, 5)
    one.poll()
    queue.drain()
    assert seen == [(2, (2, 2), "ctx")]


@pytest.mark.parametrize(("qos", "argument", "code"), [
    (0, 0, ReturnCode.INCOMPATIBLE_QOS), (2**32 - 1, 2**32 - 1, ReturnCode.INCOMPATIBLE_QOS),
    (0, 15, ReturnCode.OK), (15, 0, ReturnCode.OK),
])  # fmt: skip
def test_a_deadline_kind_needs_a_finite_period_from_qos_or_registration(qos: int, argument: int, code: int) -> None:
    one, *_ = registry(ReadyQueue(), qos)
    assert one.register(MISSED, argument, lambda *_: None, None) == code


def test_nothing_is_called_outside_of_drain_and_occurrences_coalesce() -> None:
    queue, seen = ReadyQueue(), list[object]()
    one, lost, _ = registry(queue)
    lost.add(1, 1)  # before the registration: it is not lost
    one.register(LOST, 0, lambda *args: seen.append(args[1]), None)
    one.poll()
    lost.add(4, 2)
    one.poll()
    assert seen == []
    assert queue.drain() == 1
    assert seen == [(5, 5)]
    one.poll()
    assert (queue.drain(), len(seen)) == (0, 1)


def test_messages_and_events_run_in_the_order_in_which_they_became_ready_under_a_cap() -> None:
    queue, seen = ReadyQueue(), list[object]()
    one, lost, alive = registry(queue)
    one.register(LOST, 0, lambda *_: seen.append("lost"), None)
    one.register(ALIVE, 0, lambda *_: seen.append("alive"), None)
    one.set_message_callback(lambda _: seen.append("message"), None)
    alive.add(1, 0, 30)
    one.message(20)
    lost.add(1, 10)
    one.poll()
    for expected in ("lost", "message", "alive"):
        assert queue.drain(1) == 1
        assert seen[-1] == expected
    assert queue.drain(1) == 0


def test_a_drain_inside_a_callback_runs_nothing_and_what_it_queues_waits_for_the_next() -> None:
    queue, seen = ReadyQueue(), list[object]()
    one, lost, _ = registry(queue)

    def callback(*_: object) -> None:
        lost.add(1, 9)
        one.poll()
        seen.append(queue.drain())

    one.register(LOST, 0, callback, None)
    lost.add(1, 1)
    one.poll()
    assert (queue.drain(), seen) == (1, [0])
    assert (queue.drain(), seen) == (1, [0, 0])


def test_an_exception_of_a_callback_reaches_the_driver_and_leaves_the_rest_queued() -> None:
    queue, seen = ReadyQueue(), list[object]()
    one, lost, alive = registry(queue)

    def failing(*_: object) -> None:
        raise ZeroDivisionError

    one.register(LOST, 0, failing, None)
    one.register(ALIVE, 0, lambda *_: seen.append("alive"), None)
    lost.add(1, 1)
    alive.add(1, 0, 2)
    one.poll()
    with pytest.raises(ZeroDivisionError):
        queue.drain()
    assert (queue.drain(), seen) == (1, ["alive"])


def test_closing_releases_callbacks_and_contexts_and_nothing_queued_runs() -> None:
    class Context:
        pass

    queue, seen, context = ReadyQueue(), list[object](), Context()
    one, lost, _ = registry(queue)
    one.register(LOST, 0, lambda *_: seen.append(1), context)
    lost.add(1, 1)
    one.poll()
    one.close()
    gone = weakref.ref(context)
    del context
    gc.collect()
    assert gone() is None
    assert (queue.drain(), seen) == (0, [])
    assert one.register(LOST, 0, lambda *_: None, None) == ReturnCode.INVALID_ARGUMENT


def test_replacing_a_registration_a_hundred_times_keeps_one() -> None:
    queue, seen = ReadyQueue(), list[object]()
    one, lost, _ = registry(queue)
    for number in range(100):
        assert one.register(LOST, 0, lambda *_, number=number: seen.append(number), None) == ReturnCode.OK
    lost.add(1, 1)
    one.poll()
    queue.drain()
    assert seen == [99]
