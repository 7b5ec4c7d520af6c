from __future__ import annotations

import gc
import threading
import weakref
from collections.abc import Callable
from typing import cast

import pytest

from nros_backends.can import CanBackend
from nros_backends.can.session import CanSession
from nros_conformance.rmw.backend import Host, SessionOptions
from nros_conformance.rmw.clock import MS, MonotonicClock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import DEFAULT, Durability, Liveliness, QosProfile
from tests.backends.can.conftest import TYPE, Bench, publisher, subscription
from tests.backends.log import Log


@pytest.mark.parametrize(
    ("options", "code", "text"),
    [
        (SessionOptions(node_name=""), ReturnCode.INVALID_ARGUMENT, "node '' in domain 0 cannot exist"),
        (SessionOptions(domain_id=2), ReturnCode.INVALID_ARGUMENT, "node 'node' in domain 2 cannot exist"),
        (
            SessionOptions(connection_lease_ms=99),
            ReturnCode.INVALID_ARGUMENT,
            "lease 99 ms is not 100 ms to an hour",
        ),
        (SessionOptions(locator="can0"), ReturnCode.INVALID_CONFIG, "locator 'can0': a bus has no address"),
        (
            SessionOptions(hard_liveliness_ms=1),
            ReturnCode.INVALID_CONFIG,
            "hard liveliness: there is no agent that could check it",
        ),
    ],
)
def test_options_that_cannot_be_honoured_are_refused(
    bench: Bench, options: SessionOptions, code: ReturnCode, text: str
) -> None:
    with pytest.raises(RmwError) as raised:
        bench.backend.create_session(options)
    assert (raised.value.code, raised.value.detail) == (code, text)


@pytest.mark.parametrize(
    ("qos", "code", "text"),
    [
        (
            QosProfile(durability=Durability.TRANSIENT_LOCAL),
            ReturnCode.INCOMPATIBLE_QOS,
            "transient-local: a bus has no history for one node",
        ),
        (QosProfile(lease_ms=99), ReturnCode.INCOMPATIBLE_QOS, "lease 99 ms is below 100 ms"),
        (QosProfile(depth=65_536), ReturnCode.INVALID_ARGUMENT, "depth 65536 does not fit u16"),
        (
            QosProfile(liveliness=cast(Liveliness, 9)),
            ReturnCode.INVALID_ARGUMENT,
            "9 is not a valid Liveliness",
        ),
    ],
)
def test_qos_that_cannot_be_honoured_is_refused(bench: Bench, qos: QosProfile, code: ReturnCode, text: str) -> None:
    session = bench.session()
    for create in (session.create_publisher, session.create_subscription):
        with pytest.raises(RmwError) as raised:
            create("topic", TYPE, qos)
        assert (raised.value.code, raised.value.detail) == (code, text)
    assert session.create_publisher("topic", TYPE, QosProfile(depth=0)).qos.depth == 1


@pytest.mark.parametrize("name", ["", "/", "1a", "a b", "a//b", "a/", "x" * 201])
def test_names_are_checked(bench: Bench, name: str) -> None:
    session = bench.session()
    with pytest.raises(RmwError) as raised:
        session.create_publisher(name, TYPE, DEFAULT)
    assert (raised.value.code, raised.value.detail) == (ReturnCode.TOPIC_NAME_INVALID, f"{name!r} is not a topic name")
    with pytest.raises(RmwError) as raised:
        session.create_subscription("topic", "a b", DEFAULT)
    assert raised.value.detail == "'a b' is not a type name"


def test_a_fixed_subject_carries_one_qos_at_a_time() -> None:
    bench = Bench(subjects="/topic=77")
    session = bench.session()
    first = publisher(session)
    assert first.outlet.subject == 77
    with pytest.raises(RmwError) as raised:
        publisher(session, deadline_ms=5)
    assert raised.value.code is ReturnCode.INCOMPATIBLE_QOS
    assert raised.value.detail == "subject 77, which is fixed, has a publisher with another QoS"
    first.publish_raw(b"")
    first.destroy()
    second = publisher(session, deadline_ms=5)
    assert (second.outlet.subject, second.outlet.count) == (77, 1)
    bench.backend.close()


def test_kinds_are_supported_on_their_own_side_only(bench: Bench) -> None:
    session = bench.session()
    talker, listener = publisher(session), subscription(session)
    log = Log()
    for kind in (*EventKind, -1, 5, 255):
        mine = kind in (*EventKind,) and EventKind(kind).side.value
        for entity, side in ((talker, "publisher"), (listener, "subscription")):
            expected = ReturnCode.OK if mine == side else ReturnCode.UNSUPPORTED
            assert entity.supports_event(kind) is (mine == side)
            assert entity.register_event(kind, 10, log, log) == expected
    assert listener.register_event(EventKind.MESSAGE_LOST, 0, None, None) == ReturnCode.INVALID_ARGUMENT
    assert talker.register_event(EventKind.OFFERED_DEADLINE_MISSED, 0, log, log) == ReturnCode.INCOMPATIBLE_QOS
    assert talker.register_event(EventKind.OFFERED_DEADLINE_MISSED, -1, log, log) == ReturnCode.INVALID_ARGUMENT


def test_what_is_destroyed_answers_invalid_argument(bench: Bench) -> None:
    session = bench.session()
    talker, listener = publisher(session), subscription(session)
    assert talker.destroy() == ReturnCode.OK
    assert session.destroy() == ReturnCode.OK
    log = Log()
    calls: list[Callable[[], object]] = [
        talker.destroy, listener.destroy, session.destroy, listener.has_data, talker.assert_liveliness,
        lambda: talker.publish_raw(b""), lambda: listener.try_recv_raw(1), lambda: session.drive_io(0),
        lambda: listener.register_event(0, 0, log, log), lambda: listener.set_message_callback(log, None),  # type: ignore[arg-type]
        lambda: session.ping(10), lambda: session.drive_io(0, -1),
    ]  # fmt: skip
    assert [call() for call in calls] == [ReturnCode.INVALID_ARGUMENT] * len(calls)
    assert not listener.supports_event(0)
    with pytest.raises(RmwError, match="the session is destroyed"):
        session.create_publisher("topic", TYPE, DEFAULT)


def test_there_is_no_ping(bench: Bench) -> None:
    assert bench.session().ping(10) == bench.backend.ping(SessionOptions(), 10) == ReturnCode.UNSUPPORTED


def test_callbacks_and_contexts_are_released(bench: Bench) -> None:
    listener = subscription(bench.session())
    log = Log().watch(listener, EventKind.MESSAGE_LOST)
    listener.set_message_callback(lambda context: None, log)
    gone = weakref.ref(log)
    listener.destroy()
    del log
    gc.collect()
    assert gone() is None


def test_a_callback_may_destroy_its_own_session(bench: Bench) -> None:
    session = bench.session()
    listener = subscription(session)
    publisher(bench.session())
    inside: list[int] = []

    def on_event(kind: int, status: object, context: object) -> None:
        inside.append(session.drive_io(0))
        inside.append(session.destroy())

    listener.register_event(EventKind.LIVELINESS_CHANGED, 0, on_event, None)
    bench.run(5)
    assert inside == [ReturnCode.WOULD_BLOCK, ReturnCode.OK]


# On the real clock.


@pytest.fixture
def real() -> CanBackend:
    return CanBackend(Host(MonotonicClock()))


def opened(backend: CanBackend) -> CanSession:
    return cast(CanSession, backend.create_session(SessionOptions()))


def test_an_idle_drive_waits_and_heartbeats_do_not_end_it(real: CanBackend) -> None:
    session, other = opened(real), opened(real)
    begin = real.host.clock.now_ns()
    driver = threading.Thread(target=other.drive_io, args=(260,))
    driver.start()
    assert session.drive_io(250) == ReturnCode.OK
    assert real.host.clock.now_ns() - begin >= 250 * MS
    driver.join()
    assert other.node in session.directory.peers
    real.close()


def test_a_sample_ends_the_wait(real: CanBackend) -> None:
    session, other = opened(real), opened(real)
    talker, listener = publisher(other), subscription(session)
    for _ in range(2):
        session.drive_io(0)
        other.drive_io(0)
    threading.Timer(0.02, talker.publish_raw, (b"now",)).start()
    begin = real.host.clock.now_ns()
    assert session.drive_io(20_000) == ReturnCode.OK
    assert listener.try_recv_raw(10) == b"now"
    assert real.host.clock.now_ns() - begin < 10_000 * MS
    real.close()


def test_a_deadline_that_falls_due_in_a_drive_is_called_back_in_it(real: CanBackend) -> None:
    session = opened(real)
    talker = publisher(session)
    log = Log().watch(talker, EventKind.OFFERED_DEADLINE_MISSED, 30)
    talker.publish_raw(b"")
    session.drive_io(5_000)
    assert log.total >= 1
    real.close()


def test_closing_from_another_thread_ends_the_drive(real: CanBackend) -> None:
    session = opened(real)
    answers: list[int] = []
    driver = threading.Thread(target=lambda: answers.append(session.drive_io(60_000)))
    driver.start()
    while not session._driving.under_way:
        pass
    assert session.drive_io(0) == ReturnCode.WOULD_BLOCK
    assert session.destroy() == ReturnCode.OK
    driver.join(10)
    assert answers == [ReturnCode.OK]
    real.close()


def test_sessions_come_and_go_without_leaving_a_thread(real: CanBackend) -> None:
    threads = threading.active_count()
    keeper = opened(real)
    listener = subscription(keeper)
    for _ in range(150):  # more than there are node ids
        session = opened(real)
        talker = publisher(session)
        keeper.drive_io(0)
        session.drive_io(0)
        assert talker.publish_raw(b"hello") == ReturnCode.OK
        keeper.drive_io(0)
        assert listener.try_recv_raw(10) == b"hello"
        assert session.destroy() == ReturnCode.OK
        assert threading.active_count() == threads
    assert real.versions().keys() == {"python-can"}
    real.close()
