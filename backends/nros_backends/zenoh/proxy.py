"""A TCP proxy on loopback that sees frames: what passes can be held up, delayed, cut in half or emptied.

A frame is a little-endian u16 length and so many bytes, as zenoh sends them over TCP. All proxies of a backend
run on the event loop of one thread.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

_T = TypeVar("_T")

_LENGTH = 2
_KEEP_ALIVE = b"\x01\x00\x04"
"""A frame with the transport message KeepAlive."""

_START_S = 5.0

Filter = Callable[[bytes], bool]
"""Whether a frame is to be taken out: a KeepAlive passes in its place."""


class Loop:
    """An event loop on a thread of its own, which ends with `close`."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="zenoh-wire", daemon=True)
        self._thread.start()

    def run(self, work: Coroutine[Any, Any, _T]) -> _T:
        """Await it there."""
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(_START_S)

    def close(self) -> None:
        """End the thread; its proxies are closed before."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


class Flow:
    """One direction of a proxy, over all its connections. Its fields may be set from any thread."""

    def __init__(self) -> None:
        self.held = False
        """Nothing passes; it waits, as it would for TCP's retransmission."""
        self.halve = False
        """Of the next frame one half passes, then nothing until `release`."""
        self.delay_ns = 0
        self.filters: tuple[Filter, ...] = ()

    def takes_out(self, frame: bytes) -> bool:
        """Whether a filter wants this frame."""
        return any(wants(frame) for wants in self.filters)


class TcpProxy:
    """A port in front of ``target``. ``out`` is what clients send to it, ``back`` what it answers."""

    def __init__(self, loop: Loop, target: tuple[str, int]) -> None:
        self.out, self.back = Flow(), Flow()
        self._target: tuple[str, int] | None = target
        self._loop = loop
        self._sides: set[_Side] = set()
        self._server: asyncio.Server | None = None
        loop.run(self._listen())

    @property
    def port(self) -> int:
        """Where it listens on 127.0.0.1."""
        assert self._server is not None
        return int(self._server.sockets[0].getsockname()[1])

    @property
    def blocked(self) -> bool:
        """Whether a new connection has no chance: neither side would hear of the other."""
        return self.out.held or self.back.held

    def release(self) -> None:
        """Let everything pass again, first what has waited."""
        for flow in (self.out, self.back):
            flow.held = flow.halve = False
            flow.delay_ns = 0
        self._loop.run(self._resume())

    def retire(self) -> None:
        """Refuse new connections from now on; the port stays taken."""
        self._target = None

    def close(self) -> None:
        """Close the port and all connections."""
        self._loop.run(self._close())

    async def _listen(self) -> None:
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: _Side(self, self.out), "127.0.0.1", 0)

    async def _resume(self) -> None:
        for side in tuple(self._sides):
            side.pump()

    async def _close(self) -> None:
        assert self._server is not None
        self._server.close()
        for side in tuple(self._sides):
            side.abort()
        await asyncio.sleep(0)  # their connections are reported lost

    async def _connect(self, side: _Side) -> None:
        """Give an accepted connection its other half."""
        if self._target is not None and not self.blocked:
            try:
                loop = asyncio.get_running_loop()
                await loop.create_connection(lambda: _Side(self, self.back, side), *self._target)
                return
            except OSError:
                pass  # nobody listens there: the client learns that by the end of its connection
        side.abort()


class _Side(asyncio.Protocol):
    """One end of one connection: what it receives goes to its partner."""

    def __init__(self, proxy: TcpProxy, flow: Flow, partner: _Side | None = None) -> None:
        self._proxy = proxy
        self._flow = flow
        self._partner = partner
        self._transport: asyncio.Transport | None = None
        self._received = bytearray()
        self._rest = b""
        """Of a frame that was cut in half."""
        self._last_due = 0.0
        self._ended = False
        self._connecting: asyncio.Task[None] | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._proxy._sides.add(self)
        if self._partner is None:
            self._connecting = asyncio.ensure_future(self._proxy._connect(self))
        else:
            self._partner._partner = self
            self._partner.pump()

    def data_received(self, data: bytes) -> None:
        self._received += data
        self.pump()

    def eof_received(self) -> bool:
        self._end()
        return True  # stays open for what still waits in it

    def connection_lost(self, error: Exception | None) -> None:
        self._transport = None
        self._end()

    def pause_writing(self) -> None:
        if self._partner is not None and self._partner._transport is not None:
            self._partner._transport.pause_reading()

    def resume_writing(self) -> None:
        if self._partner is not None and self._partner._transport is not None:
            self._partner._transport.resume_reading()

    def abort(self) -> None:
        """Close both ends at once."""
        self._proxy._sides.discard(self)
        if self._transport is not None:
            self._transport.abort()

    def pump(self) -> None:
        """Pass on whole frames, and then the end, as far as the flow lets them."""
        if self._partner is not None:
            self._pass_on(self._partner)
        if self._ended and not self._flow.held:
            self._close()

    def _pass_on(self, partner: _Side) -> None:
        while not self._flow.held and (self._rest or len(self._received) >= _LENGTH):
            if self._rest:  # looked at each time: the flow may be released at any moment
                partner._send(self._rest)
                self._rest = b""
                continue
            size = _LENGTH + int.from_bytes(self._received[:_LENGTH], "little")
            if len(self._received) < size:
                break
            frame = bytes(self._received[:size])
            del self._received[:size]
            if self._flow.halve:
                self._flow.halve, self._flow.held = False, True
                self._rest = frame[size // 2 :]
                frame = frame[: size // 2]
            elif self._flow.takes_out(frame):
                # Who has just sent data sends no sign of life, and a lease must not run out because data got lost.
                frame = _KEEP_ALIVE
            self._forward(frame, partner)

    def _forward(self, frame: bytes, partner: _Side) -> None:
        now = time.monotonic()
        due = max(now + self._flow.delay_ns / 1e9, self._last_due + 1e-7)  # in order
        if due <= now + 1e-6:
            partner._send(frame)
        else:  # also what must not overtake a delayed one
            self._last_due = due
            asyncio.get_running_loop().call_at(due, partner._send, frame)

    def _send(self, data: bytes) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(data)

    def _end(self) -> None:
        """The connection has ended: the partner's ends too, after what has waited, unless that news is held up."""
        self._ended = True
        self.pump()

    def _close(self) -> None:
        for side in (self, self._partner):
            if side is not None:
                self._proxy._sides.discard(side)
                if side._transport is not None:
                    side._transport.close()
