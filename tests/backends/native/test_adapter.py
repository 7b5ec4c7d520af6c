"""The adapter over the C example: calls, callbacks, structs, and what C cannot answer."""

from __future__ import annotations

import ctypes as ct
import gc
import weakref
from collections.abc import Iterator
from pathlib import Path

import pytest

from nros_backends.native import NativeBackend
from nros_backends.native.callbacks import Callbacks, Registration
from nros_backends.native.options import Options
from nros_backends.native.session import NativeSession
from nros_conformance.rmw.backend import Host, Session, SessionOptions
from nros_conformance.rmw.clock import MonotonicClock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import CountStatus, EventCallback, EventKind, EventStatus, LivelinessChangedStatus
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


class Watched:
    """A callback and context whose life can be watched."""

    def __init__(self) -> None:
        self.seen: list[object] = []

    def __call__(self, kind: int, status: EventStatus, context: object) -> None:
        self.seen.append(context)


def test_the_last_of_many_registrations_is_in_force_and_the_others_are_released(session: Session) -> None:
    subscription = session.create_subscription("/a", TYPE, QosProfile())
    callbacks = [Watched() for _ in range(100)]
    for callback in callbacks:
        assert subscription.register_event(0, 0, callback, callback) == 0
    lives = [weakref.ref(one) for one in callbacks]
    last = callbacks[-1]
    del callback, callbacks
    gc.collect()
    assert [one() for one in lives] == [None] * 99 + [last]
    session.create_publisher("/a", TYPE, QosProfile())
    session.drive_io(0)
    assert last.seen == [last]


@pytest.mark.parametrize("ends", ["entity", "session", "refused"])
def test_callback_and_context_are_released_with_their_entity(session: Session, ends: str) -> None:
    subscription = session.create_subscription("/a", TYPE, QosProfile())
    callback, context = Watched(), Watched()
    lives = [weakref.ref(callback), weakref.ref(context)]
    kind = 0 if ends != "refused" else 256
    assert subscription.register_event(kind, 0, callback, context) == (0 if ends != "refused" else -5)
    if ends != "refused":
        assert (session if ends == "session" else subscription).destroy() == ReturnCode.OK
    del callback, context
    gc.collect()
    assert [one() for one in lives] == [None, None]


def registered(callbacks: Callbacks, callback: EventCallback, context: object = None) -> Registration:
    return callbacks.make(int(EventKind.MESSAGE_LOST), callback, context)


def call(one: Registration, pointer: int | None = None) -> None:
    payload = (ct.c_uint32 * 2)(3, 1)
    one.function.pointer(
        int(EventKind.MESSAGE_LOST), ct.addressof(payload), one.pointer if pointer is None else pointer
    )


def test_a_call_after_the_release_is_told_to_who_wants_to_know(capsys: pytest.CaptureFixture[str]) -> None:
    seen: Seen = []

    class Telling(Watched):
        late = staticmethod(lambda kind, status, context: seen.append((kind, status, context)))

    callbacks = Callbacks()
    told, untold = registered(callbacks, Telling()), registered(callbacks, Watched())
    for one in (told, untold):
        callbacks.release(one)
    with callbacks.calls:
        call(told)
    assert seen == [(2, CountStatus(3, 1), "")]
    too_late = "the library called back, MessageLost, for an entity that is destroyed"
    with pytest.raises(RuntimeError, match=too_late), callbacks.calls:
        call(untold)
    function = told.function
    del told, one
    function.pointer(int(EventKind.MESSAGE_LOST), None, 16)
    assert capsys.readouterr().err == "the library called back, MessageLost, when its play was over\n"
    assert len(seen) == 1


def test_the_function_of_one_and_the_context_of_another_are_told_apart() -> None:
    callbacks = Callbacks()
    mine, other = Watched(), Watched()
    one, two = registered(callbacks, mine, "mine"), registered(callbacks, other, "other")
    call(one, two.pointer)
    call(one, 7)
    callbacks.release(two)
    call(one, two.pointer)
    assert mine.seen == ["other", "a context that nobody registered: 0x7", "a context that was released"]
    assert other.seen == []


def test_functions_are_used_again_after_a_rest() -> None:
    callbacks = Callbacks()
    late: list[object] = []
    before = registered(callbacks, Watched())
    before.late = lambda kind, status, context: late.append(context)
    callbacks.release(before)
    rests = 0
    while (again := registered(callbacks, later := Watched())).function is not before.function:
        callbacks.release(again)
        rests += 1
    assert (rests, again.pointer) == (64, before.pointer + 65 * 16)
    call(again, before.pointer)
    assert (late, later.seen) == ([""], [])


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
