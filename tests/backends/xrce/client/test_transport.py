from __future__ import annotations

import socket
import sys
import time
from collections.abc import Iterator

import pytest

from nros_backends.xrce.client import stamps
from nros_backends.xrce.client import transport as transport_module
from nros_backends.xrce.client.transport import Transport, open_socket
from nros_conformance.rmw.clock import MS

linux = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the kernel notes no arrival")


@pytest.fixture
def agent() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        yield sock


@pytest.fixture
def transport(agent: socket.socket) -> Iterator[Transport]:
    made = Transport(open_socket(agent.getsockname()))
    agent.connect(made.socket.getsockname())
    yield made
    made.close()


@linux
def test_a_datagram_arrived_when_the_kernel_got_it_not_when_it_was_read(
    agent: socket.socket, transport: Transport
) -> None:
    before = time.monotonic_ns()
    agent.send(b"one")
    after = time.monotonic_ns()
    time.sleep(0.05)
    (arrived,) = transport.receive(10)
    assert arrived.data == b"one"
    assert before - MS <= arrived.at_ns <= after + MS
    assert transport.known_ns > arrived.at_ns


def assert_right(offset_ns: int | None) -> None:
    """That the wall clock is so far ahead of the monotonic one."""
    before, wall, after = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
    assert offset_ns is not None
    assert wall - after - 2 * MS < offset_ns < wall - before + 2 * MS


@linux
def test_a_clock_waits_until_the_kernel_notes_arrivals(monkeypatch: pytest.MonkeyPatch) -> None:
    # Until the stamps are turned on a datagram has the time of its reading.
    real, calls = stamps.stamp_of, list[int]()

    def stamp_of(ancillary: list[tuple[int, int, bytes]]) -> int | None:
        calls.append(len(calls))
        return time.time_ns() if len(calls) <= 6 else real(ancillary)

    monkeypatch.setattr(stamps, "stamp_of", stamp_of)
    clock = stamps.KernelClock()
    assert len(calls) >= 9, "two each that differ by the pause between them, and those that are compared"
    assert_right(clock.offset())
    clock.close()


@linux
@pytest.mark.parametrize("step_s", [3_600, -3_600, 0.01, -0.01])
def test_the_wall_clock_of_the_process_is_of_no_account(
    agent: socket.socket, transport: Transport, monkeypatch: pytest.MonkeyPatch, step_s: float
) -> None:
    wall, step_ns = time.time_ns, int(step_s * 1_000 * MS)
    for number in range(5):
        before = time.monotonic_ns()
        agent.send(b"one")
        after = time.monotonic_ns()
        steps = (number + 1) // 2 * step_ns
        monkeypatch.setattr(time, "time_ns", lambda steps=steps: wall() + steps)
        time.sleep(0.02)
        (arrived,) = transport.receive(10)
        assert before - MS <= arrived.at_ns <= after + MS


@linux
@pytest.mark.parametrize("step_s", [3_600, -3_600, 0.01, -0.01])
def test_where_the_clock_of_the_kernel_was_stepped_the_time_of_reading_stands_in_once(
    agent: socket.socket, transport: Transport, monkeypatch: pytest.MonkeyPatch, step_s: float
) -> None:
    # A real step moves the clock of the process too.
    wall, real, stepped = time.time_ns, stamps.stamp_of, False

    def stamp_of(ancillary: list[tuple[int, int, bytes]]) -> int | None:
        stamp_ns = real(ancillary)
        return stamp_ns + int(step_s * 1_000 * MS) if stamp_ns is not None and stepped else stamp_ns

    monkeypatch.setattr(stamps, "stamp_of", stamp_of)
    monkeypatch.setattr(time, "time_ns", lambda: wall() + int(step_s * 1_000 * MS) * stepped)
    monkeypatch.setattr(transport_module, "stamp_of", stamp_of)
    agent.send(b"before")
    time.sleep(0.02)
    stepped = True  # not seen in the stamp of what lies there already, as for that of a real step
    monkeypatch.setattr(transport_module, "stamp_of", real)
    before = time.monotonic_ns()
    (arrived,) = transport.receive(10)
    assert before <= arrived.at_ns <= time.monotonic_ns()
    monkeypatch.setattr(transport_module, "stamp_of", stamp_of)
    before = time.monotonic_ns()
    agent.send(b"after")
    after = time.monotonic_ns()
    time.sleep(0.02)
    (arrived,) = transport.receive(10)
    assert before - MS <= arrived.at_ns <= after + MS


@linux
def test_a_comparison_that_was_disturbed_is_made_again() -> None:
    clock = stamps.KernelClock()
    assert clock._ahead is not None
    low, high = clock._ahead
    clock._ahead = clock._ahead._replace(low=low - 20 * MS, high=high + 20 * MS)
    offset = clock.offset()
    clock.close()
    assert_right(offset)


def test_a_socket_that_cannot_have_a_clock_beside_it_is_closed(
    agent: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    sock = open_socket(agent.getsockname())

    def refuse(*arguments: object) -> socket.socket:
        raise OSError("no descriptor is left")

    monkeypatch.setattr(socket, "socket", refuse)
    with pytest.raises(OSError, match="no descriptor"):
        Transport(sock)
    assert sock.fileno() == -1


def test_arrivals_never_lie_before_the_last_look_and_keep_their_order(
    agent: socket.socket, transport: Transport
) -> None:
    transport.receive(10)
    looked = transport.known_ns
    for number in range(3):
        agent.send(bytes([number]))
    arrived = transport.receive(2) + transport.receive(2)
    assert [one.data for one in arrived] == [b"\0", b"\1", b"\2"]
    assert looked <= arrived[0].at_ns <= arrived[1].at_ns <= arrived[2].at_ns


def test_a_closed_port_is_silence(agent: socket.socket, transport: Transport) -> None:
    agent.close()
    for _ in range(3):
        transport.send(b"anybody?")
        assert transport.receive(10) == []


def test_waiting_ends_with_a_datagram_or_with_the_time(agent: socket.socket, transport: Transport) -> None:
    begin = time.monotonic_ns()
    assert not transport.wait(20 * MS)
    assert time.monotonic_ns() - begin >= 20 * MS
    agent.send(b"one")
    assert transport.wait(10_000 * MS)
