from __future__ import annotations

import dataclasses
import itertools
import os
import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, cast

import pytest

from nros_conformance.rmw.backend import Host, Publisher, SessionOptions, Subscription
from nros_conformance.rmw.clock import MS, MonotonicClock
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import EventKind, EventStatus
from nros_conformance.rmw.qos import DEFAULT
from tests.backends import log

if TYPE_CHECKING:
    from nros_backends.cyclone.backend import CycloneBackend
    from nros_backends.cyclone.publisher import CyclonePublisher
    from nros_backends.cyclone.session import CycloneSession
    from nros_backends.cyclone.subscription import CycloneSubscription

TYPE = "std_msgs/msg/String"
LONG = 30_000 * MS
"""Nothing here takes that long; a test that waits so long has failed."""

_numbers = itertools.count(os.getpid() * 64)


@pytest.fixture
def clock() -> MonotonicClock:
    return MonotonicClock()


@pytest.fixture
def host(clock: MonotonicClock) -> Host:
    # The external domain id follows from the number: nobody else on this host has it.
    return Host(clock, network=next(_numbers), ports=range(10_000, 10_400))


@pytest.fixture
def backend(host: Host) -> Iterator[CycloneBackend]:
    pytest.importorskip("cyclonedds", reason="the extra nros-conformance[cyclone] is not installed")
    from nros_backends.cyclone import CycloneBackend

    backend = CycloneBackend(host)
    yield backend
    backend.close()


@pytest.fixture
def open_session(backend: CycloneBackend) -> Callable[..., CycloneSession]:
    def open_session(**options: Any) -> CycloneSession:
        return cast("CycloneSession", backend.create_session(SessionOptions(**options)))

    return open_session


@pytest.fixture
def session(open_session: Callable[..., CycloneSession]) -> CycloneSession:
    return open_session()


@dataclasses.dataclass(frozen=True)
class Event:
    at: int
    kind: int
    status: EventStatus
    thread: int


class Log(log.Log):
    """What was called back, when, and on which thread."""

    def __init__(self, clock: MonotonicClock) -> None:
        super().__init__()
        self.clock = clock
        self.events: list[Event] = []

    def __call__(self, kind: int, status: EventStatus, context: object) -> None:
        super().__call__(kind, status, context)
        self.events.append(Event(self.clock.now_ns(), kind, status, threading.get_ident()))


class Driver:
    """A thread that drives a session until the test ends."""

    def __init__(self, session: CycloneSession) -> None:
        self.session = session
        self.codes: set[int] = set()
        self.error: BaseException | None = None
        self.stopped = False
        self.thread = threading.Thread(target=self._run)
        self.thread.start()

    def _run(self) -> None:
        try:
            while not self.stopped:
                self.codes.add(self.session.drive_io(10))
        except BaseException as error:
            self.error = error

    def stop(self) -> None:
        self.stopped = True
        self.thread.join()
        assert self.error is None
        assert self.codes <= {ReturnCode.OK}


@pytest.fixture
def driven() -> Iterator[Callable[[CycloneSession], Driver]]:
    drivers: list[Driver] = []

    def start(session: CycloneSession) -> Driver:
        drivers.append(Driver(session))
        return drivers[-1]

    yield start
    for driver in drivers:
        driver.stop()


class Stage:
    """Two sessions that meet on the network, each driven by a thread when `drive` is called."""

    def __init__(
        self,
        backend: CycloneBackend,
        clock: MonotonicClock,
        open_session: Callable[..., CycloneSession],
        driven: Callable[[CycloneSession], Driver],
    ) -> None:
        self.backend = backend
        self.clock = clock
        self.open_session = open_session
        self.driven = driven
        self.near = open_session(node_name="near")
        self.far = open_session(node_name="far")

    def publisher(self, session: CycloneSession | None = None, topic: str = "t", **qos: Any) -> CyclonePublisher:
        made = (session or self.far).create_publisher(topic, TYPE, dataclasses.replace(DEFAULT, **qos))
        return cast("CyclonePublisher", made)

    def subscription(self, session: CycloneSession | None = None, topic: str = "t", **qos: Any) -> CycloneSubscription:
        made = (session or self.near).create_subscription(topic, TYPE, dataclasses.replace(DEFAULT, **qos))
        return cast("CycloneSubscription", made)

    def pair(self, **qos: Any) -> tuple[CyclonePublisher, CycloneSubscription]:
        publisher, subscription = self.publisher(**qos), self.subscription(**qos)
        self.match(publisher, subscription)
        return publisher, subscription

    def match(self, publisher: Publisher, subscription: Subscription) -> None:
        assert self.backend.await_matched(publisher, subscription, self.clock.now_ns() + LONG)

    def drive(self) -> tuple[Driver, Driver]:
        return self.driven(self.near), self.driven(self.far)

    def log(self, entity: Publisher | Subscription, kind: EventKind, deadline_ms: int = 0) -> Log:
        return Log(self.clock).watch(entity, kind, deadline_ms)

    def until(self, condition: Callable[[], bool]) -> int:
        """Wait for it; the time at which it held."""
        limit = self.clock.now_ns() + LONG
        while not condition():
            assert self.clock.now_ns() < limit, "it never came"
            self.clock.wait(None, self.clock.now_ns() + MS)
        return self.clock.now_ns()

    def pause(self, duration_ms: int) -> None:
        """Let this much time pass, at least."""
        self.clock.wait(None, self.clock.now_ns() + duration_ms * MS)

    def take_all(self, subscription: Subscription) -> list[bytes]:
        """All samples that can be taken now."""
        taken = []
        while subscription.has_data() is True:
            sample = subscription.try_recv_raw(2**20)
            assert isinstance(sample, bytes)
            taken.append(sample)
        assert subscription.try_recv_raw(2**20) == ReturnCode.NO_DATA
        return taken

    def receive(self, subscription: CycloneSubscription, count: int) -> list[bytes]:
        """Drive in this thread until so many samples have been taken."""
        taken: list[bytes] = []
        limit = self.clock.now_ns() + LONG
        while len(taken) < count:
            assert self.clock.now_ns() < limit, f"only {len(taken)} of {count} came"
            subscription.session.drive_io(10)
            taken += self.take_all(subscription)
        return taken


@pytest.fixture
def stage(
    backend: CycloneBackend,
    clock: MonotonicClock,
    open_session: Callable[..., CycloneSession],
    driven: Callable[[CycloneSession], Driver],
) -> Stage:
    return Stage(backend, clock, open_session, driven)
