"""Processes that host one session each, so that a fault can hit it: started, frozen, thawed, killed."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from multiprocessing.connection import Connection, Pipe
from pathlib import Path

from nros_conformance.play.forked import Forked
from nros_conformance.play.preloaded import Preloaded
from nros_conformance.rmw.clock import MS

START_NS = 60_000 * MS
"""For a process to start: 0.2 s on an idle host, and more than 7 s were seen on a crowded one."""

_FREEZE_LIMIT_NS = 2_000 * MS
"""A process that the kernel cannot stop within this hangs in the kernel itself."""


def _enter(connection: Connection) -> None:
    from nros_conformance.play.session_process import serve  # it imports the player, which imports this module

    serve(connection)


class SessionProcess:
    """A process and the connection to it.

    ``stepped``: it can set its wall clock. Raises `NoFaketime` then, and as `Preloaded`.
    """

    def __init__(self, name: str, *, stepped: bool = False) -> None:
        self.frozen = False
        self.connection, theirs = Pipe()
        with theirs:
            self._process: Forked | Preloaded = (
                Preloaded(theirs, START_NS / 1e9) if stepped else Forked(name, _enter, (theirs,))
            )
        self.pid = self._process.pid

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

    def wait(self, timeout_s: float) -> int | None:
        """The exit code (negative: the signal that killed it), or None when it still runs."""
        return self._process.wait(timeout_s)

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
