from __future__ import annotations

import gc
import itertools
import weakref
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import nros_backends.uorb
from nros_backends.uorb import UorbBackend
from nros_conformance.rmw.backend import Entity, Host, Session, SessionOptions
from nros_conformance.rmw.clock import VirtualClock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.declaration import load_declaration
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import DEFAULT, INFINITE_MS, Durability, History, Liveliness, QosProfile, Reliability

if TYPE_CHECKING:
    from tests.backends.uorb.conftest import MakeTalk, Talk


def _nothing(*_: Any) -> None:
    pass


def _entities(session: Session) -> dict[str, Entity]:
    return {
        "publisher": session.create_publisher("/t", "T", DEFAULT),
        "subscription": session.create_subscription("/t", "T", DEFAULT),
    }


@pytest.mark.parametrize("side", ["publisher", "subscription"])
@pytest.mark.parametrize("kind", [*range(5), -1, 5, 255, 256, 257, 65536, 2**31 - 1])
def test_only_message_lost_on_a_subscription_is_supported(session: Session, side: str, kind: int) -> None:
    entity = _entities(session)[side]
    supported = (side, kind) == ("subscription", EventKind.MESSAGE_LOST)
    assert entity.supports_event(kind) is supported
    code = entity.register_event(kind, 15, _nothing, None)
    assert code == (ReturnCode.OK if supported else ReturnCode.UNSUPPORTED)


def test_the_declaration_claims_what_is_supported(session: Session) -> None:
    declaration = load_declaration(Path(nros_backends.uorb.__file__).parent / "backend.toml")
    entities = _entities(session)
    for kind, claim in zip(EventKind, declaration.claims().values(), strict=True):
        assert entities[kind.side.value].supports_event(kind) == (claim != "no")
    assert declaration.subject.kind == "model"
    assert declaration.behaviour.clock == "virtual"
    assert declaration.event(EventKind.MESSAGE_LOST).sources == ["overflow"]
    assert {kind.label: declaration.event(kind).absent for kind in EventKind} == {
        "LivelinessChanged": "never",
        "RequestedDeadlineMissed": "not-wired",
        "MessageLost": None,
        "LivelinessLost": "never",
        "OfferedDeadlineMissed": "not-wired",
    }


def test_a_missing_callback_is_refused_and_the_earlier_registration_survives(talk: Talk) -> None:
    assert talk.subscription.register_event(2, 0, None, None) == ReturnCode.INVALID_ARGUMENT
    talk.publish(11)
    talk.drive()
    assert talk.lost == 1


REFUSED = [
    (
        QosProfile(durability=Durability.TRANSIENT_LOCAL),
        "durability TRANSIENT_LOCAL: a late subscription finds one sample, whatever the depth",
    ),
    (QosProfile(history=History.KEEP_ALL), "history KEEP_ALL: the queue of a topic has a fixed length"),
    (QosProfile(depth=129), "depth 129: the queue of a topic holds 128 samples"),
    (QosProfile(deadline_ms=15), "deadline 15 ms: the bus has no rate"),
    (QosProfile(lifespan_ms=100), "lifespan 100 ms: samples do not expire"),
    (QosProfile(liveliness=Liveliness.MANUAL_BY_TOPIC), "liveliness MANUAL_BY_TOPIC: the bus has no liveliness"),
    (QosProfile(liveliness=Liveliness.MANUAL_BY_NODE), "liveliness MANUAL_BY_NODE: the bus has no liveliness"),
    (QosProfile(lease_ms=100), "lease 100 ms: the bus has no liveliness"),
]


@pytest.mark.parametrize("side", ["create_publisher", "create_subscription"])
@pytest.mark.parametrize(("qos", "reason"), REFUSED)
def test_a_policy_that_the_bus_lacks_is_refused(session: Session, side: str, qos: QosProfile, reason: str) -> None:
    with pytest.raises(RmwError) as error:
        getattr(session, side)("/t", "T", qos)
    assert str(error.value) == f"INCOMPATIBLE_QOS (-6): {reason}"


@pytest.mark.parametrize("field", [{"depth": 65536}, {"deadline_ms": 2**32}, {"lease_ms": -1}])
def test_a_value_beyond_the_abi_is_an_invalid_argument(session: Session, field: dict[str, int]) -> None:
    with pytest.raises(RmwError, match=r"^INVALID_ARGUMENT"):
        session.create_publisher("/t", "T", QosProfile(**field))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "qos",
    [
        QosProfile(depth=128, reliability=Reliability.BEST_EFFORT, liveliness=Liveliness.NONE),
        QosProfile(deadline_ms=INFINITE_MS, lifespan_ms=INFINITE_MS, lease_ms=INFINITE_MS),
    ],
)
def test_what_asks_for_no_check_is_in_force_as_it_is(session: Session, qos: QosProfile) -> None:
    assert session.create_publisher("/t", "T", qos).qos == qos
    assert session.create_subscription("/t", "T", qos).qos == qos


def test_depth_0_becomes_the_default_queue_length_of_px4(make_talk: MakeTalk) -> None:
    talk = make_talk(depth=0)
    assert talk.subscription.qos.depth == 1
    talk.publish(2)
    assert talk.take() == [1]


@pytest.mark.parametrize("name", ["", "/", "a//b", "/a/", "1a", "a b", "/a/2b", "ä", "~/a", "a" * 256])
def test_what_is_no_topic_name_is_refused(session: Session, name: str) -> None:
    with pytest.raises(RmwError) as error:
        session.create_subscription(name, "T", DEFAULT)
    assert str(error.value) == f"TOPIC_NAME_INVALID (-7): {name!r} is not a topic name"


@pytest.mark.parametrize("name", ["a", "/a", "/fleet_1/Robot2/odom", "_x"])
def test_topic_names_of_ros_2_are_accepted(session: Session, name: str) -> None:
    assert session.create_publisher(name, "T", DEFAULT).topic == name


def test_a_topic_has_one_type(session: Session) -> None:
    session.create_publisher("/t", "T", DEFAULT)
    with pytest.raises(RmwError) as error:
        session.create_subscription("/t", "U", DEFAULT)
    assert str(error.value) == "TOPIC_NAME_INVALID (-7): topic '/t' has the type 'T', not 'U'"
    with pytest.raises(RmwError) as error:
        session.create_subscription("/t", "", DEFAULT)
    assert str(error.value) == "INVALID_ARGUMENT (-4): '' is not a type name"


def test_a_failed_create_leaves_nothing_behind(session: Session, talk: Talk) -> None:
    for _ in range(200):
        with pytest.raises(RmwError):
            session.create_publisher("/t", "Wrong", QosProfile(lifespan_ms=1))
    session.create_publisher("/t", "T", DEFAULT)  # the failed ones have bound no type
    talk.publish(10)
    talk.drive()
    assert talk.take() == list(range(10))
    assert talk.losses == []


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (SessionOptions(node_name=""), "INVALID_ARGUMENT (-4): node '' in domain 0 cannot exist"),
        (SessionOptions(domain_id=-1), "INVALID_ARGUMENT (-4): node 'node' in domain -1 cannot exist"),
        (SessionOptions(locator="udp/1"), "INVALID_CONFIG (-19): locator 'udp/1': the bus has no address"),
        (
            SessionOptions(hard_liveliness_ms=9),
            "INVALID_CONFIG (-19): hard liveliness: there is no agent that could check it",
        ),
    ],
)
def test_a_session_that_cannot_be_is_refused(backend: UorbBackend, options: SessionOptions, text: str) -> None:
    with pytest.raises(RmwError) as error:
        backend.create_session(options)
    assert str(error.value) == text


def test_sessions_of_one_domain_share_a_bus_and_other_domains_have_their_own(
    backend: UorbBackend, session: Session
) -> None:
    publisher = session.create_publisher("/t", "T", DEFAULT)
    same = backend.create_session(SessionOptions()).create_subscription("/t", "T", DEFAULT)
    other = backend.create_session(SessionOptions(domain_id=1)).create_subscription("/t", "T", DEFAULT)
    stranger = UorbBackend(backend.host).create_session(SessionOptions()).create_subscription("/t", "T", DEFAULT)
    publisher.publish_raw(b"a")
    assert [found.has_data() for found in (same, other, stranger)] == [True, False, False]
    assert [backend.await_matched(publisher, found, 0) for found in (same, other, stranger)] == [True, False, False]


@pytest.mark.parametrize("size", [0, 1, 1000, 65533])
def test_a_sample_of_any_size_up_to_the_slot_arrives_as_it_was(session: Session, size: int) -> None:
    publisher = session.create_publisher("/t", "T", DEFAULT)
    subscription = session.create_subscription("/t", "T", DEFAULT)
    sample = bytes(range(256)) * 256
    assert publisher.publish_raw(sample[:size]) == ReturnCode.OK
    assert subscription.has_data() is True
    assert subscription.try_recv_raw(size) == sample[:size]
    assert subscription.try_recv_raw(size) == ReturnCode.NO_DATA


def test_a_sample_above_the_slot_is_refused_and_the_next_one_arrives(talk: Talk) -> None:
    assert talk.publisher.publish_raw(bytes(65534)) == ReturnCode.MESSAGE_TOO_LARGE
    talk.publish(1)
    assert talk.take() == [0]
    talk.drive()
    assert talk.losses == []


def test_what_is_sent_is_copied(session: Session) -> None:
    publisher = session.create_publisher("/t", "T", DEFAULT)
    subscription = session.create_subscription("/t", "T", DEFAULT)
    buffer = bytearray(b"abc")
    publisher.publish_raw(buffer)  # type: ignore[arg-type]
    buffer[:] = b"xyz"
    assert subscription.try_recv_raw(3) == b"abc"


@pytest.mark.parametrize("how", ["entities", "session", "backend"])
def test_stale_handles_answer_invalid_argument(backend: UorbBackend, talk: Talk, how: str) -> None:
    if how == "entities":
        talk.publisher.destroy()
        talk.subscription.destroy()
    elif how == "session":
        talk.session.destroy()
    else:
        backend.close()
    invalid = ReturnCode.INVALID_ARGUMENT
    assert talk.publisher.publish_raw(b"") == invalid
    assert talk.publisher.assert_liveliness() == invalid
    assert talk.publisher.register_event(4, 10, _nothing, None) == invalid
    assert talk.subscription.has_data() == invalid
    assert talk.subscription.try_recv_raw(10) == invalid
    assert talk.subscription.register_event(2, 0, _nothing, None) == invalid
    assert talk.subscription.set_message_callback(_nothing, None) == invalid
    assert not talk.subscription.supports_event(2)
    assert backend.preset(talk.publisher, 0) == backend.preset(talk.subscription, 0) == invalid
    if how != "entities":
        assert talk.session.drive_io(0) == talk.session.ping(10) == invalid
        with pytest.raises(RmwError, match=r"^INVALID_ARGUMENT \(-4\): the session is destroyed$"):
            talk.session.create_publisher("/t", "T", DEFAULT)


def test_arguments_out_of_range_answer_invalid_argument(backend: UorbBackend, talk: Talk) -> None:
    wrong: Any = None
    invalid = ReturnCode.INVALID_ARGUMENT
    assert talk.publisher.publish_raw(wrong) == talk.publisher.publish_raw("text") == invalid  # type: ignore[arg-type]
    assert talk.subscription.try_recv_raw(-1) == talk.subscription.try_recv_raw(wrong) == invalid
    assert talk.session.drive_io(wrong) == talk.session.drive_io(0, -1) == invalid
    assert talk.session.drive_io(0, "all") == invalid  # type: ignore[arg-type]
    assert backend.preset(talk.publisher, 2**32) == backend.preset(talk.publisher, -1) == invalid
    assert backend.preset(wrong, 0) == invalid


def test_there_is_no_peer_to_ping(backend: UorbBackend, session: Session) -> None:
    assert session.ping(100) == ReturnCode.UNSUPPORTED
    assert backend.ping(SessionOptions(), 100) == ReturnCode.UNSUPPORTED


def test_automatic_and_none_assert_without_effect(session: Session) -> None:
    for liveliness in (Liveliness.NONE, Liveliness.AUTOMATIC):
        publisher = session.create_publisher("/t", "T", QosProfile(liveliness=liveliness))
        assert publisher.assert_liveliness() == ReturnCode.OK


@pytest.mark.parametrize("order", list(itertools.permutations(["publisher", "subscription", "session"])))
def test_destroying_in_any_order_and_twice_is_harmless_and_silent(talk: Talk, order: tuple[str, ...]) -> None:
    talk.publish(15)  # an event is pending
    for name in order:
        assert [getattr(talk, name).destroy(), getattr(talk, name).destroy()] == [ReturnCode.OK] * 2
    assert talk.session.drive_io(0) == ReturnCode.INVALID_ARGUMENT
    assert talk.losses == []


def test_a_destroyed_subscription_reports_nothing_any_more(talk: Talk) -> None:
    talk.publish(15)
    assert talk.subscription.destroy() == ReturnCode.OK
    talk.publish(15)
    talk.drive(50)
    assert talk.losses == []


def test_callback_and_context_are_released_with_the_entity(session: Session) -> None:
    class Context:
        def called(self, *_: object) -> None:
            pass

    subscription = session.create_subscription("/t", "T", DEFAULT)
    publisher = session.create_publisher("/t", "T", DEFAULT)
    first, second, third = Context(), Context(), Context()
    dead = [weakref.ref(first), weakref.ref(second), weakref.ref(third)]
    subscription.register_event(2, 0, first.called, first)
    subscription.register_event(2, 0, second.called, second)
    subscription.set_message_callback(third.called, third)
    for _ in range(20):
        publisher.publish_raw(b"")
    session.drive_io(0, 1)  # some of them stay queued
    del first, second, third
    gc.collect()
    assert [ref() is None for ref in dead] == [True, False, False]
    subscription.destroy()
    gc.collect()
    assert [ref() for ref in dead] == [None] * 3


def test_a_thousand_entities_later_nothing_is_left_and_events_still_work(make_talk: MakeTalk) -> None:
    first = make_talk(depth=1)
    for _ in range(1000):
        talk = make_talk(depth=1)
        talk.publisher.destroy()
        talk.subscription.destroy()
    node: Any = first.subscription.node  # type: ignore[attr-defined]
    assert len(node.callbacks) == len(node.subscriptions) == 1
    last = make_talk(depth=1)
    last.publish(3)
    last.drive()
    assert (first.lost, last.lost) == (2, 2)


def test_a_destroyed_session_leaves_nothing_behind() -> None:
    backend = UorbBackend(Host(VirtualClock()))
    sessions = []
    for _ in range(100):
        session = backend.create_session(SessionOptions())
        session.create_subscription("/t", "T", DEFAULT)
        session.destroy()
        sessions.append(weakref.ref(session))
    del session
    gc.collect()
    assert [ref() for ref in sessions] == [None] * 100


def test_the_report_names_the_px4_version_that_is_modelled(backend: UorbBackend) -> None:
    assert backend.versions() == {"PX4 uORB (model)": "0148665"}
