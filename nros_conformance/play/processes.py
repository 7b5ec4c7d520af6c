"""Processes that host one session each, so that a fault can hit it: started, frozen, thawed, killed."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from multiprocessing.connection import Connection, Pipe
from pathlib import Path

from nros_conformance.play.faketime import preload
from nros_conformance.play.forked import Forked
from nros_conformance.rmw.clock import MS

_FREEZE_LIMIT_NS = 2_000 * MS
"""A process that the kernel cannot stop within this hangs in the kernel itself."""


def _enter(connection: Connection) -> None:
    from nros_conformance.play.session_process import serve  # it imports the player, which imports this module

    serve(connection)


class SessionProcess:
    """A process and the connection to it.

    Forked, unless its wall clock can be set: then it is a new interpreter, and ``wall_clock`` the file that says
    how. Raises `NoFaketime`.
    """

    def __init__(self, name: str, wall_clock: Path | None = None) -> None:
        self._popen: subprocess.Popen[bytes] | None = None
        self._forked: Forked | None = None
        self._wall_clock = wall_clock
        self._offset_ns = 0
        self.frozen = False
        if wall_clock is None:
            self._fork(name)
        else:
            self._spawn(wall_clock)

    def _fork(self, name: str) -> None:
        self.connection, theirs = Pipe()
        with theirs:
            self._forked = Forked(name, _enter, (theirs,))
        self.pid = self._forked.pid

    def _spawn(self, wall_clock: Path) -> None:
        wall_clock.parent.mkdir(parents=True, exist_ok=True)
        self._set(wall_clock)
        environment = preload(wall_clock)
        ours, theirs = socket.socketpair()
        with theirs:
            self._popen = subprocess.Popen(
                [sys.executable, "-m", "nros_conformance.play.session_process", str(theirs.fileno())],
                pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL, env={**os.environ, **environment},
            )  # fmt: skip
        self.connection = Connection(ours.detach())
        self.pid = self._popen.pid

    def kill(self) -> None:
        """SIGKILL; returns when the process is gone."""
        self._signal(signal.SIGKILL)
        self.wait(5.0)

    def freeze(self) -> None:
        """SIGSTOP; returns when the kernel has stopped every thread. Raises TimeoutError."""
        self._signal(signal.SIGSTOP)
        self.frozen = True
        limit = time.monotonic_ns() + _FREEZE_LIMIT_NS
        while not all(state == "T" for state in self._states()):
            if time.monotonic_ns() > limit:
                raise TimeoutError(f"process {self.pid} has not stopped within {_FREEZE_LIMIT_NS // MS} ms")
            time.sleep(0.0002)

    def thaw(self) -> None:
        """SIGCONT."""
        self._signal(signal.SIGCONT)
        self.frozen = False

    def step_clock(self, by_ns: int) -> None:
        """Set the wall clock of the process forward, or back; its monotonic clock goes on as before."""
        assert self._wall_clock is not None
        self._offset_ns += by_ns
        self._set(self._wall_clock)

    def _set(self, wall_clock: Path) -> None:
        new = wall_clock.with_suffix(".new")
        new.write_text(f"{self._offset_ns / 1e9:+.6f}\n")
        new.replace(wall_clock)

    def wait(self, timeout_s: float) -> int | None:
        """The exit code (negative: the signal that killed it), or None when it still runs."""
        if self._forked is not None:
            return self._forked.wait(timeout_s)
        assert self._popen is not None
        try:
            return self._popen.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return None

    def _signal(self, number: int) -> None:
        with contextlib.suppress(ProcessLookupError):  # it has died by itself, which its connection tells
            os.kill(self.pid, number)

    def _states(self) -> list[str]:
        # The state follows the name, which stands in brackets and may contain anything.
        tasks = Path(f"/proc/{self.pid}/task").glob("*/stat")
        return [task.read_text().rpartition(")")[2].split()[0] for task in tasks]


def death(code: int | None) -> str:
    """How a process ended, in words."""
    if code is None:
        return "has closed its connection but still runs"
    return f"died of {signal.Signals(-code).name}" if code < 0 else f"exited with code {code}"
