from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from nros_backends.xrce import environment, external_agent
from nros_backends.xrce.agent.server import AgentServer
from nros_backends.xrce.backend import XrceBackend
from nros_backends.xrce.session import XrceSession
from nros_conformance.rmw.backend import Host, SessionOptions
from nros_conformance.rmw.clock import MS, MonotonicClock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from tests.backends.xrce.conftest import TYPE, Bench, drive, publisher, subscription

LEASE_MS = 400
OK = ReturnCode.OK


@pytest.fixture(params=["embedded", "external"])
def either(request: pytest.FixtureRequest) -> Iterator[Bench]:
    made = Bench(variant=request.param)
    yield made
    made.backend.close()


def meet(bench: Bench, lease_ms: int = LEASE_MS) -> tuple[XrceSession, XrceSession]:
    """Two sessions between which samples flow both ways."""
    left, right = bench.session("left", lease_ms), bench.session("right", lease_ms)
    for near, far, topic in ((left, right, "/there"), (right, left, "/back")):
        sent, received = publisher(near, topic=topic), subscription(far, topic=topic)
        assert sent.publish_raw(b"sample") == OK
        assert drive(left, right, until=lambda received=received: received.has_data() is True)  # type: ignore[misc]
    return left, right


def lost(session: XrceSession) -> float:
    """Drive until that fails; for how long it did not, s."""
    begin = time.monotonic()
    assert drive(session, until=lambda: session.drive_io(5) == ReturnCode.CONNECTION_FAILED)
    return time.monotonic() - begin


@pytest.mark.parametrize(("kill", "pause_s"), [(True, 0.0), (False, 0.0), (True, 0.45)], ids=["kill", "stop", "slow"])
def test_every_restart_of_the_agent_is_noticed_and_got_over(either: Bench, kill: bool, pause_s: float) -> None:
    endpoint = either.agent.endpoint()
    left, right = meet(either)
    either.agent.stop(kill=kill)
    time.sleep(pause_s)
    either.agent.start()
    assert either.agent.endpoint() == endpoint
    assert left.ping(100) == ReturnCode.TIMEOUT
    assert lost(right) < 2 * LEASE_MS / 1e3
    assert {left.drive_io(0), right.drive_io(0)} == {ReturnCode.CONNECTION_FAILED}
    for session in (left, right):
        session.destroy()
    meet(either)


def test_twenty_fast_restarts_under_running_sessions(bench: Bench) -> None:
    threads = threading.active_count()
    for _ in range(20):
        left, right = meet(bench, lease_ms=200)
        bench.agent.stop(kill=True)
        bench.agent.start()
        assert lost(left) < 1
        assert right.ping(200) == ReturnCode.TIMEOUT
        left.destroy()
        right.destroy()
    assert threading.active_count() == threads


def test_a_dead_agent_is_noticed_within_the_lease_by_those_who_only_publish(bench: Bench) -> None:
    session = bench.session(lease_ms=LEASE_MS)
    sent = publisher(session)
    bench.agent.stop(kill=True)
    clock = MonotonicClock()
    begin, waited = clock.now_ns(), clock.run_delay_ns()
    while sent.publish_raw(b"sample") == OK:
        assert clock.now_ns() - begin < 10_000 * MS
        time.sleep(0.05)
    # The lease, a turn of this loop, and what the host kept it waiting.
    assert clock.now_ns() - begin < (LEASE_MS + 100) * MS + clock.run_delay_ns() - waited
    assert sent.publish_raw(b"sample") == ReturnCode.CONNECTION_FAILED


def test_an_idle_session_stays_well(bench: Bench) -> None:
    session = bench.session(lease_ms=100)
    for _ in range(20):
        assert session.drive_io(20) == OK


def test_a_session_that_nobody_drove_for_long_is_still_well(bench: Bench) -> None:
    session = bench.session(lease_ms=40)
    time.sleep(0.2)
    assert session.drive_io(0) == OK
    assert session.drive_io(10) == OK


def test_calls_at_a_dead_agent_are_bounded_and_leave_nothing(bench: Bench) -> None:
    def timed(call: object) -> float:
        begin = time.monotonic()
        call()  # type: ignore[operator]
        return time.monotonic() - begin

    def create(session: XrceSession) -> None:
        with pytest.raises(RmwError) as caught:
            session.create_publisher("/topic", TYPE, publisher_qos)
        assert caught.value.code in (ReturnCode.CONNECTION_FAILED, ReturnCode.TIMEOUT)

    def open_session() -> None:
        with pytest.raises(RmwError, match=r"^CONNECTION_FAILED \(-18\): the agent does not answer$"):
            bench.session(lease_ms=LEASE_MS)

    session = bench.session(lease_ms=LEASE_MS)
    sent = publisher(session)
    publisher_qos = sent.qos
    descriptors = len(list(Path("/proc/self/fd").iterdir()))
    bench.agent.stop(kill=True)
    limit = 2 * LEASE_MS / 1e3 + 0.1
    assert timed(lambda: create(session)) < limit
    assert timed(open_session) < limit
    assert timed(sent.destroy) < limit
    assert timed(session.destroy) < limit
    assert len(list(Path("/proc/self/fd").iterdir())) < descriptors
    bench.agent.start()
    meet(bench)


def test_a_silent_agent_that_speaks_again_makes_the_session_well(bench: Bench) -> None:
    left, right = meet(bench)
    sent, received = publisher(left, topic="/after"), subscription(right, topic="/after")
    bench.backend.inject("partition", session=left)
    lost(left)
    bench.backend.inject("heal", session=left)
    assert drive(left, right, until=lambda: left.drive_io(1) == OK)
    assert sent.publish_raw(b"sample") == OK
    assert drive(left, right, until=lambda: received.has_data() is True)


def test_pings(either: Bench) -> None:
    options = SessionOptions(locator=either.agent.endpoint())
    session = either.session()
    assert either.backend.ping(options, 5_000) == session.ping(5_000) == OK
    either.agent.stop(kill=True)
    begin = time.monotonic()
    assert either.backend.ping(options, 50, 2) == session.ping(50, 2) == ReturnCode.TIMEOUT
    assert 0.2 <= time.monotonic() - begin < 5
    either.agent.start()
    assert either.backend.ping(options, 5_000) == OK
    assert session.ping(5_000) == ReturnCode.TIMEOUT
    assert session.ping(50, 0) == either.backend.ping(options, 50, 0) == ReturnCode.INVALID_ARGUMENT


def test_an_agent_beside_tells_its_process(either: Bench) -> None:
    variant, told = either.backend.host.variant, list(either.agent.processes())
    assert len(told) == (variant == "external")
    for process in told:
        os.kill(process, 0)
    either.agent.stop(kill=True)
    assert list(either.agent.processes()) == []
    for process in told:
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)


def test_an_agent_beside_serves_the_next_play_when_it_was_left_untouched() -> None:
    first = Bench(variant="external")
    session = first.session(hard_ms=300)
    publisher(session)
    assert first.agent.counts() == {"checks": 0, "probes": 0}
    assert session.ping(5_000) == OK
    assert first.agent.counts() == {"checks": 0, "probes": 1}
    served = first.agent.processes(), first.agent.endpoint()
    session.destroy()
    first.agent.release()
    first.backend.close()
    assert served[1].partition(":")[2] in first.agent.log()

    second = Bench(variant="external")
    third = Bench(variant="external")
    touched = Bench(variant="external", faults=frozenset({"stop"}))
    assert (second.agent.processes(), second.agent.endpoint()) == served
    assert len({bench.agent.endpoint() for bench in (second, third, touched)}) == 3
    assert (second.agent.log(), second.agent.counts()) == ("", {"checks": 0, "probes": 0})
    second.session()  # one that is left over with what is in it
    publisher(second.session())
    second.agent.release()
    assert list(second.agent.processes()) == []
    touched.agent.release()
    assert list(touched.agent.processes()) == []
    (process,) = third.agent.processes()
    third.agent.release()
    os.kill(process, signal.SIGKILL)
    os.waitid(os.P_PID, process, os.WEXITED | os.WNOWAIT)
    fourth = Bench(variant="external")
    assert process not in fourth.agent.processes()
    for bench in (second, third, touched, fourth):
        bench.backend.close()


def test_what_an_agent_says_too_late_is_not_its_next_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(variant="external")
    session = bench.session()
    (process,) = bench.agent.processes()
    with monkeypatch.context() as impatient:
        impatient.setattr(external_agent, "_ANSWER_S", 0.05)
        os.kill(process, signal.SIGSTOP)
        assert bench.agent.entities() == []
        assert bench.agent.entities() == []
        os.kill(process, signal.SIGCONT)
    publisher(session)
    assert bench.agent.entities() != []
    bench.backend.close()


def test_hard_liveliness_removes_who_is_silent_and_nobody_who_drives(either: Bench) -> None:
    silent, driven = either.session("silent", hard_ms=300), either.session("driven", hard_ms=300)
    publisher(silent, topic="/silent")
    publisher(driven, topic="/driven")

    def topics() -> list[str]:
        return [one.topic for one in either.agent.entities() or ()]

    assert sorted(topics()) == ["/driven", "/silent"]
    assert drive(driven, until=lambda: topics() == ["/driven"])
    assert either.agent.counts()["checks"] >= 3
    assert silent.ping(100) == ReturnCode.TIMEOUT
    lost(silent)
    silent.destroy()
    again = either.session("silent", hard_ms=300)
    publisher(again, topic="/silent")
    assert sorted(topics()) == ["/driven", "/silent"]


def test_an_own_agent_starts_by_itself_where_nobody_asked_for_it() -> None:
    backend = XrceBackend(Host(clock=MonotonicClock()))
    assert backend.create_session(SessionOptions()).drive_io(0) == OK
    assert backend.lacking() == {}
    backend.close()


def test_the_agent_that_the_user_names() -> None:
    with AgentServer() as server:
        made = Bench(options={"agent": f"localhost:{server.address[1]}"}, variant="external")
        assert made.agent.endpoint() == f"127.0.0.1:{server.address[1]}"
        session = made.session()
        sent, received = publisher(session), subscription(session)
        assert len(server.clients()) == 1
        assert made.backend.await_matched(sent, received, 0) is None
        with pytest.raises(RmwError, match=r"^UNSUPPORTED \(-5\): the agent at 127\.0\.0\.1:\d+ is not ours to stop$"):
            made.agent.stop(kill=True)
        assert set(made.backend.lacking()) == {"stop", "start"}
        made.backend.close()
        assert server.clients() == ()


def test_a_user_s_agent_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environment, "_REACH_NS", 20 * MS)
    with AgentServer() as server:
        port = server.address[1]
    with pytest.raises(RmwError, match=rf"^CONNECTION_FAILED \(-18\): no XRCE agent answers at 127\.0\.0\.1:{port}$"):
        Bench(options={"agent": f"127.0.0.1:{port}"})


@pytest.mark.parametrize(
    ("locator", "text"),
    [
        ("7400", "agent '7400' is not HOST:PORT"),
        ("host:0", "agent 'host:0' is not HOST:PORT"),
        ("host:x", "agent 'host:x' is not HOST:PORT"),
        (":80", "agent ':80' is not HOST:PORT"),
    ],
)
def test_locators_that_are_none(bench: Bench, locator: str, text: str) -> None:
    with pytest.raises(RmwError) as caught:
        bench.backend.create_session(SessionOptions(locator=locator))
    assert caught.value.code is ReturnCode.INVALID_CONFIG
    assert caught.value.detail == text


@pytest.mark.parametrize(
    ("options", "code", "text"),
    [
        (SessionOptions(node_name=""), ReturnCode.INVALID_ARGUMENT, "node '' in domain 0 cannot exist"),
        (SessionOptions(domain_id=2), ReturnCode.INVALID_ARGUMENT, "node 'node' in domain 2 cannot exist"),
        (SessionOptions(connection_lease_ms=5), ReturnCode.INVALID_ARGUMENT, "lease 5 ms is not 20 ms to an hour"),
        (
            SessionOptions(hard_liveliness_ms=1_000_000),
            ReturnCode.INVALID_ARGUMENT,
            "hard liveliness 1000000 ms is not six digits",
        ),
        (SessionOptions(mode="peer"), ReturnCode.INVALID_CONFIG, "mode 'peer': an XRCE client is a client"),
    ],
)
def test_options_that_cannot_be(bench: Bench, options: SessionOptions, code: ReturnCode, text: str) -> None:
    with pytest.raises(RmwError) as caught:
        bench.backend.create_session(options)
    assert (caught.value.code, caught.value.detail) == (code, text)


def test_sessions_leave_neither_threads_nor_descriptors(bench: Bench) -> None:
    def counted() -> tuple[int, int]:
        return threading.active_count(), len(os.listdir("/proc/self/fd"))  # noqa: PTH208

    def come_and_go(times: int) -> None:
        for _ in range(times):
            session = bench.session()
            publisher(session).publish_raw(b"sample")
            session.attachment.proxy()
            assert session.destroy() == OK

    come_and_go(1)  # the agent of all of them starts with the first
    before = counted()
    come_and_go(100)
    assert counted() == before
