from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Iterator

import pytest

from nros_backends.zenoh.proxy import Loop, TcpProxy


def frame(text: str) -> bytes:
    return len(text).to_bytes(2, "little") + text.encode()


class Line:
    """A client, the proxy, and the server behind it."""

    def __init__(self, loop: Loop) -> None:
        self.server = socket.create_server(("127.0.0.1", 0))
        self.server.settimeout(5)
        self.proxy = TcpProxy(loop, self.server.getsockname())
        self.client, self.far = self.connect()

    def connect(self) -> tuple[socket.socket, socket.socket]:
        client = socket.create_connection(("127.0.0.1", self.proxy.port), timeout=5)
        far, _ = self.server.accept()
        far.settimeout(5)
        return client, far

    def close(self) -> None:
        self.proxy.close()
        for end in (self.client, self.far, self.server):
            end.close()


@pytest.fixture
def line() -> Iterator[Line]:
    loop = Loop()
    line = Line(loop)
    yield line
    line.close()
    loop.close()


def receive(end: socket.socket, *texts: str) -> None:
    expected = b"".join(map(frame, texts))
    got = b""
    while len(got) < len(expected):
        data = end.recv(len(expected) - len(got))
        assert data, f"the connection ended after {got!r}"
        got += data
    assert got == expected


def silent(end: socket.socket) -> bool:
    end.setblocking(False)
    try:
        return end.recv(1) == b"?"
    except BlockingIOError:
        return True
    finally:
        end.settimeout(5)


def test_frames_pass_both_ways_and_an_end_ends_both(line: Line) -> None:
    line.client.sendall(frame("a")[:2])
    line.client.sendall(frame("a")[2:] + frame("b"))
    receive(line.far, "a", "b")
    line.far.sendall(frame("c"))
    receive(line.client, "c")
    line.client.close()
    assert line.far.recv(1) == b""


def test_what_is_held_waits_and_then_passes_in_order(line: Line) -> None:
    line.proxy.out.held = True
    line.client.sendall(frame("a") + frame("b"))
    line.far.sendall(frame("c"))
    receive(line.client, "c")
    assert silent(line.far)
    line.proxy.release()
    line.client.sendall(frame("d"))
    receive(line.far, "a", "b", "d")


def test_an_end_is_held_up_too(line: Line) -> None:
    line.proxy.out.held = True
    line.client.sendall(frame("last"))
    line.client.close()
    assert silent(line.far)
    line.proxy.release()
    receive(line.far, "last")
    assert line.far.recv(1) == b""


def test_what_has_waited_passes_before_an_end_that_comes_while_it_is_released(line: Line) -> None:
    line.proxy.out.held = True
    line.client.sendall(frame("last"))
    limit = time.monotonic() + 20
    while not any(side._received for side in tuple(line.proxy._sides)):
        assert time.monotonic() < limit
        time.sleep(0.001)
    line.proxy.out.held = False  # the first that `release` does
    line.client.close()
    receive(line.far, "last")
    assert line.far.recv(1) == b""


def test_a_blocked_proxy_refuses_new_connections(line: Line) -> None:
    line.proxy.back.held = True
    with socket.create_connection(("127.0.0.1", line.proxy.port), timeout=5) as late:
        assert late.recv(1) == b""
    line.proxy.release()
    client, far = line.connect()
    client.sendall(frame("back"))
    receive(far, "back")
    client.close()
    far.close()


def test_a_filter_leaves_a_sign_of_life_of_a_frame(line: Line) -> None:
    line.proxy.out.filters = (lambda data: b"lose" in data,)
    line.client.sendall(frame("a") + frame("lose me") + frame("b"))
    receive(line.far, "a", "\x04", "b")


def test_delayed_frames_keep_their_order_after_the_delay_is_over(line: Line) -> None:
    line.proxy.out.delay_ns = 30_000_000
    begin = time.monotonic()
    line.client.sendall(frame("a"))
    line.client.sendall(frame("b"))
    receive(line.far, "a", "b")
    assert time.monotonic() - begin >= 0.03
    line.client.sendall(frame("c"))
    line.proxy.release()
    line.client.sendall(frame("d"))
    receive(line.far, "c", "d")


def test_half_a_frame_passes_and_the_rest_follows_on_release(line: Line) -> None:
    line.proxy.out.halve = True
    line.client.sendall(frame("abcdefgh") + frame("next"))
    assert line.far.recv(100) == frame("abcdefgh")[:5]
    assert silent(line.far)
    line.proxy.release()
    with line.far.makefile("rb") as received:
        assert received.read(5) == frame("abcdefgh")[5:]
        assert received.read(6) == frame("next")


def test_a_retired_proxy_keeps_its_port_and_serves_nobody(line: Line) -> None:
    line.proxy.retire()
    with socket.create_connection(("127.0.0.1", line.proxy.port), timeout=5) as late:
        assert late.recv(1) == b""


def test_much_data_passes_a_slow_reader(line: Line) -> None:
    block = frame("x" * 60_000)
    line.client.settimeout(0.2)
    blocks = 0
    with contextlib.suppress(TimeoutError):
        while blocks < 1000:
            line.client.sendall(block)
            blocks += 1
    assert 1 < blocks < 1000, "nothing has slowed it down"
    with line.far.makefile("rb") as received:
        assert [received.read(len(block)) == block for _ in range(blocks)] == [True] * blocks
