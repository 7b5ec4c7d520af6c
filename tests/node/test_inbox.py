from __future__ import annotations

import asyncio
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nros_conformance.node.inbox import Inbox
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import CountStatus


def status(number: int) -> CountStatus:
    return CountStatus(number, 1)


def test_what_came_between_two_awaits_is_delivered_in_order() -> None:
    async def scene() -> list[CountStatus]:
        inbox: Inbox[CountStatus] = Inbox()
        inbox.put(status(1))
        inbox.put(status(2))
        return [await inbox.next(), await inbox.next()]

    assert asyncio.run(scene()) == [status(1), status(2)]


def test_an_await_that_is_cancelled_although_its_event_has_come_loses_nothing() -> None:
    async def scene() -> CountStatus:
        inbox: Inbox[CountStatus] = Inbox()
        waiting = asyncio.create_task(inbox.next())
        await asyncio.sleep(0)
        inbox.put(status(1))
        await asyncio.sleep(0)  # the waiter has been released, the task has not run yet
        waiting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waiting
        return await asyncio.wait_for(inbox.next(), 5)

    assert asyncio.run(scene()) == status(1)


def test_an_event_that_finds_its_await_cancelled_disturbs_nobody() -> None:
    async def scene() -> list[object]:
        inbox: Inbox[CountStatus] = Inbox()
        complaints: list[object] = []
        asyncio.get_running_loop().set_exception_handler(lambda loop, complaint: complaints.append(complaint))
        waiting = asyncio.create_task(inbox.next())
        await asyncio.sleep(0)
        inbox.put(status(1))
        waiting.cancel()
        await asyncio.wait([waiting])
        return complaints

    assert asyncio.run(scene()) == []


def test_an_await_that_times_out_loses_nothing() -> None:
    async def scene() -> CountStatus:
        inbox: Inbox[CountStatus] = Inbox()
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(inbox.next(), 0.001)
        inbox.put(status(1))
        return await asyncio.wait_for(inbox.next(), 5)

    assert asyncio.run(scene()) == status(1)


STEPS = st.lists(
    st.one_of(
        st.just(("put", 0)),
        st.just(("await", 0)),
        st.just(("loop", 0)),
        st.tuples(st.just("cancel"), st.integers(0, 5)),
    ),
    max_size=40,
)


@given(steps=STEPS)
def test_every_event_is_awaited_once_and_in_order_whatever_is_cancelled_when(steps: list[tuple[str, int]]) -> None:
    async def scene() -> None:
        inbox: Inbox[CountStatus] = Inbox()
        tasks: list[asyncio.Task[None]] = []
        got: list[int] = []
        put = 0

        async def take() -> None:
            got.append((await inbox.next()).total_count)

        for step, which in steps:
            if step == "put":
                put += 1
                inbox.put(status(put))
            elif step == "await":
                tasks.append(asyncio.create_task(take()))
            elif step == "cancel" and tasks:
                tasks[which % len(tasks)].cancel()
            else:
                await asyncio.sleep(0)
        for _ in range(3):
            await asyncio.sleep(0)
        waiting = [task for task in tasks if not task.done()]
        assert not waiting or len(got) == put  # nobody waits for what is there
        for task in waiting:
            task.cancel()
        await asyncio.gather(*waiting, return_exceptions=True)
        while len(got) < put:
            await asyncio.wait_for(take(), 5)
        assert got == list(range(1, put + 1))

    asyncio.run(scene())


@pytest.mark.parametrize("awaited_first", [True, False])
def test_after_the_end_awaits_get_what_is_left_and_then_an_error(awaited_first: bool) -> None:
    async def scene() -> None:
        inbox: Inbox[CountStatus] = Inbox()
        tasks = [asyncio.ensure_future(inbox.next()), asyncio.ensure_future(inbox.next())]
        if awaited_first:
            await asyncio.sleep(0)
        inbox.put(status(1))
        inbox.close("it is gone")
        assert await tasks[0] == status(1)
        with pytest.raises(RmwError, match=r"^INVALID_ARGUMENT \(-4\): it is gone$") as caught:
            await tasks[1]
        assert caught.value.code is ReturnCode.INVALID_ARGUMENT

    asyncio.run(scene())


def test_events_may_come_from_another_thread() -> None:
    count = 2_000
    inbox: Inbox[CountStatus] = Inbox()

    def drive() -> None:
        for number in range(count):
            inbox.put(status(number))

    async def scene() -> list[int]:
        driving = threading.Thread(target=drive)
        driving.start()
        got = [(await asyncio.wait_for(inbox.next(), 5)).total_count for _ in range(count)]
        driving.join()
        return got

    assert asyncio.run(scene()) == list(range(count))


def test_an_event_that_another_thread_puts_just_before_the_await_waits_is_seen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def scene() -> CountStatus:
        inbox: Inbox[CountStatus] = Inbox()
        loop = asyncio.get_running_loop()
        make = loop.create_future

        def put_meanwhile() -> asyncio.Future[None]:
            inbox.put(status(1))  # the other thread finds no waiter yet
            return make()

        monkeypatch.setattr(loop, "create_future", put_meanwhile)
        return await inbox.next()

    assert asyncio.run(scene()) == status(1)


def test_one_inbox_may_serve_several_event_loops_in_turn() -> None:
    inbox: Inbox[CountStatus] = Inbox()

    async def wait_in_vain() -> None:
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(inbox.next(), 0.001)

    async def wait_for_one() -> CountStatus:
        waiting = asyncio.create_task(inbox.next())
        await asyncio.sleep(0)
        inbox.put(status(1))
        return await waiting

    asyncio.run(wait_in_vain())
    assert asyncio.run(wait_for_one()) == status(1)
