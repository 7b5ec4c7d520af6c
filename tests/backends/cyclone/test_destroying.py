from __future__ import annotations

import gc
import threading
import time
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from nros_conformance.rmw.clock import MS, MonotonicClock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import DEFAULT, Liveliness
from tests.backends.cyclone.conftest import LONG

if TYPE_CHECKING:
    from nros_backends.cyclone.backend import CycloneBackend
    from nros_backends.cyclone.session import CycloneSession
    from tests.backends.cyclone.conftest import Stage

TYPE = "std_msgs/msg/String"


def test_every_call_on_a_stale_handle_is_refused(stage: Stage) -> None:
    publisher, subscription = stage.publisher(liveliness=Liveliness.MANUAL_BY_TOPIC), stage.subscription()
    assert stage.near.destroy() == ReturnCode.OK  # its subscription goes with it
    assert publisher.destroy() == ReturnCode.OK
    refused = ReturnCode.INVALID_ARGUMENT
    for entity in (publisher, subscription):
        assert entity.destroy() == refused
        assert [entity.supports_event(kind) for kind in range(5)] == [False] * 5
        assert [entity.register_event(kind, 100, lambda *_: None, None) for kind in range(5)] == [refused] * 5
    assert publisher.publish_raw(b"x") == refused
    assert publisher.assert_liveliness() == refused
    assert subscription.has_data() == refused
    assert subscription.try_recv_raw(10) == refused
    assert subscription.set_message_callback(lambda _: None, None) == refused
    assert stage.near.drive_io(10) == refused
    assert stage.near.ping(10) == refused
    assert stage.near.destroy() == refused
    assert stage.near.deafmute(deaf=True, mute=True) == refused
    for make in (stage.near.create_publisher, stage.near.create_subscription):
        with pytest.raises(RmwError, match=r"^INVALID_ARGUMENT \(-4\): the session is destroyed$"):
            make("t", TYPE, DEFAULT)
    assert stage.backend.await_matched(publisher, subscription, stage.clock.now_ns()) is False


def test_destroying_a_session_ends_a_drive_in_another_thread(session: CycloneSession, clock: MonotonicClock) -> None:
    codes: list[int] = []
    thread = threading.Thread(target=lambda: codes.append(session.drive_io(10_000)))
    thread.start()
    while not session._waiting:
        time.sleep(0.001)
    begin = clock.now_ns()
    assert session.destroy() == ReturnCode.OK
    thread.join()
    assert clock.now_ns() - begin < 5_000 * MS
    assert codes == [ReturnCode.OK]


def test_a_silent_peer_does_not_hold_up_the_end(stage: Stage) -> None:
    publisher, _ = stage.pair()
    stage.near.deafmute(deaf=True, mute=True)
    publisher.publish_raw(b"never acknowledged")
    begin = stage.clock.now_ns()
    assert stage.far.destroy() == ReturnCode.OK
    assert stage.clock.now_ns() - begin < 900 * MS  # DDS' default is to wait for a second


def test_destroying_releases_callback_and_context(stage: Stage) -> None:
    class Context:
        pass

    publisher, subscription = stage.pair(deadline_ms=20)
    contexts = [Context() for _ in range(3)]
    alive = weakref.WeakSet(contexts)
    publisher.register_event(EventKind.OFFERED_DEADLINE_MISSED, 0, lambda *_: None, contexts[0])
    publisher.register_event(EventKind.OFFERED_DEADLINE_MISSED, 0, lambda *_: None, contexts[1])
    subscription.set_message_callback(lambda _: None, contexts[2])
    contexts.clear()
    assert len(alive) == 2  # the second registration replaced the first
    publisher.publish_raw(b"x")
    stage.near.drive_io(30)
    subscription.destroy()
    publisher.destroy()
    gc.collect()
    assert len(alive) == 0


def resources() -> tuple[int, int, list[str]]:
    threads, descriptors = (len(list(Path("/proc/self", what).iterdir())) for what in ("task", "fd"))
    return threads, descriptors, sorted(thread.name for thread in threading.enumerate())


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="counts threads and descriptors through /proc")
def test_fifty_cycles_leave_no_thread_and_no_descriptor(
    open_session: Callable[..., CycloneSession], backend: CycloneBackend, clock: MonotonicClock
) -> None:
    before = resources()
    for cycle in range(50):
        near, far = open_session(), open_session()
        publisher = far.create_publisher("t", TYPE, DEFAULT)
        subscription = near.create_subscription("t", TYPE, DEFAULT)
        log: list[object] = []
        subscription.register_event(EventKind.REQUESTED_DEADLINE_MISSED, 1, lambda *_: log.append(1), None)  # noqa: B023
        assert backend.await_matched(publisher, subscription, clock.now_ns() + LONG)
        publisher.publish_raw(b"x")
        limit = clock.now_ns() + LONG
        while not log and clock.now_ns() < limit:
            near.drive_io(10)
        assert log
        if cycle % 2:
            publisher.destroy()
            subscription.destroy()
        near.destroy()
        far.destroy()
    assert resources() == before


def test_a_hundred_cycles_of_an_entity_leave_nothing_in_dds(stage: Stage) -> None:
    from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription

    def known() -> int:
        builtins = (BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription)
        participant = stage.near._participant
        assert participant is not None
        return sum(len(BuiltinDataReader(participant, builtin).read(1_000)) for builtin in builtins)

    before = known()
    for _ in range(100):
        publisher, subscription = stage.publisher(stage.near), stage.subscription(stage.near)
        log = stage.log(subscription, EventKind.LIVELINESS_CHANGED)
        stage.log(subscription, EventKind.REQUESTED_DEADLINE_MISSED, 1_000)  # watched by the receiver
        stage.until(lambda log=log: stage.near.drive_io(1) == ReturnCode.OK and log.counts == (1, 0))  # type: ignore[misc]
        publisher.destroy()
        subscription.destroy()
    # The two readers of the first count are still there: the binding leaks them.
    assert known() <= before + 2
