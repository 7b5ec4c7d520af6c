"""The agent in a process of its own, for one play or for several one after the other."""

from __future__ import annotations

import collections
import contextlib
import json
import queue
import socket
import threading
from collections.abc import Mapping, Sequence
from typing import Any

from nros_backends.xrce.environment import OwnAgent, listed
from nros_backends.xrce.external import ASK, SAYS
from nros_conformance.rmw.backend import Listed
from nros_conformance.rmw.child import Launcher, await_end, close_pipes, launch

_START_S = 60.0
"""For a process to start and say so; 0.2 s on an idle host, more than 20 s on one with 35 busy threads a core."""

_STOP_S = 5.0
"""For a process to end by itself; then it is killed."""

_ANSWER_S = 5.0
"""For a process that runs to say something about itself."""


class _Process:
    """One life of an agent process (`external`)."""

    def __init__(self, port: int, launch: Launcher) -> None:
        self.port = port
        self._child = launch("nros_backends.xrce.external", [str(port)], None)
        self._answers: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._owed = 0
        """How many answers are still to come, of which only the last is wanted."""
        self._lines: list[str] = []
        self._before: Mapping[str, int] = {}
        """What it had counted for former plays."""
        self.latest: Mapping[str, int] = {}
        """What it had counted for this one when it was asked last."""
        self._reader = threading.Thread(target=self._read, name="xrce-agent-log", daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        return self._child.pid

    def runs(self) -> bool:
        """Whether it does by itself, still."""
        return self._child.poll() is None

    def came_up(self) -> bool:
        """Wait for it to say so; whether it did."""
        try:
            return bool(self._answers.get(timeout=_START_S))
        except queue.Empty:
            self._lines.append(f"nothing was heard of the process within {_START_S:.0f} s\n")
            return False

    def ask(self) -> dict[str, Any] | None:
        """What it says about itself; None when it is gone, or silent for 5 s."""
        assert self._child.stdin is not None
        try:
            self._child.stdin.write(ASK)
            self._child.stdin.flush()
            self._owed += 1
            line = b""
            while self._owed:
                line = self._answers.get(timeout=_ANSWER_S)
                self._owed -= 1
            answer: dict[str, Any] = json.loads(line)
        except (OSError, queue.Empty, ValueError):
            return None
        self.latest = {what: count - self._before.get(what, 0) for what, count in answer["counts"].items()}
        return answer

    def printed(self) -> str:
        """What it has printed for this play."""
        return "".join(self._lines)

    def leave(self) -> bool:
        """Stay for another play, if nothing is left of this one: whether it does."""
        answer = self.ask()
        if answer is None or answer["entities"]:
            return False
        self._before, self.latest = answer["counts"], {}
        self._lines = []
        return True

    def stop(self, *, kill: bool) -> None:
        """End it."""
        child = self._child
        assert child.stdin is not None
        if kill:
            child.kill()
        else:
            with contextlib.suppress(BrokenPipeError):
                child.stdin.close()
        await_end(child, _STOP_S)
        self._reader.join()
        close_pipes(child)

    def _read(self) -> None:
        assert self._child.stdout is not None
        for line in self._child.stdout:
            if line.startswith(b"{"):
                self._answers.put(line)
                continue
            self._lines.append(line.decode(errors="replace"))
            if line.startswith(SAYS.encode()):
                self._answers.put(line)
        self._answers.put(b"")


_spare: collections.deque[tuple[_Process, socket.socket]] = collections.deque()
"""Agents that have served a play, and nothing was done to them; with what keeps their ports."""


def _spare_one() -> tuple[_Process, socket.socket] | None:
    """One that still runs, if there is any."""
    while _spare:
        with contextlib.suppress(IndexError):  # another thread was quicker
            process, reservation = _spare.pop()
            if process.runs():
                return process, reservation
            process.stop(kill=True)
            reservation.close()
    return None


class ExternalAgent(OwnAgent):
    """The agent as a process; ``stop(kill=True)`` is a real SIGKILL.

    ``untouched``: nothing is going to happen to it but clients that come and go. Then it may be one that has served
    a play before, and serve another one afterwards: a start costs 17 ms of a core.
    """

    def __init__(
        self, ports: range = range(0), first: int = 0, launch: Launcher = launch, *, untouched: bool = False
    ) -> None:
        super().__init__(ports, first)
        self._launch = launch
        self._untouched = untouched
        self._process: _Process | None = None
        self._log = ""
        self._before: Mapping[str, int] = {}
        """What former lives had counted when they were asked last."""

    def start(self) -> None:
        spare = _spare_one() if self._untouched and not self._port else None
        if spare is None:
            super().start()
            return
        self._process, self._reservation = spare
        self._port, self.started = self._process.port, True

    def stop(self, *, kill: bool = False) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        self._untouched = False
        self._before = _sum(self._before, process.latest)
        process.stop(kill=kill)
        self._log += process.printed()

    def release(self) -> None:
        process, reservation = self._process, self._reservation
        printed = "" if process is None else process.printed()
        if process is None or reservation is None or not self._untouched or not process.leave():
            self.stop()
            return
        self._process = self._reservation = None
        self._log += printed
        _spare.append((process, reservation))

    def log(self) -> str:
        return self._log + (self._process.printed() if self._process is not None else "")

    def processes(self) -> Sequence[int]:
        process = self._process
        return () if process is None else (process.pid,)

    def entities(self) -> Sequence[Listed] | None:
        answer = self._ask()
        return [] if answer is None else listed(answer["entities"])

    def counts(self) -> Mapping[str, int]:
        self._ask()
        return self._before if self._process is None else _sum(self._before, self._process.latest)

    def _ask(self) -> dict[str, Any] | None:
        """What it says about itself; None when it does not run, or no more."""
        process = self._process
        return None if process is None else process.ask()

    def _serve(self, port: int) -> None:
        assert self._process is None
        process = _Process(port, self._launch)
        if process.came_up():
            self._process = process
            return
        process.stop(kill=True)
        self._log += process.printed()
        raise OSError(process.printed().rstrip().rpartition("\n")[2] or "the process ended without a word")


def _sum(one: Mapping[str, int], other: Mapping[str, int]) -> dict[str, int]:
    """Of counts; one that is 0 is a count too."""
    return {what: one.get(what, 0) + other.get(what, 0) for what in (*one, *other)}
