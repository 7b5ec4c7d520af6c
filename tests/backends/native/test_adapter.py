"""The adapter over the C example: calls, callbacks, structs, and what C cannot answer."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from pathlib import Path

import pytest

from nros_backends.native import NativeBackend
from nros_backends.native.options import Options
from nros_backends.native.session import NativeSession
from nros_conformance.rmw.backend import Host, Session, SessionOptions
from nros_conformance.rmw.clock import MonotonicClock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import CountStatus, EventKind, EventStatus, LivelinessChangedStatus
from nros_conformance.rmw.qos import QosProfile
from tests.backends.native.compiling import Build

TYPE = "test_msgs/msg/Plain"
Seen = list[tuple[int, EventStatus, object]]


def backend(options: Options) -> NativeBackend:
    return NativeBackend(Host(clock=MonotonicClock(), options=options.texts()))


@pytest.fixture(params=["fresh", "stable"])
def session(request: pytest.FixtureRequest, loopback: Path) -> Iterator[Session]:
    options = Options(str(loopback), name="loopback", storage=request.param, supports=frozenset(range(5)))
    made = backend(options)
    yield made.create_session(SessionOptions())
    made.close()


def test_a_sample_passes_and_every_payload_is_read_as_its_kind_says(session: Session) -> None:
    seen: Seen = []
    subscription = session.create_subscription("/a", TYPE, QosProfile(depth=2))
    publisher = session.create_publisher("/a", TYPE, QosProfile())
    for kind in (EventKind.LIVELINESS_CHANGED, EventKind.MESSAGE_LOST):
        code = subscription.register_event(
            kind, 0, lambda kind, status, context: seen.append((kind, status, context)), kind.label
        )
        assert code == ReturnCode.OK
    assert [publisher.publish_raw(data) for data in (b"one", b"two", b"")] == [0, 0, 0]
    assert session.drive_io(0) == ReturnCode.OK
    assert sorted(seen) == [
        (0, LivelinessChangedStatus(1, 0, 1, 0), "LivelinessChanged"),
        (2, CountStatus(1, 1), "MessageLost"),
    ]
    assert subscription.has_data() is True
    assert [subscription.try_recv_raw(8) for _ in range(3)] == [b"two", b"", ReturnCode.NO_DATA]
    assert subscription.has_data() is False


def test_support_is_what_the_survey_found_and_belongs_to_a_side(session: Session) -> None:
    subscription = session.create_subscription("/a", TYPE, QosProfile())
    publisher = session.create_publisher("/a", TYPE, QosProfile())
    assert [subscription.supports_event(kind) for kind in (-1, 0, 1, 2, 3, 4, 5, 256)] == [
        False, True, True, True, False, False, False, False,
    ]  # fmt: skip
    assert [publisher.supports_event(kind) for kind in (-1, 0, 3, 4, 5)] == [False, False, True, True, False]


def test_what_a_callback_raises_comes_out_of_drive_io_after_the_others_have_run(session: Session) -> None:
    seen: list[object] = []
    first = session.create_subscription("/a", TYPE, QosProfile())
    second = session.create_subscription("/a", TYPE, QosProfile())
    session.create_publisher("/a", TYPE, QosProfile())

    def fails(kind: int, status: EventStatus, context: object) -> None:
        raise LookupError("as told")

    assert first.register_event(0, 0, fails, None) == 0
    assert second.register_event(0, 0, lambda *_: seen.append("second"), None) == 0
    with pytest.raises(LookupError, match="as told"):
        session.drive_io(0)
    assert seen == ["second"]
    assert session.drive_io(0) == ReturnCode.OK


def test_functions_and_contexts_outlive_their_registration(session: Session) -> None:
    seen: list[object] = []
    subscription = session.create_subscription("/a", TYPE, QosProfile())
    for number in range(100):
        subscription.register_event(0, 0, lambda kind, status, context: seen.append(context), f"context {number}")
    gc.collect()
    session.create_publisher("/a", TYPE, QosProfile())
    session.drive_io(0)
    assert seen == ["context 99"]


def test_destroyed_handles_are_refused_without_a_call(session: Session) -> None:
    subscription = session.create_subscription("/a", TYPE, QosProfile())
    publisher = session.create_publisher("/a", TYPE, QosProfile())
    assert session.destroy() == ReturnCode.OK  # takes its entities along
    refused = ReturnCode.INVALID_ARGUMENT
    assert [subscription.has_data(), subscription.try_recv_raw(9), subscription.destroy()] == [refused] * 3
    assert [publisher.publish_raw(b""), publisher.assert_liveliness(), publisher.destroy()] == [refused] * 3
    assert publisher.register_event(3, 0, lambda *_: None, None) == refused
    assert [session.drive_io(0), session.ping(1), session.destroy()] == [refused] * 3
    with pytest.raises(RmwError, match="the session is destroyed"):
        session.create_publisher("/a", TYPE, QosProfile())


def test_numbers_that_the_boundary_cannot_represent_are_refused(session: Session) -> None:
    publisher = session.create_publisher("/a", TYPE, QosProfile())
    assert publisher.register_event(2**31, 0, lambda *_: None, None) == ReturnCode.INVALID_ARGUMENT
    assert publisher.register_event(4, 2**32, lambda *_: None, None) == ReturnCode.INVALID_ARGUMENT
    assert publisher.register_event(4, 10, None, None) == ReturnCode.INVALID_ARGUMENT
    for topic, qos in (("/a\0b", QosProfile()), ("not a name", QosProfile())):
        with pytest.raises(RmwError, match="TOPIC_NAME_INVALID"):
            session.create_publisher(topic, TYPE, qos)
    with pytest.raises(RmwError, match="INVALID_ARGUMENT"):
        session.create_publisher("/a", TYPE, QosProfile(depth=65536))


def test_a_null_slot_is_unsupported(session: Session) -> None:
    assert session.ping(10, 3) == ReturnCode.UNSUPPORTED
    assert isinstance(session, NativeSession)
    slots = session.library.slots
    kept = {name: slots[name] for name in ("register_publisher_event", "assert_publisher_liveliness")}
    publisher = session.create_publisher("/a", TYPE, QosProfile())
    try:
        slots.update(dict.fromkeys(kept))
        assert publisher.register_event(3, 0, lambda *_: None, None) == ReturnCode.UNSUPPORTED
        assert publisher.assert_liveliness() == ReturnCode.UNSUPPORTED
    finally:
        slots.update(kept)


def test_what_the_boundary_cannot_carry_is_refused(loopback: Path) -> None:
    made = backend(Options(str(loopback), name="loopback"))
    for options in (SessionOptions(connection_lease_ms=1000), SessionOptions(hard_liveliness_ms=1000)):
        with pytest.raises(RmwError, match="knows neither connection lease nor hard liveliness"):
            made.create_session(options)
    assert list(made.versions()) == ["libloopback.so"]


def test_scenarios_played_together_have_domains_and_nodes_of_their_own(loopback: Path) -> None:
    options = Options(str(loopback), name="loopback", domain=10).texts()
    domains, nodes = [], []
    for network in (0, 1):
        made = NativeBackend(Host(clock=MonotonicClock(), network=network, options=options))
        for domain in (0, 1):
            session = made.create_session(SessionOptions(node_name="talker", domain_id=domain))
            assert isinstance(session, NativeSession)
            domains.append(session.domain)
            nodes.append(session.node_name)
        made.close()
    assert domains == [10, 11, 12, 13]
    assert nodes == ["talker_0", "talker_0", "talker_1", "talker_1"]


def test_a_topic_hook_is_asked_before_an_entity_is_created(loopback: Path, build: Build) -> None:
    host = str(build("host.c", name="host"))
    made = backend(Options(str(loopback), name="loopback", host_libraries=(host,), topic_hook="know_topic"))
    session = made.create_session(SessionOptions())
    session.create_publisher("/known", TYPE, QosProfile())
    with pytest.raises(RmwError, match=r"TOPIC_NAME_INVALID \(-7\): the topic hook answered TOPIC_NAME_INVALID"):
        session.create_publisher("/refused", TYPE, QosProfile())
    made.close()
