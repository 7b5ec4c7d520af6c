"""The router beside the sessions: a process of our own on loopback, or one that the command line names."""

from __future__ import annotations

import collections
import contextlib
import os
import select
import socket
import tempfile
from collections.abc import Sequence

from nros_backends.zenoh.config import LEASE_MS, free_port
from nros_conformance.rmw.backend import Environment
from nros_conformance.rmw.child import Launcher, await_end, close_pipes, launch
from nros_conformance.rmw.codes import ReturnCode, RmwError

_START_S = 20.0
"""A start takes 0.1 s; more is a host that has come to a standstill."""

_STOP_S = 5.0


class _Router:
    """One life of a router process."""

    def __init__(self, endpoint: str, launch: Launcher) -> None:
        self.endpoint = endpoint
        self._printed = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `stop`
        self._before = 0
        self._process = launch("nros_backends.zenoh.router", [endpoint, str(LEASE_MS)], self._printed)

    def came_up(self) -> bool:
        """Wait for it to listen; whether it does."""
        output = self._process.stdout
        assert output is not None
        ready, _, _ = select.select([output], [], [], _START_S)
        return bool(ready and output.readline())

    @property
    def pid(self) -> int:
        return self._process.pid

    def runs(self) -> bool:
        """Whether it does by itself, still."""
        return self._process.poll() is None

    def printed(self) -> str:
        """What it has printed since the last `leave`."""
        size = self._printed.seek(0, os.SEEK_END) - self._before
        return os.pread(self._printed.fileno(), size, self._before).decode(errors="replace")

    def leave(self) -> str:
        """What it has printed for this play; it stays for another one."""
        printed = self.printed()
        self._before = self._printed.tell()
        return printed

    def stop(self, *, kill: bool) -> str:
        """End it; what it has printed."""
        if kill:
            self._process.kill()
        else:
            self._process.terminate()
        await_end(self._process, _STOP_S)
        close_pipes(self._process)
        with self._printed:
            return self.printed()


_spare: collections.deque[_Router] = collections.deque()
"""Routers of this process that have served a play, and nothing was done to them."""


def _spare_one() -> _Router | None:
    """One that still runs, if there is any."""
    while _spare:
        with contextlib.suppress(IndexError):  # another thread was quicker
            router = _spare.pop()
            if router.runs():
                return router
            router.stop(kill=True)
    return None


class OwnRouter(Environment):
    """A router process on a port of loopback that stays the same for all its starts.

    ``untouched``: nothing is going to happen to it but sessions that come and go. Then it may be one that has served
    a play before, and serve another one afterwards: a start costs 25 ms of a core.
    """

    def __init__(self, ports: range, first: int, launch: Launcher = launch, *, untouched: bool = False) -> None:
        self._launch = launch
        self._ports = ports
        self._first = first
        self._untouched = untouched
        self._endpoint = ""
        self._router: _Router | None = None
        self._log = ""

    def start(self) -> None:
        """Raises `RmwError` CONNECTION_FAILED with what the router has printed."""
        if self.running:
            return
        router = _spare_one() if self._untouched and not self._endpoint else None
        if router is None:
            router = _Router(self.endpoint(), self._launch)
            if not router.came_up():
                printed = router.stop(kill=True)
                self._log += printed
                raise RmwError(ReturnCode.CONNECTION_FAILED, f"no router at {router.endpoint}: {printed[-500:]}")
        self._router, self._endpoint = router, router.endpoint

    def stop(self, *, kill: bool = False) -> None:
        router, self._router = self._router, None
        if router is not None:
            self._untouched = False
            self._log += router.stop(kill=kill)

    def release(self) -> None:
        router = self._router
        if router is None or not self._untouched or not router.runs():
            self.stop()
            return
        self._router = None
        self._log += router.leave()
        _spare.append(router)

    @property
    def running(self) -> bool:
        """Whether it has been started, and not stopped."""
        return self._router is not None

    def processes(self) -> Sequence[int]:
        router = self._router
        return () if router is None else (router.pid,)

    def endpoint(self) -> str:
        """Chosen when first asked for."""
        if not self._endpoint:
            self._endpoint = f"tcp/127.0.0.1:{self._free_port()}"
        return self._endpoint

    def log(self) -> str:
        return self._log + (self._router.printed() if self._router is not None else "")

    def _free_port(self) -> int:
        """One of the leased ports, which no other run uses; without a lease one that the kernel chooses."""
        places = len(self._ports)
        for step in range(places):
            port = self._ports[(self._first + step) % places]
            with contextlib.closing(socket.socket()) as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                with contextlib.suppress(OSError):
                    probe.bind(("127.0.0.1", port))
                    return port
        return free_port()


class GivenRouter(Environment):
    """A router that somebody else runs."""

    def __init__(self, locator: str) -> None:
        self._locator = locator
        self.not_ours = f"the router at {locator} is not ours to stop"

    def endpoint(self) -> str:
        return self._locator

    def stop(self, *, kill: bool = False) -> None:
        """Raises `RmwError` UNSUPPORTED."""
        raise RmwError(ReturnCode.UNSUPPORTED, self.not_ours)

    def log(self) -> str:
        return f"a router of somebody else at {self._locator}"
