from __future__ import annotations

import threading

import pytest

from nros_conformance.rmw.clock import MS, MonotonicClock, VirtualClock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import EventKind, EventStatus
from nros_conformance.rmw.qos import Durability, History, Liveliness, QosProfile
from nros_conformance.rmw.queued import QueuedPublisher, QueuedSession, QueuedSubscription, asks_for

MISSED, LOST, ALIVE = EventKind.REQUESTED_DEADLINE_MISSED, EventKind.MESSAGE_LOST, EventKind.LIVELINESS_CHANGED
OFFERED = EventKind.OFFERED_DEADLINE_MISSED


class Talker(QueuedPublisher):
    events = (OFFERED,)
    answer: int = ReturnCode.OK

    def send(self, data: bytes) -> int:
        for entity in tuple(self.session.entities):
            if isinstance(entity, Listener) and self.answer == ReturnCode.OK:
                entity.received(data)
        return self.answer


class Listener(QueuedSubscription):
    events = (MISSED, LOST, ALIVE)
    left = False

    def leave(self) -> None:
        self.left = True


class Line(QueuedSession):
    publisher = Talker
    subscription = Listener
    unsupported = ("durability.transient_local", "lifespan", "depth.above_128")
    left = False

    def leave(self) -> None:
        self.left = True


@pytest.fixture
def line() -> Line:
    return Line(VirtualClock())


def listener(line: Line, **qos: int) -> Listener:
    made = line.create_subscription("/topic", "msgs/msg/One", QosProfile(**qos))  # type: ignore[arg-type]
    assert isinstance(made, Listener)
    return made


def talker(line: Line, **qos: int) -> Talker:
    made = line.create_publisher("/topic", "msgs/msg/One", QosProfile(**qos))  # type: ignore[arg-type]
    assert isinstance(made, Talker)
    return made


def listen(entity: Talker | Listener, kind: EventKind, deadline_ms: int = 0) -> list[EventStatus]:
    seen: list[EventStatus] = []
    assert entity.register_event(kind, deadline_ms, lambda _, status, __: seen.append(status), None) == 0
    return seen


def test_samples_come_out_in_order_and_the_oldest_is_lost_when_the_queue_is_full(line: Line) -> None:
    one, two = listener(line, depth=2), talker(line)
    seen = listen(one, LOST)
    for data in (b"1", b"", b"3"):
        assert two.publish_raw(data) == 0
    line.drive_io(0)
    assert seen == [(1, 1)]
    assert [one.try_recv_raw(9) for _ in range(3)] == [b"", b"3", ReturnCode.NO_DATA]


def test_keep_all_loses_nothing(line: Line) -> None:
    one, two = listener(line, depth=1, history=History.KEEP_ALL), talker(line)
    assert {two.publish_raw(bytes([n])) for n in range(20)} == {0}
    assert [one.try_recv_raw(9) for _ in range(20)] == [bytes([n]) for n in range(20)]


def test_a_sample_that_is_too_large_for_the_caller_is_dropped_and_counted(line: Line) -> None:
    one, two = listener(line), talker(line)
    seen = listen(one, LOST)
    two.publish_raw(b"large")
    two.publish_raw(b"1")
    assert [one.try_recv_raw(4), one.try_recv_raw(4)] == [ReturnCode.BUFFER_TOO_SMALL, b"1"]
    line.drive_io(0)
    assert seen == [(1, 1)]


def test_gaps_in_the_sequence_of_a_publisher_are_losses(line: Line) -> None:
    one = listener(line)
    seen = listen(one, LOST)
    for publisher, sequence in (("a", 0), ("b", 7), ("a", 3), ("b", 8)):
        one.received(b"", publisher, sequence)
    line.drive_io(0)
    assert seen == [(2, 2)]


def test_a_sample_that_was_overtaken_is_delivered_and_not_lost(line: Line) -> None:
    one = listener(line)
    seen = listen(one, LOST)
    for sequence in (1, 3, 2):
        one.received(bytes([sequence]), "a", sequence)
    line.drive_io(0)
    assert seen == []
    assert [one.try_recv_raw(9) for _ in range(3)] == [b"\1", b"\3", b"\2"]


def test_a_deadline_of_the_registration_runs_from_the_arrival_and_ends_a_long_drive(line: Line) -> None:
    one = listener(line)
    seen = listen(one, MISSED, 20)
    line.drive_io(100)
    assert seen == []  # no first sample yet
    begin = line.clock.now_ns()
    one.received(b"")
    line.drive_io(0)
    assert line.drive_io(1000) == 0
    assert (seen, line.clock.now_ns() - begin) == ([(1, 1)], 20 * MS)


def test_a_deadline_of_the_qos_counts_every_period_however_rarely_it_is_looked_at(line: Line) -> None:
    one = listener(line, deadline_ms=20)
    seen = listen(one, MISSED)
    one.received(b"")
    line.clock.wait(None, line.clock.now_ns() + 70 * MS)
    one.received(b"")  # misses before it stay misses
    line.drive_io(0)
    assert seen == [(3, 3)]


def test_a_later_registration_brings_its_own_period_and_the_total_goes_on(line: Line) -> None:
    one = listener(line)
    first = listen(one, MISSED, 20)
    one.received(b"")
    line.drive_io(0)
    line.drive_io(20)
    second = listen(one, MISSED, 50)
    one.received(b"")
    begin = line.clock.now_ns()
    line.drive_io(0)
    line.drive_io(1000)
    assert (first, second, line.clock.now_ns() - begin) == ([(1, 1)], [(2, 1)], 50 * MS)


def test_only_a_publish_that_succeeds_begins_the_offered_period_anew(line: Line) -> None:
    one = talker(line)
    seen = listen(one, OFFERED, 20)
    one.publish_raw(b"")
    line.clock.wait(None, line.clock.now_ns() + 15 * MS)
    one.answer = ReturnCode.ERROR
    assert one.publish_raw(b"") == ReturnCode.ERROR
    line.clock.wait(None, line.clock.now_ns() + 5 * MS)
    line.drive_io(0)
    assert seen == [(1, 1)]


def test_living_publishers_are_reported_as_differences(line: Line) -> None:
    one = listener(line)
    seen = listen(one, ALIVE)
    one.living(2, 0)
    one.living(1, 1)
    line.drive_io(0)
    assert seen == [(1, 1, 1, 1)]


def test_a_cap_of_one_runs_what_was_ready_first_messages_and_events_alike(line: Line) -> None:
    one, two = listener(line, depth=1), talker(line)
    order: list[str] = []
    one.register_event(LOST, 0, lambda *_: order.append("lost"), None)
    one.set_message_callback(lambda _: order.append("message"), None)
    two.publish_raw(b"")
    line.drive_io(0, 1)
    line.clock.wait(None, line.clock.now_ns() + MS)
    two.publish_raw(b"")
    line.drive_io(0, 1)
    line.drive_io(0, 1)
    assert line.drive_io(0) == 0
    assert order == ["message", "message", "lost"]


def test_a_message_callback_hears_of_what_waits_already_and_not_of_what_was_taken(line: Line) -> None:
    one, two = listener(line), talker(line)
    heard: list[object] = []
    two.publish_raw(b"1")
    two.publish_raw(b"2")
    assert one.try_recv_raw(9) == b"1"
    assert one.set_message_callback(heard.append, "context") == 0
    line.drive_io(0)
    assert heard == ["context"]


def test_a_sample_from_another_thread_ends_the_waiting() -> None:
    line = Line(MonotonicClock())
    one = listener(line)
    sender = threading.Timer(0.05, lambda: one.received(b"now"))
    sender.start()
    assert line.drive_io(20_000) == 0
    assert one.try_recv_raw(9) == b"now"
    sender.join()


def test_drive_io_from_a_callback_answers_would_block(line: Line) -> None:
    one, two = listener(line), talker(line)
    codes: list[int] = []
    one.set_message_callback(lambda _: codes.append(line.drive_io(1000)), None)
    two.publish_raw(b"")
    line.drive_io(0)
    assert codes == [ReturnCode.WOULD_BLOCK]


@pytest.mark.parametrize(("qos", "code"), [
    ({"durability": Durability.TRANSIENT_LOCAL}, ReturnCode.INCOMPATIBLE_QOS),
    ({"lifespan_ms": 5}, ReturnCode.INCOMPATIBLE_QOS),
    ({"depth": 129}, ReturnCode.INCOMPATIBLE_QOS),
    ({"depth": 65536}, ReturnCode.INVALID_ARGUMENT),
])  # fmt: skip
def test_what_is_not_supported_is_refused_and_nothing_is_created(
    line: Line, qos: dict[str, int], code: ReturnCode
) -> None:
    with pytest.raises(RmwError) as caught:
        listener(line, **qos)
    assert (caught.value.code, line.entities) == (code, {})


@pytest.mark.parametrize(("topic", "type_name"), [("", "t"), ("/a//b", "t"), ("/9", "t"), ("/a b", "t"), ("/a", "")])
def test_an_invalid_name_is_refused(line: Line, topic: str, type_name: str) -> None:
    with pytest.raises(RmwError) as caught:
        line.create_publisher(topic, type_name, QosProfile())
    assert caught.value.code == ReturnCode.TOPIC_NAME_INVALID


def test_a_depth_of_zero_becomes_one(line: Line) -> None:
    assert listener(line, depth=0).qos.depth == 1


def test_after_destroy_everything_is_refused_released_and_repeatable(line: Line) -> None:
    one, two = listener(line), talker(line)
    assert [line.destroy(), line.destroy(), one.destroy(), two.destroy()] == [0, 0, 0, 0]
    assert (one.left, line.left, line.entities) == (True, True, {})
    assert {
        line.drive_io(0), line.ping(0), two.publish_raw(b""), two.assert_liveliness(), int(one.has_data()),
        one.try_recv_raw(1), one.set_message_callback(None, None), one.register_event(2, 0, lambda *_: None, None),
    } == {ReturnCode.INVALID_ARGUMENT}  # fmt: skip
    with pytest.raises(RmwError, match="the session is destroyed"):
        listener(line)


def test_arguments_that_make_no_sense_are_refused(line: Line) -> None:
    one, two = listener(line), talker(line)
    assert {
        line.drive_io(None), line.drive_io(0, -1), line.drive_io(0, "1"), two.publish_raw("text"),  # type: ignore[arg-type]
        one.try_recv_raw(-1), one.try_recv_raw(None),  # type: ignore[arg-type]
    } == {ReturnCode.INVALID_ARGUMENT}  # fmt: skip


def test_an_event_without_a_source_is_a_mistake_of_the_adapter(line: Line) -> None:
    class Promising(Talker):
        events = (EventKind.LIVELINESS_LOST,)

    with pytest.raises(NotImplementedError, match="Promising has no source of LivelinessLost"):
        Promising(line, "/topic", "msgs/msg/One", QosProfile())


def test_policies_have_the_names_of_the_declaration() -> None:
    qos = QosProfile(
        liveliness=Liveliness.MANUAL_BY_NODE, lease_ms=7, depth=200, durability=Durability.TRANSIENT_LOCAL
    )  # fmt: skip
    names = (
        "durability.transient_local", "history.keep_all", "depth.above_128", "depth.above_200", "deadline",
        "lifespan", "lease", "liveliness.manual_by_topic", "liveliness.manual_by_node",
    )  # fmt: skip
    assert [name for name in names if asks_for(qos, name)] == [
        "durability.transient_local", "depth.above_128", "lease", "liveliness.manual_by_node",
    ]  # fmt: skip
