from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from nros_conformance.node import Context, Executor, Publisher, Subscription, UnsupportedError
from nros_conformance.rmw.backend import Host
from nros_conformance.rmw.clock import MS, MonotonicClock, VirtualClock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import QosProfile
from tests.node.fakes import PolledSubscription, QueueSession
from tests.node.pair import MANUAL, TOPIC, TYPE, Pair, ms

# The five awaitable twins.


def test_each_event_can_be_awaited(pair: Pair) -> None:
    async def scene() -> list[tuple[int, ...]]:
        publisher, subscription = pair.publisher(MANUAL), pair.subscription(QosProfile(depth=1))
        async with pair.executor.spinning():
            seen: list[tuple[int, ...]] = [await subscription.next_liveliness_change()]
            waiting = publisher.next_offered_deadline_miss(ms(20)), subscription.next_deadline_miss(ms(30))
            publisher.publish(b"x")
            publisher.publish(b"y")
            seen.append(await subscription.next_message_lost())
            seen += [await one for one in waiting]
            seen.append(await publisher.next_liveliness_loss())
            seen.append(await subscription.next_liveliness_change())
        return seen

    assert asyncio.run(scene()) == [(1, 0, 1, 0), (1, 1), (1, 1), (1, 1), (1, 1), (0, 1, -1, 1)]


def test_two_events_between_two_awaits_are_both_delivered_in_order(pair: Pair) -> None:
    async def scene() -> list[tuple[int, ...]]:
        subscription = pair.subscription()
        first = subscription.next_liveliness_change()
        publisher = pair.publisher(MANUAL)
        async with pair.executor.spinning():
            seen: list[tuple[int, ...]] = [await first]
            until = pair.clock.now_ns() + 150 * MS
            while pair.clock.now_ns() < until:
                await asyncio.sleep(0)
            publisher.publish(b"x")
            await asyncio.sleep(0)
        return [*seen, await subscription.next_liveliness_change(), await subscription.next_liveliness_change()]

    assert asyncio.run(scene()) == [(1, 0, 1, 0), (0, 1, -1, 1), (1, 0, 1, -1)]


def test_a_cancelled_await_loses_nothing(pair: Pair) -> None:
    async def scene() -> object:
        subscription = pair.subscription()
        waiting = asyncio.create_task(subscription.next_liveliness_change())
        await asyncio.sleep(0)
        pair.publisher()
        pair.executor.spin_once()
        waiting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waiting
        return await subscription.next_liveliness_change()

    assert asyncio.run(scene()) == (1, 0, 1, 0)


AWAIT: dict[EventKind, Callable[[Any], Coroutine[Any, Any, object]]] = {
    EventKind.LIVELINESS_CHANGED: lambda end: end.next_liveliness_change(),
    EventKind.REQUESTED_DEADLINE_MISSED: lambda end: end.next_deadline_miss(ms(15)),
    EventKind.LIVELINESS_LOST: lambda end: end.next_liveliness_loss(),
    EventKind.OFFERED_DEADLINE_MISSED: lambda end: end.next_offered_deadline_miss(ms(15)),
}


@pytest.mark.parametrize("kind", AWAIT)
def test_awaiting_an_unsupported_event_raises_in_the_call(kind: EventKind) -> None:
    with Context("uorb") as context:
        node = context.create_node("node")
        ends: dict[str, Publisher | Subscription] = {
            "publisher": node.create_publisher(TYPE, TOPIC),
            "subscription": node.create_subscription(TYPE, TOPIC),
        }
        end = ends[kind.side]
        with pytest.raises(UnsupportedError) as caught:
            _ = AWAIT[kind](end)
        assert str(caught.value) == f"UNSUPPORTED (-5): {kind.label} of {end}"


def test_a_deadline_is_stated_once_by_await_callback_or_qos(pair: Pair) -> None:
    async def scene() -> None:
        subscription, publisher, seen = pair.subscription(), pair.publisher(), list[object]()
        with pytest.raises(
            RmwError, match=r"^INCOMPATIBLE_QOS \(-6\): RequestedDeadlineMissed of the subscription to /chatter$"
        ):
            _ = subscription.next_deadline_miss()
        subscription.on_requested_deadline_missed(ms(10), seen.append)
        waiting = subscription.next_deadline_miss()
        publisher.publish(b"x")
        async with pair.executor.spinning():
            assert await waiting == (1, 1)
            begin = pair.clock.now_ns()
            later = subscription.next_deadline_miss(ms(50))
            publisher.publish(b"y")
            assert await later == (2, 1)
            assert pair.clock.now_ns() - begin >= 50 * MS
        assert seen == [(1, 1), (2, 1)]

    asyncio.run(scene())


def test_awaits_of_a_destroyed_entity_end(pair: Pair) -> None:
    async def scene() -> None:
        subscription, publisher = pair.subscription(), pair.publisher()
        waiting = [
            asyncio.create_task(subscription.next_message_lost()),
            asyncio.create_task(publisher.next_liveliness_loss()),
        ]
        await asyncio.sleep(0)
        subscription.destroy()
        pair.talker.destroy()
        for task, owner in zip(waiting, ("subscription to", "publisher of"), strict=True):
            with pytest.raises(RmwError, match=rf"^INVALID_ARGUMENT \(-4\): the {owner} /chatter is destroyed$"):
                await task

    asyncio.run(scene())


def test_a_callback_that_raises_costs_the_await_nothing(pair: Pair) -> None:
    async def scene() -> None:
        subscription = pair.subscription()
        subscription.on_liveliness_changed(lambda status: _raise(LookupError("from the callback")))
        waiting = subscription.next_liveliness_change()
        pair.publisher()
        with pytest.raises(LookupError):
            async with pair.executor.spinning():
                await asyncio.sleep(60)
        assert await waiting == (1, 0, 1, 0)

    asyncio.run(scene())


# Where and how it spins.


def test_callbacks_run_on_the_thread_of_the_event_loop_while_other_tasks_go_on() -> None:
    threads: list[int] = []
    ticks = 0

    async def tick() -> None:
        nonlocal ticks
        while True:
            ticks += 1
            await asyncio.sleep(0.001)

    async def scene() -> None:
        with Context("reference", Host(MonotonicClock())) as context:
            pair = Pair(context)
            publisher, subscription = pair.publisher(), pair.subscription()
            subscription.on_requested_deadline_missed(ms(10), lambda status: threads.append(threading.get_ident()))
            publisher.publish(b"x")
            ticking = asyncio.create_task(tick())
            async with pair.executor.spinning():
                status = await asyncio.wait_for(subscription.next_deadline_miss(), 5)
            ticking.cancel()
            assert status.total_count >= 1

    asyncio.run(scene())
    assert set(threads) == {threading.get_ident()}
    assert ticks > 1


def test_between_two_looks_the_event_loop_sleeps() -> None:
    session = QueueSession()

    async def scene() -> float:
        begin = time.monotonic()
        spin = asyncio.create_task(Executor(session, clock=MonotonicClock()).spin_async(every=ms(5)))
        while len(session.drives) < 5:
            await asyncio.sleep(0.001)
        spin.cancel()
        return time.monotonic() - begin

    assert asyncio.run(scene()) >= 4 * 0.005
    assert set(session.drives) == {(0, None)}


def test_what_is_ready_is_not_slept_over_and_the_cap_is_passed_on() -> None:
    session, got = QueueSession(), list[bytes]()
    executor = Executor(session, clock=MonotonicClock())
    executor.add_subscription(PolledSubscription(*[b"x"] * 20), got.append)

    async def scene() -> None:
        spin = asyncio.create_task(executor.spin_async(every=ms(60_000), max_callbacks=1))
        while len(got) < 20:
            await asyncio.sleep(0)
        spin.cancel()

    asyncio.run(asyncio.wait_for(scene(), 5))
    assert set(session.drives) == {(0, 1)}


def test_a_virtual_clock_is_waited_for_inside_drive_io() -> None:
    session = QueueSession()

    async def scene() -> None:
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(Executor(session, clock=VirtualClock()).spin_async(every=ms(3)), 0.001)

    asyncio.run(scene())
    assert set(session.drives) == {(3, None)}


def test_another_thread_may_spin_and_the_event_loop_await() -> None:
    async def scene() -> tuple[int, ...]:
        with Context("reference", Host(MonotonicClock())) as context:
            pair = Pair(context)
            publisher, subscription = pair.publisher(), pair.subscription()
            waiting = subscription.next_deadline_miss(ms(10))
            publisher.publish(b"x")
            stopped = threading.Event()
            spinning = threading.Thread(target=lambda: pair.executor.spin(until=stopped.is_set))
            spinning.start()
            try:
                return await asyncio.wait_for(waiting, 5)
            finally:
                stopped.set()
                spinning.join()

    assert asyncio.run(scene())[1] >= 1


# The block of ``async with executor.spinning()``.


def _raise(error: BaseException) -> None:
    raise error


def failing(session: QueueSession) -> Executor:
    """An executor over a session that soon loses its peer."""
    session.code = ReturnCode.CONNECTION_FAILED
    return Executor(session, clock=VirtualClock())


def test_a_failing_spin_ends_the_block_in_place_of_a_hang() -> None:
    async def scene() -> None:
        with pytest.raises(RmwError, match=r"^CONNECTION_FAILED \(-18\): drive_io$"):
            async with failing(QueueSession()).spinning():
                await asyncio.Event().wait()
        await asyncio.sleep(0)  # the task that was cancelled goes on as if nothing had happened
        task = asyncio.current_task()
        assert task is not None
        assert not hasattr(task, "cancelling") or task.cancelling() == 0

    asyncio.run(asyncio.wait_for(scene(), 5))


def test_a_spin_that_fails_in_the_moment_in_which_the_block_ends_is_raised() -> None:
    async def scene() -> None:
        executor = Executor(QueueSession(), clock=VirtualClock())
        over = asyncio.Event()

        def callback(data: bytes) -> None:
            over.set()
            raise LookupError("from the callback")

        executor.add_subscription(PolledSubscription(b"x"), callback)
        with pytest.raises(LookupError, match=r"^from the callback$"):
            await block(executor, over)
        await asyncio.sleep(0)

    async def block(executor: Executor, over: asyncio.Event) -> None:
        async with executor.spinning():
            await over.wait()

    asyncio.run(asyncio.wait_for(scene(), 5))


def test_an_error_of_the_block_and_one_of_the_spin_are_both_told() -> None:
    async def block() -> None:
        async with failing(QueueSession()).spinning():
            try:
                await asyncio.Event().wait()
            finally:
                _raise(LookupError("from the block"))

    with pytest.raises(RmwError, match="CONNECTION_FAILED") as caught:
        asyncio.run(asyncio.wait_for(block(), 5))
    assert isinstance(caught.value.__context__, LookupError)


def test_an_error_of_the_block_alone_passes_and_the_spin_ends() -> None:
    async def scene() -> None:
        with pytest.raises(LookupError, match=r"^from the block$"):
            async with Executor(QueueSession(), clock=VirtualClock()).spinning():
                raise LookupError("from the block")
        assert "spin" not in {task.get_name() for task in asyncio.all_tasks()}

    asyncio.run(scene())


def test_a_block_that_is_cancelled_is_cancelled() -> None:
    async def block() -> None:
        async with Executor(QueueSession(), clock=VirtualClock()).spinning():
            await asyncio.Event().wait()

    async def scene() -> None:
        task = asyncio.create_task(block())
        for _ in range(3):
            await asyncio.sleep(0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert "spin" not in {task.get_name() for task in asyncio.all_tasks()}

    asyncio.run(asyncio.wait_for(scene(), 5))


def test_after_a_failure_the_next_block_delivers_what_comes_later(pair: Pair) -> None:
    async def scene() -> None:
        subscription = pair.subscription()
        subscription.on_liveliness_changed(lambda status: _raise(LookupError("from the callback")))
        publisher = pair.publisher()
        with pytest.raises(LookupError):
            async with pair.executor.spinning():
                await asyncio.sleep(60)
        subscription.on_liveliness_changed(lambda status: None)
        waiting = subscription.next_liveliness_change()
        publisher.destroy()
        async with pair.executor.spinning():
            assert await asyncio.wait_for(waiting, 5) == (0, 0, -1, 0)

    asyncio.run(scene())
