"""The agent on a UDP socket, in a thread of its own or in the caller's."""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
import time
from collections.abc import Callable
from types import TracebackType

from nros_backends.xrce.agent.core import Agent, EntityInfo, Outgoing
from nros_backends.xrce.agent.session import Address

LARGEST = 65_535
"""Octets of the largest UDP payload that can come in."""
BATCH = 64
"""Datagrams handled before time is looked at again."""
NS_PER_S = 1_000_000_000


class AgentServer:
    """An `Agent` that listens. Raises OSError if the port is taken.

    ``port`` 0: any free one. ``watch`` is told of every datagram: direction (``"in"``, ``"out"``), address,
    payload. ``changed`` is told the graph whenever it changes. Both run in the agent's thread.
    All methods may be called from any thread.
    """

    def __init__(
        self,
        port: int = 0,
        bind: str = "127.0.0.1",
        watch: Callable[[str, Address, bytes], None] | None = None,
        changed: Callable[[tuple[EntityInfo, ...]], None] | None = None,
    ) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((bind, port))
        except OSError:
            self._socket.close()
            raise
        self._socket.setblocking(False)
        self.address: Address = self._socket.getsockname()
        self._waker, self._wakened = socket.socketpair()
        self._watch = watch
        self._changed = changed
        self._graph: tuple[EntityInfo, ...] = ()
        self._agent = Agent(time.monotonic_ns())
        self._lock = threading.Lock()
        self._stopping = False
        self._thread: threading.Thread | None = None

    def __enter__(self) -> AgentServer:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def start(self) -> None:
        """Serve in a thread until `close`."""
        self._thread = threading.Thread(target=self.serve, name="xrce-agent", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Make `serve` return soon. Safe in a signal handler."""
        self._stopping = True
        with contextlib.suppress(OSError):  # closed, or so full of wake-ups that one more changes nothing
            self._waker.send(b"\0")

    def close(self) -> None:
        """Stop, wait for the thread and free the port. A second call does nothing."""
        self.stop()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        for one in (self._socket, self._waker, self._wakened):
            one.close()

    def entities(self) -> tuple[EntityInfo, ...]:
        """The graph at this moment."""
        with self._lock:
            return self._agent.entities()

    def clients(self) -> tuple[int, ...]:
        """The keys of the clients with a session at this moment."""
        with self._lock:
            return self._agent.clients

    def serve(self) -> None:
        """Serve in this thread until `stop`."""
        with selectors.DefaultSelector() as selector:
            selector.register(self._socket, selectors.EVENT_READ)
            selector.register(self._wakened, selectors.EVENT_READ)
            while not self._stopping:
                now = time.monotonic_ns()
                with self._lock:
                    outgoing = self._agent.advance(now)
                    wakeup = self._agent.wakeup_ns(now)
                self._send(outgoing)
                self._compare()
                selector.select(None if wakeup is None else max(wakeup - time.monotonic_ns(), 0) / NS_PER_S)
                self._receive()

    def _receive(self) -> None:
        for _ in range(BATCH):
            try:
                datagram, source = self._socket.recvfrom(LARGEST)
            except BlockingIOError:
                return
            except OSError:
                continue  # an error of an earlier sending, which the network may lose anyway
            if self._watch is not None:
                self._watch("in", source, datagram)
            with self._lock:
                outgoing = self._agent.receive(datagram, source, time.monotonic_ns())
            self._send(outgoing)
            self._compare()

    def _send(self, outgoing: list[Outgoing]) -> None:
        for datagram, destination in outgoing:
            if self._watch is not None:
                self._watch("out", destination, datagram)
            with contextlib.suppress(OSError):  # a full buffer or an address that is gone: UDP may lose
                self._socket.sendto(datagram, destination)

    def _compare(self) -> None:
        if self._changed is None:
            return
        graph = self.entities()
        if graph != self._graph:
            self._graph = graph
            self._changed(graph)
