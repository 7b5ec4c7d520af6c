from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import pytest

from nros_backends.uorb import UorbBackend
from nros_conformance.rmw.backend import Host, Publisher, Session, SessionOptions, Subscription
from nros_conformance.rmw.clock import VirtualClock
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import CountStatus, EventKind
from nros_conformance.rmw.qos import DEFAULT, QosProfile


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def backend(clock: VirtualClock) -> UorbBackend:
    return UorbBackend(Host(clock))


@pytest.fixture
def session(backend: UorbBackend) -> Session:
    return backend.create_session(SessionOptions())


@dataclasses.dataclass
class Talk:
    """A publisher, a subscription, and what was reported to it."""

    session: Session
    publisher: Publisher
    subscription: Subscription
    losses: list[CountStatus]
    sent: int = 0

    def publish(self, count: int, by: Publisher | None = None) -> None:
        for _ in range(count):
            assert (by or self.publisher).publish_raw(self.sent.to_bytes(4, "big")) == ReturnCode.OK
            self.sent += 1

    def take(self, count: int | None = None) -> list[int]:
        taken: list[int] = []
        while count is None or len(taken) < count:
            before = self.subscription.has_data()
            sample = self.subscription.try_recv_raw(100)
            assert before == isinstance(sample, bytes)
            if not isinstance(sample, bytes):
                assert sample == ReturnCode.NO_DATA
                break
            taken.append(int.from_bytes(sample, "big"))
        return taken

    def drive(self, timeout_ms: int = 0) -> None:
        assert self.session.drive_io(timeout_ms) == ReturnCode.OK

    @property
    def lost(self) -> int:
        changes = sum(status.total_count_change for status in self.losses)
        assert not self.losses or self.losses[-1].total_count == changes
        return changes


MakeTalk = Callable[..., Talk]


@pytest.fixture
def make_talk(session: Session) -> MakeTalk:
    def make(depth: int = 10, topic: str = "/sensor") -> Talk:
        qos = QosProfile(depth=depth)
        publisher = session.create_publisher(topic, "Sample", DEFAULT)
        subscription = session.create_subscription(topic, "Sample", qos)
        losses: list[CountStatus] = []

        def note(kind: int, status: Any, context: object) -> None:
            assert (kind, context) == (EventKind.MESSAGE_LOST, "mine")
            losses.append(status)

        assert subscription.register_event(2, 0, note, "mine") == ReturnCode.OK
        return Talk(session, publisher, subscription, losses)

    return make


@pytest.fixture
def talk(make_talk: MakeTalk) -> Talk:
    return make_talk()
