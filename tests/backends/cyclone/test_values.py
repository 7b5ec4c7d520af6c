from __future__ import annotations

import dataclasses
import importlib
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pytest

from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.discovery import find_backend
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import DEFAULT, PROFILES, Liveliness, QosProfile

if TYPE_CHECKING:
    from nros_backends.cyclone.session import CycloneSession
    from tests.backends.cyclone.conftest import Stage

TYPE = "std_msgs/msg/String"


# Names and QoS


@pytest.mark.parametrize("name", ["t", "/t", "a/b_1", "/a/b/c", "_x", "x" * 200])
def test_portable_topic_names_are_taken(session: CycloneSession, name: str) -> None:
    assert session.create_publisher(name, TYPE, DEFAULT).topic == name


@pytest.mark.parametrize("name", ["", " ", "a b", "1a", "a//b", "a/", "a-b", "a.b", "ä", "a\0", "x" * 201, None, 7])
def test_other_topic_names_are_refused(session: CycloneSession, name: Any) -> None:
    for make in (session.create_publisher, session.create_subscription):
        with pytest.raises(RmwError) as caught:
            make(name, TYPE, DEFAULT)
        assert (caught.value.code, caught.value.detail) == (
            ReturnCode.TOPIC_NAME_INVALID,
            f"{name!r} is not a topic name",
        )


@pytest.mark.parametrize("name", ["", "a b", "/a", "a//b", None])
def test_type_names_that_are_none_are_refused(session: CycloneSession, name: Any) -> None:
    with pytest.raises(RmwError) as caught:
        session.create_publisher("t", name, DEFAULT)
    assert (caught.value.code, caught.value.detail) == (ReturnCode.TOPIC_NAME_INVALID, f"{name!r} is not a type name")


@pytest.mark.parametrize(
    ("changes", "code", "detail"),
    [
        ({"depth": 65_536}, ReturnCode.INVALID_ARGUMENT, "depth 65536 does not fit u16"),
        ({"depth": -1}, ReturnCode.INVALID_ARGUMENT, "depth -1 does not fit u16"),
        ({"deadline_ms": 2**32}, ReturnCode.INVALID_ARGUMENT, "deadline_ms 4294967296 does not fit u32"),
        ({"lifespan_ms": -1}, ReturnCode.INVALID_ARGUMENT, "lifespan_ms -1 does not fit u32"),
        ({"reliability": 2}, ReturnCode.INVALID_ARGUMENT, "2 is not a valid Reliability"),
        ({"liveliness": 4}, ReturnCode.INVALID_ARGUMENT, "4 is not a valid Liveliness"),
        ({"lease_ms": 99}, ReturnCode.INCOMPATIBLE_QOS, "lease 99 ms is below 100 ms"),
    ],
)
def test_qos_that_cannot_be_honoured_is_refused_and_creates_nothing(
    session: CycloneSession, changes: dict[str, Any], code: ReturnCode, detail: str
) -> None:
    for make in (session.create_publisher, session.create_subscription):
        with pytest.raises(RmwError) as caught:
            make("t", TYPE, dataclasses.replace(DEFAULT, **changes))
        assert (caught.value.code, caught.value.detail) == (code, detail)
    assert session._ends == ()
    session.create_publisher("t", "std_msgs/msg/Other", DEFAULT)  # the topic was not taken either


@pytest.mark.parametrize(
    "profile",
    [
        *PROFILES.values(),
        QosProfile(deadline_ms=1, lifespan_ms=1, lease_ms=100),
        QosProfile(deadline_ms=2**32 - 2, lifespan_ms=2**32 - 2, lease_ms=2**32 - 2, depth=65_535),
        QosProfile(deadline_ms=2**32 - 1, lifespan_ms=2**32 - 1, lease_ms=2**32 - 1),
        QosProfile(liveliness=Liveliness.NONE, lease_ms=1),
    ],
)
def test_what_is_accepted_is_in_force(session: CycloneSession, profile: QosProfile) -> None:
    assert session.create_publisher("t", TYPE, profile).qos == profile
    assert session.create_subscription("t", TYPE, profile).qos == profile


def test_a_depth_of_zero_becomes_one(session: CycloneSession) -> None:
    assert session.create_subscription("t", TYPE, QosProfile(depth=0)).qos == QosProfile(depth=1)


# Types


def test_another_type_on_a_known_topic_is_refused_at_creation(stage: Stage) -> None:
    publisher, subscription = stage.pair()
    for session in (stage.near, stage.far):
        for make in (session.create_publisher, session.create_subscription):
            with pytest.raises(RmwError) as caught:
                make("t", "std_msgs/msg/Other", DEFAULT)
            assert caught.value.code == ReturnCode.TOPIC_NAME_INVALID
            assert caught.value.detail == "topic 't' has the type 'std_msgs::msg::String'"
    publisher.destroy()
    subscription.destroy()

    def taken_over() -> bool:
        try:
            stage.near.create_publisher("t", "std_msgs/msg/Other", DEFAULT)
        except RmwError:
            return False
        return True

    stage.until(taken_over)  # as soon as it is known that nobody uses the topic any more


def test_another_type_that_was_not_known_at_creation_does_not_match(stage: Stage) -> None:
    stage.far.deafmute(deaf=True, mute=True)
    publisher = stage.publisher()
    other = stage.near.create_subscription("t", "std_msgs/msg/Other", DEFAULT)
    same = stage.near.create_subscription("control", TYPE, DEFAULT)
    counted: list[object] = []
    other.register_event(EventKind.LIVELINESS_CHANGED, 0, lambda *_: counted.append(1), None)
    control = stage.publisher(topic="control")
    stage.far.deafmute(deaf=False, mute=False)
    stage.match(control, same)
    publisher.publish_raw(b"x")
    stage.near.drive_io(20)
    assert not counted
    assert other.has_data() is False


def test_the_wire_format_is_the_cdr_of_the_idl_type() -> None:
    pytest.importorskip("cyclonedds", reason="the extra nros-conformance[cyclone] is not installed")
    from nros_backends.cyclone.envelope import decode, encode, sample_type

    made: Any = sample_type(TYPE)
    for payload in (b"", b"x", b"abcd", bytes(100)):
        values = (bytes(range(16)), 2**63 + 5, 77, 2**63 - 1, payload)
        wire = encode(*values)
        assert wire == made(*values).serialize().ljust(len(wire), b"\0")
        assert len(wire) % 4 == 0
        received = decode(wire)
        assert (
            received.publisher,
            received.number,
            received.sent_ns,
            received.expires_ns,
            received.payload,
        ) == values


@pytest.mark.parametrize("cut", [0, 3, 4, 40, 48, 51])
def test_malformed_wire_bytes_are_no_sample(cut: int) -> None:
    pytest.importorskip("cyclonedds", reason="the extra nros-conformance[cyclone] is not installed")
    from nros_backends.cyclone.envelope import decode, encode

    whole = encode(bytes(16), 1, 0, 0, b"four")
    assert decode(whole).payload == b"four"
    assert decode(whole[:cut]).payload is None
    assert decode(b"\x00\x07" + whole[2:]).payload is None


def test_types_are_made_once_and_differ_by_name() -> None:
    pytest.importorskip("cyclonedds", reason="the extra nros-conformance[cyclone] is not installed")
    from nros_backends.cyclone.envelope import sample_type

    assert sample_type("a/A") is sample_type("a/A")
    assert sample_type("a/A") is not sample_type("a/B")


# Matches


def test_a_match_that_appears_while_the_binding_lists_them_is_seen_the_next_time() -> None:
    pytest.importorskip("cyclonedds", reason="the extra nros-conformance[cyclone] is not installed")
    from nros_backends.cyclone.ends import handles_of

    def racing() -> list[int]:
        raise IndexError("invalid index")

    assert handles_of(racing) == []
    assert handles_of(lambda: [1, 2]) == [1, 2]


# Ports


def test_networks_and_domains_have_ports_of_their_own_while_the_lease_lasts() -> None:
    pytest.importorskip("cyclonedds", reason="the extra nros-conformance[cyclone] is not installed")
    from nros_backends.cyclone.network import Network

    ports = range(11_000, 12_000)
    places = [(number, domain) for number in range(60) for domain in (0, 1)]
    first = [next(Network(number, ports).port_candidates(domain)) for number, domain in places]
    assert len(set(first)) == 120
    assert all(port in ports and port + 1 in ports for port in first)
    assert len({Network(number, ports).external_id(domain) for number, domain in places}) == 120
    assert list(Network(500, range(7, 11)).port_candidates(0)) == [7, 9]  # shared: the external id tells them apart
    assert next(Network(0, range(0)).port_candidates(0)) == 7400


def test_a_taken_port_is_passed_over(stage: Stage) -> None:
    import socket

    from nros_backends.cyclone.network import Network

    place = Network(stage.backend.host.network, stage.backend.host.ports)
    candidates = list(place.port_candidates(1))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("", candidates[0]))
        one, other = stage.open_session(domain_id=1), stage.open_session(domain_id=1)
        stage.match(stage.publisher(one), stage.subscription(other))


def test_no_free_port_is_a_failed_connection() -> None:
    pytest.importorskip("cyclonedds", reason="the extra nros-conformance[cyclone] is not installed")
    import socket

    from nros_backends.cyclone import CycloneBackend
    from nros_conformance.rmw.backend import Host, SessionOptions
    from nros_conformance.rmw.clock import MonotonicClock

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("", 0))
        port = taken.getsockname()[1]
        backend = CycloneBackend(Host(MonotonicClock(), ports=range(port, port + 2)))
        with pytest.raises(RmwError) as caught:
            backend.create_session(SessionOptions())
    assert caught.value.code == ReturnCode.CONNECTION_FAILED


# Declaration and import


def test_the_declaration_is_valid_and_claims_all_five() -> None:
    found = find_backend("nros_backends.cyclone:CycloneBackend")
    assert found.error is None
    assert found.declaration is not None
    assert set(found.declaration.claims().values()) == {"yes"}
    assert all(known.link and known.versions == "==11.0.1" for known in found.declaration.known)
    assert found.unavailable() is None or "cyclonedds" not in sys.modules


def test_importing_the_package_imports_no_middleware() -> None:
    code = "import sys, nros_backends.cyclone; print('cyclonedds' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "False\n"


def test_without_the_middleware_the_class_cannot_be_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith(("cyclonedds", "nros_backends.cyclone."))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "cyclonedds", None)
    package = importlib.import_module("nros_backends.cyclone")
    with pytest.raises(ImportError, match="cyclonedds"):
        _ = package.CycloneBackend
    with pytest.raises(AttributeError, match="has no attribute 'Nothing'"):
        _ = package.Nothing


def test_the_version_of_the_middleware_is_told(stage: Stage) -> None:
    assert stage.backend.versions()["cyclonedds"].startswith("11.")
