from __future__ import annotations

import gc
import time
import weakref
from dataclasses import replace

import pytest

from nros_backends.xrce.session import CAPACITY
from nros_backends.xrce.wire.ids import Kind, Status
from nros_conformance.rmw.clock import MS, MonotonicClock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import CountStatus, EventKind, EventStatus
from nros_conformance.rmw.qos import (
    DEFAULT,
    SENSOR_DATA,
    Durability,
    History,
    Liveliness,
    QosProfile,
    Reliability,
)
from tests.backends.xrce.conftest import TYPE, Bench, drain, drive, publisher, subscription

BEST_EFFORT = QosProfile(reliability=Reliability.BEST_EFFORT)
OFFERED, REQUESTED = EventKind.OFFERED_DEADLINE_MISSED, EventKind.REQUESTED_DEADLINE_MISSED


# --- samples ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("qos", [DEFAULT, SENSOR_DATA], ids=["reliable", "best-effort"])
@pytest.mark.parametrize("sessions", [1, 2])
def test_samples_arrive_in_order_within_and_between_sessions(bench: Bench, qos: QosProfile, sessions: int) -> None:
    near = bench.session()
    far = bench.session("far") if sessions == 2 else near
    sent, received = publisher(near, qos), subscription(far, qos)
    samples = [bytes([number]) * number for number in range(5)]  # the first is empty
    assert [sent.publish_raw(one) for one in samples] == [ReturnCode.OK] * 5
    assert drive(near, far, until=lambda: len(received._waiting) == 5)
    assert drain(received) == samples
    assert received.try_recv_raw(100) == ReturnCode.NO_DATA
    assert received.has_data() is False


def test_other_domains_and_topics_hear_nothing(bench: Bench) -> None:
    near, far = bench.session(), bench.session("far", domain=1)
    sent = publisher(near)
    same, topic, domain = subscription(near), subscription(near, topic="/other"), subscription(far)
    sent.publish_raw(b"sample")
    assert drive(near, far, until=lambda: same.has_data() is True)
    assert topic.has_data() is False
    assert domain.has_data() is False


def test_large_samples_are_for_the_reliable(bench: Bench) -> None:
    session = bench.session()
    reliable, quick = publisher(session), publisher(session, BEST_EFFORT)
    received = subscription(session)
    assert reliable.publish_raw(bytes(CAPACITY + 1)) == ReturnCode.MESSAGE_TOO_LARGE
    assert quick.publish_raw(bytes(600)) == ReturnCode.MESSAGE_TOO_LARGE
    assert reliable.publish_raw(bytes(100_000)) == ReturnCode.OK
    assert drive(session, until=lambda: received.has_data() is True)
    assert received.try_recv_raw(100_000) == bytes(100_000)


def test_the_queue_keeps_the_newest_and_counts_the_rest(bench: Bench) -> None:
    session = bench.session()
    sent, received = publisher(session), subscription(session, replace(DEFAULT, depth=3))
    for number in range(8):
        sent.publish_raw(bytes([number]))
    assert drive(session, until=lambda: received.dropped == 5)
    assert drain(received) == [b"\5", b"\6", b"\7"]


def test_a_sample_for_too_small_a_buffer_is_dropped_and_counted(bench: Bench) -> None:
    session = bench.session()
    sent, received = publisher(session), subscription(session)
    sent.publish_raw(b"too large")
    sent.publish_raw(b"fits")
    assert drive(session, until=lambda: len(received._waiting) == 2)
    assert received.try_recv_raw(4) == ReturnCode.BUFFER_TOO_SMALL
    assert received.try_recv_raw(4) == b"fits"
    assert received.too_large == 1


def test_late_subscriptions_get_history_where_both_ends_keep_it(bench: Bench) -> None:
    session = bench.session()
    kept = replace(DEFAULT, durability=Durability.TRANSIENT_LOCAL, depth=2)
    sent = publisher(session, kept)
    for number in range(5):
        sent.publish_raw(bytes([number]))
    received, plain = subscription(session, kept), subscription(session)
    assert drive(session, until=lambda: len(received._waiting) == 2)
    assert drain(received) == [b"\3", b"\4"]
    assert plain.has_data() is False


@pytest.mark.parametrize(
    ("offered", "requested", "matches"),
    [
        (DEFAULT, DEFAULT, True),
        (BEST_EFFORT, DEFAULT, False),
        (DEFAULT, BEST_EFFORT, True),
        (DEFAULT, replace(DEFAULT, durability=Durability.TRANSIENT_LOCAL), False),
        (replace(DEFAULT, deadline_ms=100), replace(DEFAULT, deadline_ms=200), True),
        (replace(DEFAULT, deadline_ms=200), replace(DEFAULT, deadline_ms=100), False),
        (DEFAULT, replace(DEFAULT, deadline_ms=100), False),
    ],
)
def test_which_pairs_match(bench: Bench, offered: QosProfile, requested: QosProfile, matches: bool) -> None:
    session = bench.session()
    sent, received = publisher(session, offered), subscription(session, requested)
    assert bench.backend.await_matched(sent, received, 0) is matches
    assert bench.backend.matched(sent) == matches
    assert bench.backend.matched(received) == matches


# --- refusals -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("qos", "text"),
    [
        (replace(DEFAULT, history=History.KEEP_ALL), "history KEEP_ALL"),
        (replace(DEFAULT, lifespan_ms=100), "lifespan 100 ms"),
        (replace(DEFAULT, lease_ms=100), "lease 100 ms"),
        (replace(DEFAULT, liveliness=Liveliness.MANUAL_BY_TOPIC), "liveliness MANUAL_BY_TOPIC"),
        (replace(DEFAULT, liveliness=Liveliness.MANUAL_BY_NODE), "liveliness MANUAL_BY_NODE"),
    ],
)
def test_what_nobody_could_enforce_is_refused(bench: Bench, qos: QosProfile, text: str) -> None:
    with pytest.raises(RmwError, match=rf"^INCOMPATIBLE_QOS \(-6\): XRCE cannot carry {text}$"):
        bench.session().create_publisher("/topic", TYPE, qos)


@pytest.mark.parametrize("topic", ["", "/", "a b", "1abc", "a//b", "a-b", "x" * 201])
def test_names_that_are_none(bench: Bench, topic: str) -> None:
    with pytest.raises(RmwError) as caught:
        bench.session().create_subscription(topic, TYPE, DEFAULT)
    assert caught.value.code is ReturnCode.TOPIC_NAME_INVALID


def test_a_topic_in_use_has_one_type_within_a_session(bench: Bench) -> None:
    session = bench.session()
    first = publisher(session)
    with pytest.raises(RmwError) as caught:
        session.create_subscription("/topic", "std_msgs/msg/Int32", DEFAULT)
    assert caught.value.code is ReturnCode.TOPIC_NAME_INVALID
    first.destroy()
    session.create_subscription("/topic", "std_msgs/msg/Int32", DEFAULT)


def test_what_the_agent_refuses_leaves_nothing_behind(bench: Bench) -> None:
    session = bench.session()
    first = publisher(session)
    gone = session.client.delete(session._objects.plan(Kind.DATAWRITER, "rt/topic", "type").topic)
    assert session.client.outcomes([gone], MonotonicClock().now_ns() + 10_000 * MS) == [Status.OK]
    with pytest.raises(RmwError, match=r"^ERROR \(-1\): the agent refuses datareader on /topic: DDS_ERROR$"):
        subscription(session)
    first.destroy()
    sent, received = publisher(session, topic="/other"), subscription(session, topic="/other")
    sent.publish_raw(b"sample")
    assert drive(session, until=lambda: received.has_data() is True)


# --- events -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", list(EventKind))
def test_only_the_two_deadlines_are_supported(bench: Bench, kind: EventKind) -> None:
    session = bench.session()
    for end, supported in ((publisher(session), OFFERED), (subscription(session), REQUESTED)):
        answer = end.register_event(int(kind), 100, lambda *_: None, None)
        assert end.supports_event(int(kind)) is (kind is supported)
        assert answer == (ReturnCode.OK if kind is supported else ReturnCode.UNSUPPORTED)


@pytest.mark.parametrize("qos", [DEFAULT, replace(DEFAULT, deadline_ms=30)], ids=["at-registration", "in-qos"])
def test_missed_deadlines_are_counted_at_both_ends(bench: Bench, qos: QosProfile) -> None:
    session = bench.session()
    sent, received = publisher(session, qos), subscription(session, qos)
    told: list[tuple[int, EventStatus]] = []
    for end, kind in ((sent, OFFERED), (received, REQUESTED)):
        assert end.register_event(int(kind), 30, lambda kind, status, _: told.append((kind, status)), None) == 0
    session.drive_io(50)
    assert told == []  # not before the first sample
    begin = time.monotonic()
    sent.publish_raw(b"sample")
    assert drive(session, until=lambda: len(told) >= 6)
    elapsed = time.monotonic() - begin
    for kind in (OFFERED, REQUESTED):
        statuses = [status for told_kind, status in told if told_kind == kind]
        assert all(isinstance(status, CountStatus) for status in statuses)
        assert sum(status[1] for status in statuses) == statuses[-1][0] <= elapsed / 0.03


def test_a_sample_that_waited_in_the_socket_came_when_the_kernel_got_it(bench: Bench) -> None:
    near, far = bench.session(), bench.session("far")
    sent, received = publisher(near), subscription(far)
    told: list[EventStatus] = []
    received.register_event(int(REQUESTED), 500, lambda kind, status, _: told.append(status), None)
    sent.publish_raw(b"first")
    assert drive(far, until=lambda: received.has_data() is True)
    for _ in range(6):  # nobody drives, but each gap is far below the deadline
        time.sleep(0.1)
        sent.publish_raw(b"more")
    assert drive(far, until=lambda: len(received._waiting) == 7)
    assert sum(status[1] for status in told) == 0


def test_message_callbacks_run_inside_drive_io_one_per_sample(bench: Bench) -> None:
    session = bench.session()
    sent, received = publisher(session), subscription(session)
    taken: list[object] = []
    sent.publish_raw(b"before")
    assert drive(session, until=lambda: received.has_data() is True)
    received.set_message_callback(lambda context: taken.append((context, received.try_recv_raw(100))), "context")
    sent.publish_raw(b"after")
    time.sleep(0.01)
    assert taken == []
    assert drive(session, until=lambda: len(taken) == 2)
    assert taken == [("context", b"before"), ("context", b"after")]


def test_from_inside_a_callback_drive_io_would_block(bench: Bench) -> None:
    session = bench.session()
    sent, received = publisher(session), subscription(session)
    answers: list[int] = []
    received.set_message_callback(lambda context: answers.append(session.drive_io(1_000)), None)
    sent.publish_raw(b"sample")
    assert drive(session, until=lambda: bool(answers))
    assert answers == [ReturnCode.WOULD_BLOCK]


# --- lifetime -----------------------------------------------------------------------------------------


def test_what_is_destroyed_answers_with_an_error_and_no_harm(bench: Bench) -> None:
    session = bench.session()
    sent, received = publisher(session), subscription(session)
    assert sent.destroy() == received.destroy() == ReturnCode.OK
    assert sent.destroy() == received.destroy() == ReturnCode.INVALID_ARGUMENT
    assert sent.publish_raw(b"") == sent.assert_liveliness() == ReturnCode.INVALID_ARGUMENT
    assert received.has_data() == received.try_recv_raw(1) == ReturnCode.INVALID_ARGUMENT
    assert session.destroy() == ReturnCode.OK
    assert session.destroy() == session.drive_io(0) == session.ping(1) == ReturnCode.INVALID_ARGUMENT
    with pytest.raises(RmwError, match="the session is destroyed"):
        publisher(session)


def test_a_session_takes_its_entities_with_it(bench: Bench) -> None:
    session = bench.session()
    sent = publisher(session)
    session.destroy()
    assert sent.publish_raw(b"") == ReturnCode.INVALID_ARGUMENT
    assert not bench.agent.entities()


def test_callbacks_and_contexts_are_let_go(bench: Bench) -> None:
    class Context:
        pass

    session, context = bench.session(), Context()
    received = subscription(session)
    received.register_event(int(REQUESTED), 100, lambda *_: None, context)
    alive = weakref.ref(context)
    del context
    received.destroy()
    gc.collect()
    assert alive() is None


def test_ids_are_used_again(bench: Bench) -> None:
    session = bench.session()
    used = set()
    for _ in range(30):
        sent = publisher(session)
        used.add(sent.object_id)
        assert sent.destroy() == ReturnCode.OK
    assert len(used) == 1
    assert not session.client._statuses
    assert not session.client._asked
