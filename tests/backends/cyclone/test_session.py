from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from nros_conformance.rmw.backend import Entity, SessionOptions
from nros_conformance.rmw.clock import MS, MonotonicClock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.qos import DEFAULT

if TYPE_CHECKING:
    from nros_backends.cyclone.backend import CycloneBackend
    from nros_backends.cyclone.session import CycloneSession
    from tests.backends.cyclone.conftest import Stage

TYPE = "std_msgs/msg/String"


# Domains


def test_sessions_of_another_domain_or_network_do_not_meet(stage: Stage, clock: MonotonicClock) -> None:
    from nros_backends.cyclone import CycloneBackend
    from nros_conformance.rmw.backend import Host

    host = stage.backend.host
    other = CycloneBackend(Host(clock, network=host.network + 1_000_000, ports=host.ports[:2]))
    control = stage.subscription()
    strangers = [
        stage.open_session(domain_id=1).create_subscription("t", TYPE, DEFAULT),
        other.create_session(SessionOptions()).create_subscription("t", TYPE, DEFAULT),
    ]
    publisher = stage.publisher()
    stage.match(publisher, control)
    for stranger in strangers:
        assert stage.backend.await_matched(publisher, stranger, clock.now_ns() + 20 * MS) is False
    other.close()


def test_each_end_counts_those_it_knows(stage: Stage) -> None:
    publisher, near, far = stage.publisher(), stage.subscription(), stage.subscription()
    assert stage.backend.matched(stage.publisher(topic="lonely")) == 0
    stage.match(publisher, near)
    stage.match(publisher, far)
    assert (stage.backend.matched(publisher), stage.backend.matched(near)) == (2, 1)
    publisher.destroy()
    assert stage.backend.matched(publisher) == 0


def test_two_sessions_of_the_neighbour_domain_meet(stage: Stage) -> None:
    one, other = stage.open_session(domain_id=1), stage.open_session(domain_id=1)
    stage.match(stage.publisher(one), stage.subscription(other))


@pytest.mark.parametrize(
    ("options", "code", "detail"),
    [
        ({"node_name": ""}, ReturnCode.INVALID_ARGUMENT, "node '' in domain 0 cannot exist"),
        ({"domain_id": 2}, ReturnCode.INVALID_ARGUMENT, "node 'node' in domain 2 cannot exist"),
        ({"connection_lease_ms": -1}, ReturnCode.INVALID_ARGUMENT, "lease -1 ms is not 0 to an hour"),
        ({"locator": "udp/x"}, ReturnCode.INVALID_CONFIG, "locator 'udp/x': DDS discovers its peers"),
        (
            {"hard_liveliness_ms": 10_000},
            ReturnCode.INVALID_CONFIG,
            "hard liveliness: there is no agent that could check it",
        ),
    ],
)
def test_options_that_cannot_be_honoured_are_refused(
    backend: CycloneBackend, options: dict[str, Any], code: ReturnCode, detail: str
) -> None:
    with pytest.raises(RmwError) as caught:
        backend.create_session(SessionOptions(**options))
    assert (caught.value.code, caught.value.detail) == (code, detail)


# Registration


def test_support_is_what_registration_answers(stage: Stage) -> None:
    publisher, subscription = stage.publisher(), stage.subscription()
    supported = {publisher: {3, 4}, subscription: {0, 1, 2}}
    for entity, kinds in supported.items():
        assert isinstance(entity, Entity)
        for kind in (-1, 0, 1, 2, 3, 4, 5, 255, 256, 257, 2**31 - 1):
            expected = ReturnCode.OK if kind in kinds else ReturnCode.UNSUPPORTED
            assert entity.supports_event(kind) is (kind in kinds)
            assert entity.register_event(kind, 100, lambda *_: None, None) == expected
            if kind in kinds:
                assert entity.register_event(kind, 100, None, None) == ReturnCode.INVALID_ARGUMENT
                assert entity.register_event(kind, -1, lambda *_: None, None) == ReturnCode.INVALID_ARGUMENT
                assert entity.register_event(kind, 2**32, lambda *_: None, None) == ReturnCode.INVALID_ARGUMENT


def test_a_ping_is_not_supported(backend: CycloneBackend, session: CycloneSession) -> None:
    assert session.ping(10) == ReturnCode.UNSUPPORTED
    assert backend.ping(SessionOptions(), 10) == ReturnCode.UNSUPPORTED
