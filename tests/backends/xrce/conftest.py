from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import pytest

from nros_backends.xrce.backend import XrceBackend
from nros_backends.xrce.publisher import XrcePublisher
from nros_backends.xrce.session import XrceSession
from nros_backends.xrce.subscription import XrceSubscription
from nros_conformance.rmw.backend import Host, SessionOptions
from nros_conformance.rmw.clock import MonotonicClock
from nros_conformance.rmw.qos import DEFAULT, QosProfile
from tests.ports import leased_ports

TYPE = "std_msgs/msg/String"


class Bench:
    """A backend with its agent, and short words for what tests do with it."""

    def __init__(self, **options: object) -> None:
        options.setdefault("ports", leased_ports())
        self.backend = XrceBackend(Host(clock=MonotonicClock(), **options))  # type: ignore[arg-type]
        self.agent = self.backend.environment()
        self.agent.start()

    def session(self, node: str = "node", lease_ms: int = 0, hard_ms: int = 0, domain: int = 0) -> XrceSession:
        session = self.backend.create_session(
            SessionOptions(
                node_name=node, locator=self.agent.endpoint(), domain_id=domain, connection_lease_ms=lease_ms,
                hard_liveliness_ms=hard_ms,
            )
        )  # fmt: skip
        assert isinstance(session, XrceSession)
        return session


def publisher(session: XrceSession, qos: QosProfile = DEFAULT, topic: str = "/topic") -> XrcePublisher:
    created = session.create_publisher(topic, TYPE, qos)
    assert isinstance(created, XrcePublisher)
    return created


def subscription(session: XrceSession, qos: QosProfile = DEFAULT, topic: str = "/topic") -> XrceSubscription:
    created = session.create_subscription(topic, TYPE, qos)
    assert isinstance(created, XrceSubscription)
    return created


def drive(*sessions: XrceSession, until: Callable[[], bool], limit_s: float = 10.0) -> bool:
    """Drive these in turn until it is so; whether it was, within a limit that only a failure reaches."""
    end = time.monotonic() + limit_s
    while not until():
        if time.monotonic() > end:
            return False
        for session in sessions:
            session.drive_io(1)
    return True


def drain(received: XrceSubscription) -> list[bytes]:
    taken = []
    while isinstance(sample := received.try_recv_raw(2**20), bytes):
        taken.append(sample)
    return taken


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.backend.close()
