"""What a library is found to be, and the declaration that is drafted from it."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from nros_backends.native.draft import discovery_ms, draft
from nros_backends.native.options import Options
from nros_backends.native.survey import CRASHED, POLICIES, Answers
from nros_backends.native.surveyor import survey
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.declaration import Declaration, load_declaration
from nros_conformance.rmw.events import EventKind
from tests.backends.native.compiling import EXAMPLE, Build

ALL = Answers(
    name="mine", registered_by="its constructor", vtable="", null_slots=(),
    registering={kind.label: 0 for kind in EventKind}, creating=dict.fromkeys(POLICIES, 0), second_session=0,
    same_session=True, discovery_ms=30.0, ping=0, asserting=0,
)  # fmt: skip


def drafted(**answers: object) -> Declaration:
    return load_declaration(Path("mine.toml"), draft(msgspec.structs.replace(ALL, **answers), "libmine.so"))


def test_options_survive_the_way_to_a_worker() -> None:
    options = Options(
        "/lib.so", name="mine", locator="tcp/127.0.0.1:7447", mode="peer", domain=3, host_libraries=("/a.so", "/b.so"),
        topic_hook="know", storage="stable", supports=frozenset({1, 4}),
    )  # fmt: skip
    assert Options.read(options.texts()) == options
    assert Options.read({"library": "/lib.so"}) == Options("/lib.so")


def test_a_backend_with_a_registry_of_its_own_is_asked_for_its_vtable(build: Build) -> None:
    flags = ("-Wl,-Bsymbolic", f"-I{EXAMPLE}")
    answers, crashes = survey(Options(str(build("own_registry.c", name="own", flags=flags)), name="loopback"))
    assert (answers.registered_by, crashes) == ("a registry of its own", ())
    assert set(answers.registering.values()) == {0}


def test_what_answers_ok_is_claimed() -> None:
    declaration = drafted()
    assert set(declaration.claims().values()) == {"yes"}
    assert declaration.connection.ping == "round_trip"
    assert declaration.subject.kind == "compiled"
    assert (declaration.bounds.discovery.ns({}), declaration.bounds.sessions) == (150_000_000, 8)
    assert not declaration.behaviour.callback_cap


def test_what_is_null_refused_or_crashes_is_absent_with_its_reason() -> None:
    declaration = drafted(
        null_slots=("register_publisher_event", "ping_session"),
        registering={
            "LivelinessChanged": 0, "RequestedDeadlineMissed": int(ReturnCode.UNSUPPORTED), "MessageLost": CRASHED,
            "LivelinessLost": int(ReturnCode.UNSUPPORTED), "OfferedDeadlineMissed": int(ReturnCode.UNSUPPORTED),
        },
        creating=dict.fromkeys(POLICIES, int(ReturnCode.INCOMPATIBLE_QOS)),
        second_session=int(ReturnCode.ERROR), same_session=False, discovery_ms=None, ping=int(ReturnCode.UNSUPPORTED),
    )  # fmt: skip
    assert {label: event.because for label, event in declaration.events.items()} == {
        "LivelinessChanged": "",
        "RequestedDeadlineMissed": "register_subscription_event answers UNSUPPORTED",
        "MessageLost": "register_subscription_event crashes",
        "LivelinessLost": "the slot register_publisher_event is NULL",
        "OfferedDeadlineMissed": "the slot register_publisher_event is NULL",
    }
    assert not declaration.event(EventKind.LIVELINESS_LOST).manual
    assert declaration.connection.because == "the slot ping_session is NULL"
    assert (declaration.behaviour.two_sessions, declaration.bounds.sessions) == ("second_fails", 1)
    assert not declaration.behaviour.same_session_visible
    assert declaration.qos.unsupported == list(POLICIES)


@pytest.mark.parametrize(("measured", "bound"), [(1.0, 100), (30.0, 150), (900.0, 2000), (None, 2000)])
def test_discovery_is_bound_by_some_times_what_was_measured(measured: float | None, bound: int) -> None:
    assert discovery_ms(msgspec.structs.replace(ALL, discovery_ms=measured)) == bound
