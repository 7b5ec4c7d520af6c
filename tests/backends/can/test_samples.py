from __future__ import annotations

import pytest

from nros_backends.can.policies import CAPACITY
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import History, Liveliness, Reliability
from tests.backends.can.conftest import Bench, publisher, subscription, take
from tests.backends.log import Log


def test_samples_of_every_size_arrive_as_they_were(either: Bench) -> None:
    talker, listener = publisher(either.session()), subscription(either.session(), history=History.KEEP_ALL)
    either.run()
    samples = [
        bytes(index % 251 for index in range(size)) for size in (0, 1, 6, 7, 8, 62, 63, 64, 70, 100, 1024, CAPACITY)
    ]
    for sample in samples:
        assert talker.publish_raw(sample) == ReturnCode.OK
    either.run()
    assert take(listener) == samples


def test_a_sample_beyond_the_capacity_is_refused(bench: Bench) -> None:
    talker = publisher(bench.session())
    assert talker.publish_raw(bytes(CAPACITY + 1)) == ReturnCode.MESSAGE_TOO_LARGE
    assert talker.publish_raw("text") == ReturnCode.INVALID_ARGUMENT


def test_both_ends_in_one_session_meet(either: Bench) -> None:
    session = either.session()
    talker, listener = publisher(session), subscription(session)
    either.run()
    talker.publish_raw(b"mine")
    either.run()
    assert take(listener) == [b"mine"]
    assert either.backend.matched(talker) == either.backend.matched(listener) == 1


def test_topics_of_one_hash_do_not_mix(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    from nros_backends.can import herald

    monkeypatch.setattr(herald, "SUBJECT_MAX", 0)  # every hash leads to subject 0
    first, second, ear = bench.session(), bench.session(), bench.session()
    left, right = publisher(first, "left"), publisher(second, "right")
    listeners = [subscription(ear, "left"), subscription(ear, "right")]
    bench.run()
    assert left.outlet.subject == right.outlet.subject == 0
    left.publish_raw(b"l")
    right.publish_raw(b"r")
    bench.run()
    assert [take(listener) for listener in listeners] == [[b"l"], [b"r"]]


def test_publishers_with_another_qos_have_another_subject(bench: Bench) -> None:
    session = bench.session()
    reliable, sloppy = publisher(session), publisher(session, reliability=Reliability.BEST_EFFORT)
    strict = subscription(bench.session())
    bench.run()
    assert reliable.outlet.subject != sloppy.outlet.subject
    reliable.publish_raw(b"reliable")
    sloppy.publish_raw(b"sloppy")
    bench.run()
    assert take(strict) == [b"reliable"]
    assert publisher(session).outlet is reliable.outlet


def test_a_lifespan_counts_from_reception(bench: Bench) -> None:
    talker, listener = publisher(bench.session(), lifespan_ms=20), subscription(bench.session())
    lost = Log().watch(listener, EventKind.MESSAGE_LOST)
    bench.run()
    talker.publish_raw(b"stale")
    bench.run(25)
    talker.publish_raw(b"fresh")
    bench.run(10)
    assert take(listener) == [b"fresh"]
    assert lost.total == 0


def test_a_sample_that_waits_for_a_drive_is_timed_when_it_came(bench: Bench) -> None:
    talker, listener = publisher(bench.session()), subscription(bench.session())
    missed = Log().watch(listener, EventKind.REQUESTED_DEADLINE_MISSED, 10)
    bench.run()
    talker.publish_raw(b"first")
    bench.run(1)
    sleeper = bench.driven.pop()
    for _ in range(9):  # every 8 ms, while nobody drives the subscription
        bench.run(8)
        talker.publish_raw(b"in time")
    sleeper.drive_io(0)
    assert missed.total == 0
    bench.clock.wait(None, bench.clock.now_ns() + 35 * MS)
    sleeper.drive_io(0)
    assert missed.total == 3


def test_deadlines_of_both_ends_count_every_period(bench: Bench) -> None:
    talker, listener = publisher(bench.session(), deadline_ms=10), subscription(bench.session(), deadline_ms=25)
    offered = Log().watch(talker, EventKind.OFFERED_DEADLINE_MISSED)
    requested = Log().watch(listener, EventKind.REQUESTED_DEADLINE_MISSED)
    bench.run(50)
    assert (offered.total, requested.total) == (0, 0), "not before the first sample"
    talker.publish_raw(b"one")
    bench.run(101)
    assert (offered.total, requested.total) == (10, 4)


def test_too_small_a_buffer_loses_one_sample_and_says_so(bench: Bench) -> None:
    talker, listener = publisher(bench.session()), subscription(bench.session())
    lost = Log().watch(listener, EventKind.MESSAGE_LOST)
    bench.run()
    talker.publish_raw(b"large")
    talker.publish_raw(b"ok")
    bench.run()
    assert listener.try_recv_raw(2) == ReturnCode.BUFFER_TOO_SMALL
    assert listener.try_recv_raw(2) == b"ok"
    assert listener.try_recv_raw(2) == ReturnCode.NO_DATA
    bench.run()
    assert lost.total == 1


def test_messages_are_called_back_once_each_and_only_while_they_wait(bench: Bench) -> None:
    talker, listener = publisher(bench.session()), subscription(bench.session(), depth=3)
    bench.run()
    called: list[object] = []
    assert listener.set_message_callback(called.append, "sample") == ReturnCode.OK
    for _ in range(5):
        talker.publish_raw(b"x")
    bench.run()
    assert called == ["sample"] * 3
    assert listener.set_message_callback(None, None) == ReturnCode.OK


def test_a_foreign_node_is_heard_on_a_fixed_subject_only() -> None:
    import can

    from nros_backends.can.frames import can_id, segment

    bench = Bench(subjects="topic=77")
    listener, other = (subscription(bench.session(), topic) for topic in ("topic", "other"))
    bench.run()
    bus = can.Bus(f"{bench.backend._buses._token} 0", interface="virtual")
    for subject in (77, 78):
        for number in (0, 1, 5):
            for frame in segment(b"from a foreign node", number, 8):
                bus.send(can.Message(arbitration_id=can_id(4, subject, 99), data=frame))
    bench.run()
    assert len(take(listener)) == 3
    assert listener.losses.total == 3
    assert take(other) == []
    bus.shutdown()
    bench.backend.close()


def test_manual_publishers_assert_by_publishing(bench: Bench) -> None:
    talker = publisher(bench.session(), liveliness=Liveliness.MANUAL_BY_TOPIC, lease_ms=100)
    lost = Log().watch(talker, EventKind.LIVELINESS_LOST)
    for _ in range(4):
        bench.run(60)
        assert talker.publish_raw(b"alive") == ReturnCode.OK
    assert lost.total == 0
    bench.run(102)
    assert lost.total == 1
