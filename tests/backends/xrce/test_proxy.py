from __future__ import annotations

import socket
import time
from collections.abc import Iterator

import pytest

from nros_backends.xrce.proxy import FREE, Proxy, Rules

LOST, HELD = Rules(lost=True), Rules(held=True)


class Line:
    """An agent's socket, a client's, and a proxy between them."""

    def __init__(self) -> None:
        self.agent = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.agent.bind(("127.0.0.1", 0))
        upstream = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        upstream.connect(self.agent.getsockname())
        self.agent.connect(upstream.getsockname())
        self.endpoint = upstream.getsockname()
        self.proxy = Proxy(upstream)
        self.client = self.proxy.client
        for end in (self.agent, self.client):
            end.settimeout(10)

    def close(self) -> None:
        self.proxy.close()
        self.agent.close()
        self.client.close()


@pytest.fixture
def line() -> Iterator[Line]:
    made = Line()
    yield made
    made.close()


def nothing(sock: socket.socket) -> bool:
    sock.settimeout(0.03)
    try:
        sock.recv(100)
    except TimeoutError:
        return True
    finally:
        sock.settimeout(10)
    return False


def test_passes_both_ways_and_the_agent_sees_the_same_endpoint(line: Line) -> None:
    line.client.send(b"out")
    assert line.agent.recvfrom(100) == (b"out", line.endpoint)
    line.agent.send(b"in")
    assert line.client.recv(100) == b"in"


def test_loses_what_was_sent_under_that_rule_and_nothing_else(line: Line) -> None:
    line.client.send(b"before")
    line.proxy.rule(LOST, FREE)
    line.client.send(b"lost")
    line.agent.send(b"in")
    line.proxy.rule(FREE, FREE)
    line.client.send(b"after")
    assert [line.agent.recv(100), line.agent.recv(100)] == [b"before", b"after"]
    assert line.client.recv(100) == b"in"


def test_what_was_held_back_comes_in_order_before_what_is_new(line: Line) -> None:
    line.proxy.rule(HELD, FREE)
    for number in range(5):
        line.client.send(bytes([number]))
    assert nothing(line.agent)
    line.proxy.rule(FREE, FREE)
    line.client.send(b"\5")
    assert [line.agent.recv(100)[0] for _ in range(6)] == list(range(6))


def test_delays_by_what_was_asked_for(line: Line) -> None:
    line.proxy.rule(Rules(late_ns=50_000_000), FREE)
    begin = time.monotonic()
    line.client.send(b"late")
    assert line.agent.recv(100) == b"late"
    assert time.monotonic() - begin >= 0.05


def test_healed_it_sends_at_once_what_was_delayed(line: Line) -> None:
    line.proxy.rule(Rules(late_ns=3_600_000_000_000), FREE)
    line.client.send(b"late")
    line.proxy.rule(FREE, FREE)
    assert line.agent.recv(100) == b"late"


def test_captures_best_effort_messages_and_passes_the_others(line: Line) -> None:
    with line.proxy.capturing() as captured:
        line.client.send(b"\x81\x01\0\0data")
        line.client.send(b"\x81\x80\0\0reliable")
    assert captured == [b"\x81\x01\0\0data"]
    assert line.agent.recv(100) == b"\x81\x80\0\0reliable"
    assert nothing(line.agent)


def test_closed_twice_it_leaves_no_thread(line: Line) -> None:
    line.proxy.close()
    line.proxy.close()
    assert not line.proxy._thread.is_alive()
