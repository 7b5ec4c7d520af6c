from __future__ import annotations

import dataclasses
import itertools
import os
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, cast

import pytest

from nros_conformance.rmw.backend import Host, SessionOptions, Subscription
from nros_conformance.rmw.clock import MS, VirtualClock
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.qos import DEFAULT, QosProfile

pytest.importorskip("can", reason="the extra nros-conformance[can] is not installed")

if TYPE_CHECKING:
    from nros_backends.can.backend import CanBackend
    from nros_backends.can.publisher import CanPublisher
    from nros_backends.can.session import CanSession
    from nros_backends.can.subscription import CanSubscription

TYPE = "std_msgs/msg/String"

_networks = itertools.count(os.getpid() * 16)


class Bench:
    """A bus in memory on a virtual clock, and sessions that are driven once a millisecond by `run`."""

    def __init__(self, **options: str) -> None:
        from nros_backends.can import CanBackend

        self.clock = VirtualClock()
        self.backend: CanBackend = CanBackend(Host(self.clock, network=next(_networks), options=options))
        self.driven: list[CanSession] = []

    def session(self, *, driven: bool = True, **options: Any) -> CanSession:
        session = cast("CanSession", self.backend.create_session(SessionOptions(**options)))
        if driven:
            self.driven.append(session)
        return session

    def run(self, ms: int = 2) -> None:
        for _ in range(ms):
            for session in self.driven:
                if not session.closed:
                    assert session.drive_io(0) == ReturnCode.OK
            self.clock.wait(None, self.clock.now_ns() + MS)


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.backend.close()


@pytest.fixture(params=["classic", "fd"])
def either(request: pytest.FixtureRequest) -> Iterator[Bench]:
    bench = Bench(fd="true" if request.param == "fd" else "false")
    yield bench
    bench.backend.close()


def publisher(session: CanSession, topic: str = "topic", qos: QosProfile = DEFAULT, **policies: Any) -> CanPublisher:
    return cast("CanPublisher", session.create_publisher(topic, TYPE, dataclasses.replace(qos, **policies)))


def subscription(
    session: CanSession, topic: str = "topic", qos: QosProfile = DEFAULT, **policies: Any
) -> CanSubscription:
    return cast("CanSubscription", session.create_subscription(topic, TYPE, dataclasses.replace(qos, **policies)))


def take(subscription: Subscription) -> list[bytes]:
    return list(_samples(lambda: subscription.try_recv_raw(65_536)))


def _samples(recv: Callable[[], bytes | int]) -> Iterator[bytes]:
    while isinstance(sample := recv(), bytes):
        yield sample
