"""A UDP proxy between one client and its agent, for faults of the link between the two.

It takes over the socket that the client had, so that the agent sees no other endpoint than before, and
gives the client a new one. A thread passes datagrams on, as `Rules` say; it ends with `Proxy.close`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import selectors
import socket
import threading
import time
from collections import deque
from collections.abc import Iterator

_DATAGRAM = 65_536
_BATCH = 1_024
"""Datagrams of one side before the other one has its turn."""

_DELAYED = 4_096
"""Datagrams that are held back at most; beyond it the link loses them, as a full buffer would."""


@dataclasses.dataclass(frozen=True, slots=True)
class Rules:
    """What happens to the datagrams of one direction: lost, held back until told otherwise, or late."""

    lost: bool = False
    held: bool = False
    late_ns: int = 0


FREE = Rules()


class _Side:
    """One direction: where it comes from, where it goes, and what is under way."""

    def __init__(self, source: socket.socket, target: socket.socket, rules: Rules) -> None:
        self.source = source
        self.target = target
        self.rules = rules
        self.captured: list[bytes] | None = None
        self.waiting: deque[tuple[int, bytes]] = deque()

    def drain(self, now_ns: int) -> None:
        """Take what has arrived, and treat it as the rules say."""
        for _ in range(_BATCH):
            try:
                datagram = self.source.recv(_DATAGRAM)
            except BlockingIOError:
                break
            except ConnectionRefusedError:
                continue  # nobody listens at the other end; what was sent there is gone
            self.pass_on(datagram, now_ns)
        self.release(now_ns)

    def pass_on(self, datagram: bytes, now_ns: int) -> None:
        if self.captured is not None and _is_best_effort(datagram):
            self.captured.append(datagram)
        elif self.rules.lost or len(self.waiting) >= _DELAYED:
            return
        elif self.rules.held or self.rules.late_ns or self.waiting:
            self.waiting.append((now_ns + self.rules.late_ns, datagram))
        else:
            self.send(datagram)

    def release(self, now_ns: int) -> None:
        """Send what is due."""
        while self.waiting and not self.rules.held and self.waiting[0][0] <= now_ns:
            self.send(self.waiting.popleft()[1])

    @property
    def due_ns(self) -> int | None:
        """When `release` sends something next."""
        return self.waiting[0][0] if self.waiting and not self.rules.held else None

    def send(self, datagram: bytes) -> None:
        # A full buffer or a closed port loses a datagram, as UDP does.
        with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
            self.target.send(datagram)


class Proxy:
    """Between a client and the agent that ``upstream`` is connected to; `client` is for the client.

    ``upstream`` is owned from now on, `client` is not. All methods may be called from any thread; what
    the client had sent before a call is treated by the rules from before it.
    """

    def __init__(self, upstream: socket.socket, out: Rules = FREE, into: Rules = FREE) -> None:
        near = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        for end in (near, self.client):
            end.bind(("127.0.0.1", 0))
        near.connect(self.client.getsockname())
        self.client.connect(near.getsockname())
        for end in (near, upstream, self.client):
            end.setblocking(False)
        self._near, self._upstream = near, upstream
        self._out, self._into = _Side(near, upstream, out), _Side(upstream, near, into)
        self._lock = threading.Lock()
        self._wake, self._woken = os.pipe()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="xrce-proxy", daemon=True)
        self._thread.start()

    def rule(self, out: Rules, into: Rules) -> None:
        """Have other rules from now on. What was held back is sent, in its order, as soon as they allow."""
        with self._lock:
            now_ns = time.monotonic_ns()
            for side, rules in ((self._out, out), (self._into, into)):
                side.drain(now_ns)
                if not (rules.held or rules.late_ns):
                    side.waiting = deque((0, datagram) for _, datagram in side.waiting)
                side.rules = rules
                side.release(now_ns)
        os.write(self._woken, b"\0")

    @contextlib.contextmanager
    def capturing(self) -> Iterator[list[bytes]]:
        """Keep what the client sends on best-effort streams meanwhile; the list is complete afterwards."""
        captured: list[bytes] = []
        with self._lock:
            self._out.drain(time.monotonic_ns())
            self._out.captured = captured
        try:
            yield captured
        finally:
            with self._lock:
                self._out.drain(time.monotonic_ns())
                self._out.captured = None

    def send_out(self, datagram: bytes) -> None:
        """Send to the agent, from the client's endpoint."""
        with self._lock:
            self._out.pass_on(datagram, time.monotonic_ns())

    def send_in(self, datagram: bytes) -> None:
        """Send to the client, from what it takes for the agent."""
        with self._lock:
            self._into.pass_on(datagram, time.monotonic_ns())

    def close(self) -> None:
        """End the thread and close its sockets; what is held back is lost. A second call is harmless."""
        if self._closed:
            return
        self._closed = True
        os.write(self._woken, b"\0")
        self._thread.join()
        for end in (self._near, self._upstream):
            end.close()
        os.close(self._wake)
        os.close(self._woken)

    def _run(self) -> None:
        with selectors.DefaultSelector() as selector:
            for source in (self._near, self._upstream, self._wake):
                selector.register(source, selectors.EVENT_READ)
            timeout: float | None = None
            while not self._closed:
                ready = selector.select(timeout)
                if any(key.fileobj == self._wake for key, _ in ready):
                    os.read(self._wake, 4_096)
                with self._lock:
                    now_ns = time.monotonic_ns()
                    self._out.drain(now_ns)
                    self._into.drain(now_ns)
                    due = [side.due_ns for side in (self._out, self._into) if side.due_ns is not None]
                timeout = max(min(due) - now_ns, 0) / 1e9 if due else None


def _is_best_effort(datagram: bytes) -> bool:
    """Whether an XRCE message is one of a best-effort stream: stream ids 0x01 to 0x7f."""
    return len(datagram) > 1 and 0x01 <= datagram[1] <= 0x7F
