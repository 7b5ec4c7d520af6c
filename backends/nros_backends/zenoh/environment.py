"""The router beside the sessions: a process of our own on loopback, or one that the command line names."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import subprocess
import tempfile
from collections.abc import Sequence
from typing import IO

from nros_backends.zenoh.config import LEASE_MS, free_port
from nros_conformance.rmw.backend import Environment
from nros_conformance.rmw.child import Child, Launch, launch
from nros_conformance.rmw.codes import ReturnCode, RmwError

_START_S = 20.0
"""A start takes 0.1 s; more is a host that has come to a standstill."""

_STOP_S = 5.0


class OwnRouter(Environment):
    """A router process on a port of loopback that stays the same for all its starts."""

    def __init__(self, ports: range, first: int, launch: Launch = launch) -> None:
        self._launch = launch
        self._ports = ports
        self._first = first
        self._endpoint = ""
        self._process: Child | None = None
        self._log: IO[bytes] | None = None

    def start(self) -> None:
        """Raises `RmwError` CONNECTION_FAILED with what the router has printed."""
        if self.running:
            return
        if self._log is None:
            self._log = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `close`
        self._process = self._launch("nros_backends.zenoh.router", [self.endpoint(), str(LEASE_MS)], self._log)
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], _START_S)
        if not ready or not self._process.stdout.readline():
            self.stop(kill=True)
            raise RmwError(ReturnCode.CONNECTION_FAILED, f"no router at {self._endpoint}: {self.log()[-500:]}")

    def stop(self, *, kill: bool = False) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        assert process.stdin is not None
        assert process.stdout is not None
        if kill:
            process.kill()
        else:
            process.terminate()
        try:
            process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()  # it was frozen, or does not end
            process.wait()
        with contextlib.suppress(BrokenPipeError):
            process.stdin.close()
        process.stdout.close()

    def close(self) -> None:
        """Stop it for good."""
        self.stop()
        if self._log is not None:
            self._log.close()
            self._log = None

    @property
    def running(self) -> bool:
        """Whether it has been started, and not stopped."""
        return self._process is not None

    def processes(self) -> Sequence[int]:
        process = self._process
        return () if process is None else (process.pid,)

    def endpoint(self) -> str:
        """Chosen when first asked for."""
        if not self._endpoint:
            self._endpoint = f"tcp/127.0.0.1:{self._free_port()}"
        return self._endpoint

    def log(self) -> str:
        if self._log is None:
            return ""
        size = self._log.seek(0, os.SEEK_END)
        return os.pread(self._log.fileno(), size, 0).decode(errors="replace")

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
