from __future__ import annotations

import itertools
from collections.abc import Iterator
from datetime import timedelta

import pytest

from nros_backends.reference import ReferenceBackend
from nros_conformance.node import Context, LinkState, Node, Pace, Reconnector, Transition
from nros_conformance.node.reconnection import StateMachine
from nros_conformance.rmw.backend import Host, SessionOptions
from nros_conformance.rmw.clock import MS, VirtualClock
from nros_conformance.rmw.codes import ReturnCode, RmwError

PACE = Pace(timedelta(milliseconds=100), 2, waiting=timedelta(milliseconds=300), connected=timedelta(milliseconds=200))
WAITING, AVAILABLE, CONNECTED, DISCONNECTED = LinkState


class Surroundings:
    """Answers what it is told to, and writes down what it is asked."""

    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.told: list[Transition] = []
        self.asked: list[tuple[str, int]] = []
        self.probe_code: int = ReturnCode.OK
        self.check_code: int = ReturnCode.OK
        self.spin_code: int = ReturnCode.OK
        self.create_fails = False
        self.destroy_fails = False
        self.machine = StateMachine(self, self.clock, PACE, self.told.append)

    def note(self, what: str) -> None:
        self.asked.append((what, (self.clock.now_ns() - 10_000 * MS) // MS))

    def probe(self, timeout_ms: int, attempts: int) -> int:
        self.note(f"probe {timeout_ms} x {attempts}")
        return self.probe_code

    def create(self) -> None:
        self.note("create")
        if self.create_fails:
            raise RmwError(ReturnCode.CONNECTION_FAILED, "no answer")

    def spin(self, timeout_ms: int) -> int:
        self.clock.wait(None, self.clock.now_ns() + timeout_ms * MS)
        return self.spin_code

    def check(self, timeout_ms: int, attempts: int) -> int:
        self.note(f"check {timeout_ms} x {attempts}")
        return self.check_code

    def destroy(self) -> None:
        self.note("destroy")
        if self.destroy_fails:
            raise RmwError(ReturnCode.TIMEOUT, "destroying")

    def states(self) -> list[LinkState]:
        return [one.state for one in self.told]


@pytest.fixture
def around() -> Surroundings:
    return Surroundings()


def connected(around: Surroundings) -> Surroundings:
    around.machine.step()
    around.machine.step()
    assert around.machine.state is CONNECTED
    around.told.clear()
    around.asked.clear()
    return around


def test_a_peer_that_answers_is_connected_to(around: Surroundings) -> None:
    assert [around.machine.step() for _ in range(3)] == [AVAILABLE, CONNECTED, CONNECTED]
    assert around.asked == [("probe 100 x 2", 0), ("create", 0)]
    assert [one.reason for one in around.told] == ["ping answered OK", "created"]
    assert around.machine.connections == 1


def test_a_peer_that_does_not_answer_is_asked_at_the_pace_of_waiting(around: Surroundings) -> None:
    around.probe_code = ReturnCode.TIMEOUT
    for _ in range(70):
        assert around.machine.step(10) is WAITING
    assert around.asked == [("probe 100 x 2", at) for at in (0, 300, 600)]
    assert around.told == []


@pytest.mark.parametrize("since_ms", [2**31, 2**32])
def test_an_hour_without_a_peer_changes_no_pace_nor_does_a_clock_beyond_32_bits(
    around: Surroundings, since_ms: int
) -> None:
    around.clock.wait(None, (since_ms - 1_800_000) * MS)  # half an hour before it wraps where it is a u32
    around.asked.clear()
    around.probe_code = ReturnCode.TIMEOUT
    while around.clock.now_ns() < (since_ms + 1_800_000) * MS:
        around.machine.step(1_000)
    asked = [at for _, at in around.asked]
    assert len(asked) >= 12_000
    assert {later - at for at, later in itertools.pairwise(asked)} == {300}
    around.probe_code = ReturnCode.OK
    while around.machine.state is WAITING:
        around.machine.step(1_000)
    assert around.machine.step() is CONNECTED
    assert around.asked[-2][1] - asked[-1] == 300


def test_where_nothing_can_be_asked_before_a_session_creating_is_the_probe(around: Surroundings) -> None:
    around.probe_code, around.create_fails = ReturnCode.UNSUPPORTED, True
    assert [around.machine.step(), around.machine.step()] == [AVAILABLE, WAITING]
    assert around.asked[1:] == [("create", 0), ("destroy", 0)]
    assert around.told[-1].reason == "creating failed: CONNECTION_FAILED (-18): no answer"


def test_a_connected_session_is_pinged_at_its_pace(around: Surroundings) -> None:
    connected(around)
    for _ in range(50):
        assert around.machine.step(10) is CONNECTED
    assert around.asked == [("check 100 x 2", 200), ("check 100 x 2", 400)]


@pytest.mark.parametrize(("field", "code", "reason"), [
    ("check_code", ReturnCode.TIMEOUT, "ping answered TIMEOUT"),
    ("spin_code", ReturnCode.CONNECTION_FAILED, "drive_io answered CONNECTION_FAILED"),
])  # fmt: skip
def test_after_a_failure_everything_is_destroyed_and_begun_anew(
    around: Surroundings, field: str, code: int, reason: str
) -> None:
    connected(around)
    setattr(around, field, code)
    around.destroy_fails = True
    while around.machine.step(10) is not WAITING:
        pass
    assert around.states() == [DISCONNECTED, WAITING]
    assert [one.reason for one in around.told] == [reason, "destroyed; TIMEOUT (-2): destroying"]
    around.check_code = around.spin_code = ReturnCode.OK
    assert [around.machine.step(), around.machine.step()] == [AVAILABLE, CONNECTED]
    assert around.machine.connections == 2


def test_a_session_without_a_ping_is_judged_by_its_calls(around: Surroundings) -> None:
    connected(around)
    around.check_code = ReturnCode.UNSUPPORTED
    for _ in range(50):
        assert around.machine.step(10) is CONNECTED


def test_the_application_may_see_a_failure_first(around: Surroundings) -> None:
    connected(around)
    around.machine.failed("publish answered ERROR")
    assert around.machine.step() is DISCONNECTED
    assert around.told[0].reason == "publish answered ERROR"


# On the reference, with an agent that goes and comes back.


class Application:
    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.backend = ReferenceBackend(Host(self.clock))
        self.agent = self.backend.environment()
        self.context = Context(self.backend)
        self.made: list[Node] = []
        self.forgotten = 0
        self.told: list[Transition] = []
        self.link = Reconnector(
            self.context, "client", self.create, destroy=self.forget, changed=self.told.append,
            options=SessionOptions(locator=self.agent.endpoint()),
        )  # fmt: skip

    def create(self, node: Node) -> None:
        node.create_publisher("std_msgs/msg/String", "/chatter")
        self.made.append(node)

    def forget(self) -> None:
        self.forgotten += 1

    def spin(self, milliseconds: int, state: LinkState) -> bool:
        return self.link.spin(timedelta(milliseconds=milliseconds), until=lambda: self.link.state is state)


@pytest.fixture
def application() -> Iterator[Application]:
    one = Application()
    yield one
    one.context.close()


@pytest.mark.parametrize("outage_ms", [0, 50, 3_000])
def test_an_agent_that_restarts_is_found_again_however_fast(application: Application, outage_ms: int) -> None:
    def run() -> None:
        assert not application.spin(500, CONNECTED)  # nobody is there yet
        application.agent.start()
        link = application.link
        for turn in range(1, 21):
            assert link.spin(timedelta(seconds=1), until=lambda: link.connections == turn)  # noqa: B023 - called at once
            assert turn == len(application.made)
            assert link.node is application.made[-1]
            application.agent.stop(kill=True)
            link.spin(timedelta(milliseconds=outage_ms))
            application.agent.start()
        assert link.spin(timedelta(seconds=1), until=lambda: link.connections == 21)
        assert application.forgotten == 20
        application.link.close()
        assert application.link.node is None

    application.clock.run(run)


def test_an_entity_that_is_refused_is_tried_again(application: Application) -> None:
    def create(node: Node) -> None:
        application.made.append(node)
        if len(application.made) == 1:
            raise RmwError(ReturnCode.TIMEOUT, "the agent dropped the first request")

    options = SessionOptions(locator=application.agent.endpoint())
    link = Reconnector(application.context, "other", create, options=options)
    application.agent.start()
    application.clock.run(lambda: link.spin(timedelta(seconds=2), until=lambda: link.state is CONNECTED))
    assert link.state is CONNECTED
    assert len(application.made) == 2
    link.close()
