from __future__ import annotations

import dataclasses
import importlib.util
import itertools
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import pytest

from nros_conformance.rmw.backend import Host, SessionOptions
from nros_conformance.rmw.clock import MS, MonotonicClock
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import EventStatus
from nros_conformance.rmw.qos import DEFAULT
from tests.ports import leased_ports

if TYPE_CHECKING:
    from nros_backends.zenoh.backend import ZenohBackend
    from nros_backends.zenoh.ends import End
    from nros_backends.zenoh.publisher import ZenohPublisher
    from nros_backends.zenoh.session import ZenohSession
    from nros_backends.zenoh.subscription import ZenohSubscription

if importlib.util.find_spec("zenoh") is None or importlib.util.find_spec("xxhash") is None:
    collect_ignore_glob = ["test_*.py"]  # the extra nros-conformance[zenoh] is not installed

TYPE = "std_msgs/msg/String"
LONG = 30_000 * MS
"""Nothing here takes that long; a test that waits so long has failed."""

_numbers = itertools.count(os.getpid() * 64)


class Log:
    """What was called back, when, and on which thread."""

    def __init__(self, clock: MonotonicClock) -> None:
        self.clock = clock
        self.times: list[int] = []
        self.statuses: list[EventStatus] = []
        self.threads: set[int] = set()

    def __call__(self, kind: int, status: EventStatus, context: object) -> None:
        assert context is self
        self.times.append(self.clock.now_ns())
        self.statuses.append(status)
        self.threads.add(threading.get_ident())

    @property
    def last(self) -> int:
        """The last total, respectively alive_count."""
        return self.statuses[-1][0] if self.statuses else 0


class Stage:
    """A backend and its sessions, driven by the test's own thread."""

    def __init__(self, backend: ZenohBackend, clock: MonotonicClock) -> None:
        self.backend = backend
        self.clock = clock
        self.sessions: list[ZenohSession] = []

    def open(self, **options: Any) -> ZenohSession:
        session = cast("ZenohSession", self.backend.create_session(SessionOptions(**options)))
        self.sessions.append(session)
        return session

    def pair(self, **qos: Any) -> tuple[ZenohPublisher, ZenohSubscription]:
        """A publisher and a subscription, in sessions of their own, that know each other."""
        subscription, publisher = self.subscription(self.open(), **qos), self.publisher(self.open(), **qos)
        self.match(publisher, subscription)
        return publisher, subscription

    def publisher(self, session: ZenohSession, topic: str = "t", **qos: Any) -> ZenohPublisher:
        return cast("ZenohPublisher", session.create_publisher(topic, TYPE, dataclasses.replace(DEFAULT, **qos)))

    def subscription(self, session: ZenohSession, topic: str = "t", **qos: Any) -> ZenohSubscription:
        return cast("ZenohSubscription", session.create_subscription(topic, TYPE, dataclasses.replace(DEFAULT, **qos)))

    def match(self, publisher: ZenohPublisher, subscription: ZenohSubscription) -> None:
        assert self.backend.await_matched(publisher, subscription, self.clock.now_ns() + LONG)

    def log(self, end: End, kind: int, deadline_ms: int = 0) -> Log:
        log = Log(self.clock)
        assert end.register_event(kind, deadline_ms, log, log) == ReturnCode.OK
        return log

    def drive(self, duration_ms: int) -> None:
        """All sessions, for so long."""
        end = self.clock.now_ns() + duration_ms * MS
        while self.clock.now_ns() < end:
            for session in self.sessions:
                session.drive_io(1)

    def until(self, condition: Callable[[], object]) -> int:
        """Drive until it holds; when it did."""
        limit = self.clock.now_ns() + LONG
        while not condition():
            assert self.clock.now_ns() < limit, "it never came"
            for session in self.sessions:
                session.drive_io(1)
        return self.clock.now_ns()

    def receive(self, subscription: ZenohSubscription, count: int) -> list[bytes]:
        """So many samples."""
        taken: list[bytes] = []

        def enough() -> bool:
            while isinstance(sample := subscription.try_recv_raw(2**20), bytes):
                taken.append(sample)
            return len(taken) >= count

        self.until(enough)
        return taken


@pytest.fixture
def clock() -> MonotonicClock:
    return MonotonicClock()


@pytest.fixture
def make_stage(clock: MonotonicClock, tmp_path: Path) -> Iterator[Callable[..., Stage]]:
    from nros_backends.zenoh.backend import ZenohBackend

    made: list[Stage] = []

    def make_stage(variant: str = "peer", *faults: str, **host: Any) -> Stage:
        host.setdefault("ports", leased_ports())
        backend = ZenohBackend(Host(clock, variant, next(_numbers), scratch=tmp_path, faults=frozenset(faults), **host))
        made.append(Stage(backend, clock))
        return made[-1]

    yield make_stage
    for stage in made:
        stage.backend.close()
    assert [thread.name for thread in threading.enumerate() if thread.name.startswith("zenoh")] == []


@pytest.fixture(params=["peer", "router"])
def stage(make_stage: Callable[..., Stage], request: pytest.FixtureRequest) -> Stage:
    return make_stage(request.param)


@pytest.fixture
def peers(make_stage: Callable[..., Stage]) -> Stage:
    return make_stage("peer")
