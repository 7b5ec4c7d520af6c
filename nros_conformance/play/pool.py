"""Worker processes, watched: a crash or hang costs the scenario that caused it, the rest goes on.

When a worker dies with several scenarios in flight, each of them is played again in a process of its
own, which tells who was to blame.
"""

from __future__ import annotations

import dataclasses
import os
import re
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from nros_conformance.play.autopsy import autopsy
from nros_conformance.play.launch import PLAIN, Launch
from nros_conformance.play.plan import Plan
from nros_conformance.play.processes import death
from nros_conformance.play.starvation import crowding
from nros_conformance.play.wire import Beat, Broken, Finished, Job, Started, decode_report, encode
from nros_conformance.trace.files import TraceWriter
from nros_conformance.trace.records import End

_CURRENT = re.compile(r"^Current thread .*\n", re.MULTILINE)
_THREAD = re.compile(r"^(?:Current thread|Thread) .*\n", re.MULTILINE)
_FRAME = re.compile(r"^  File \"([^\"]+)\", line (\d+) in (\S+)", re.MULTILINE)
_DRIVER = "play/driver.py"
_WORKER = (sys.executable, "-X", "faulthandler", "-m", "nros_conformance.play")
_WAITING = ("threading.py", "clock.py", "driver.py")

SILENCE_S = 20.0
"""A worker whose interpreter has not beaten for this long is held up by its backend. Forty beats: the
longest silence of a healthy worker on an overloaded host was 1.1 s in our measurements."""

PLAY_LIMIT_S = 60.0
"""A play that lasts this much longer than its script asks for is a hang that nothing inside noticed,
such as a loop that never ends on the virtual clock."""


class WorkerBroken(Exception):
    """The worker could not even load the adapter."""


@dataclasses.dataclass(frozen=True, slots=True)
class Ended:
    """One play: how it ended (as the `End` record says) and how long it took, s."""

    plan: Plan
    outcome: str
    seconds: float


@dataclasses.dataclass(frozen=True, slots=True)
class Casualty:
    """A worker died or was killed: ``what`` is crash or hang, ``keys`` were in flight, ``where`` if known."""

    what: str
    detail: str
    keys: tuple[str, ...]


class Pool:
    """Plays the plans of one backend in worker processes.

    ``ended`` hears of every play as it is complete, ``casualty`` of every process that was lost, each on the
    thread that called `play`; ``log`` gets what a worker has printed when it is gone, whole.
    """

    def __init__(
        self, log: Path, *, virtual: bool, ended: Callable[[Ended], None], casualty: Callable[[Casualty], None],
        silence_s: float = SILENCE_S, play_limit_s: float = PLAY_LIMIT_S, launch: Launch = PLAIN,
    ) -> None:  # fmt: skip
        self._log = log
        self._virtual = virtual
        self._ended = ended
        self._casualty = casualty
        self._silence_s = silence_s * launch.patience
        self._play_limit_s = play_limit_s * launch.patience
        self._launch = launch
        self._stopped = threading.Event()
        self._logging = threading.Lock()

    def stop(self) -> None:
        """End the workers; plays in flight are given up and their traces stay cut short."""
        self._stopped.set()

    def play(self, plans: Sequence[Plan], concurrency: int, place: int = 0) -> None:
        """Play all of them, at the places in the network from ``place`` on.

        Several threads may call it at once, with places of their own each. Raises `WorkerBroken` when the adapter
        does not load.
        """
        pending = [msgspec.structs.replace(plan, network=place) for plan in plans]
        while pending and not self._stopped.is_set():
            done, suspects = self._session(pending[: self._launch.group or None], concurrency)
            if len(suspects) > 1:
                for plan in suspects:
                    self._session([plan], 1)
            gone = {plan.key for plan in (*done, *suspects)}
            pending = [plan for plan in pending if plan.key not in gone]

    def _session(self, plans: Sequence[Plan], concurrency: int) -> tuple[list[Plan], list[Plan]]:
        """One worker process: what it finished, and what it died with."""
        with tempfile.NamedTemporaryFile(dir=self._log.parent, prefix="worker-", suffix=".log") as printed:
            log = Path(printed.name)
            try:
                watch = self._watched(plans, concurrency, log)
                if self._stopped.is_set() or not watch.in_flight:
                    return watch.done, []
                self._lost(watch, log)
                return watch.done, list(watch.in_flight.values())
            finally:
                with self._logging, self._log.open("ab") as all_of_them:
                    all_of_them.write(log.read_bytes())

    def _watched(self, plans: Sequence[Plan], concurrency: int, log: Path) -> _Watch:
        """Start a worker and listen to it until it is gone."""
        ours, theirs = socket.socketpair()
        with ours, log.open("ab") as output:
            watched = self._launch.debug
            process = subprocess.Popen(
                self._launch.command([*_WORKER, str(theirs.fileno())]), pass_fds=[theirs.fileno()],
                stdin=None if watched else subprocess.DEVNULL, stdout=None if watched else output,
                stderr=None if watched else output, env=_environment(),
            )  # fmt: skip
            theirs.close()
            try:
                watch = _Watch(process, ours, plans, self)
                ours.sendall(encode(Job(list(plans), 1 if watched else min(concurrency, len(plans)), self._virtual)))
                watch.listen()
            finally:
                if process.poll() is None:
                    process.kill()
                process.wait()
        return watch

    def _lost(self, watch: _Watch, log: Path) -> None:
        """A worker died: report it, and end the trace if there is one suspect only."""
        suspects = list(watch.in_flight.values())
        what = "hang" if watch.killed else "crash"
        where = _where(log.read_text(errors="replace"), what)
        detail = watch.killed or f"the process {death(watch.process.returncode)}"
        detail += f", {where}" if where else ""
        if self._launch.debugger and what == "crash" and len(suspects) == 1:
            native = autopsy(self._launch.debugger, _WORKER, _environment(), suspects[0], log, virtual=self._virtual)
            detail += f"; natively in {native}" if native else ""
        self._casualty(Casualty(what, detail, tuple(watch.in_flight)))
        if len(suspects) == 1:
            plan = suspects[0]
            file = Path(plan.trace)
            begun = file.is_file() and b"\n" in file.read_bytes()
            with TraceWriter(file, append=begun) as writer:
                if not begun:  # it died before it had written anything
                    writer.write(plan.header)
                writer.write(End(outcome=what, t=time.monotonic_ns(), detail=detail))
            self._ended(Ended(plan, what, 0.0))

    @property
    def stopped(self) -> bool:
        """Whether `stop` was called."""
        return self._stopped.is_set()

    def finished(self, ended: Ended) -> None:
        """Pass on a play that ended by itself."""
        self._ended(ended)


class _Watch:
    """Listens to one worker until it is done, dead, or has to be killed."""

    def __init__(
        self, process: subprocess.Popen[bytes], ours: socket.socket, plans: Sequence[Plan], pool: Pool
    ) -> None:
        self.process = process
        self._socket = ours
        self._plans = {plan.key: plan for plan in plans}
        self._pool = pool
        self._begun: dict[str, float] = {}
        self.in_flight: dict[str, Plan] = {}
        self.done: list[Plan] = []
        self.killed = ""

    def listen(self) -> None:
        buffer = b""
        heard = time.monotonic()
        while True:
            readable, _, _ = select.select([self._socket], [], [], 0.25)
            now = time.monotonic()
            if self._pool.stopped:
                return
            if readable:
                data = _receive(self._socket)
                if not data:
                    return
                heard = now
                *lines, buffer = (buffer + data).split(b"\n")
                for line in lines:
                    self._hear(line, now)
            elif now - heard > self._pool._silence_s:
                self._kill(f"the process has not run for {self._pool._silence_s:.0f} s")
                return
            if late := self._late(now):
                self.in_flight = {key: self.in_flight[key] for key in late}
                self._kill("the play did not end")
                return

    def _late(self, now: float) -> list[str]:
        """The plays that should have ended by now. How crowded the host is is asked only when there may be some."""
        over = {key: now - begun - self._expected(key) for key, begun in self._begun.items()}
        if max(over.values(), default=0) <= self._pool._play_limit_s:
            return []
        grace = self._pool._play_limit_s * crowding()
        return [key for key, seconds in over.items() if seconds > grace]

    def _expected(self, key: str) -> float:
        return self._plans[key].expected_ns / 1e9 * (0 if self._pool._virtual else 4)

    def _hear(self, line: bytes, now: float) -> None:
        match decode_report(line):
            case Started(key):
                self.in_flight[key] = self._plans[key]
                self._begun[key] = now
            case Finished(key, outcome, seconds):
                plan = self.in_flight.pop(key)
                del self._begun[key]
                self.done.append(plan)
                self._pool.finished(Ended(plan, outcome, seconds))
            case Broken(detail):
                raise WorkerBroken(detail)
            case Beat():
                pass

    def _kill(self, why: str) -> None:
        self.killed = why
        # The traceback of every thread goes to the log first: it says where the backend is stuck.
        self.process.send_signal(signal.SIGABRT)
        try:
            self.process.wait(timeout=2)
        except subprocess.TimeoutExpired:
            self.process.kill()


def _environment() -> dict[str, str]:
    """A worker finds the modules that the harness finds, also where pytest or somebody else has added a path."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(part or str(Path.cwd()) for part in sys.path)}


def _receive(connection: socket.socket) -> bytes:
    try:
        return connection.recv(65536)
    except ConnectionResetError:
        return b""


def _where(text: str, what: str) -> str:
    """The frame in which the backend crashed or is stuck, from faulthandler's report of all threads."""
    stacks = [_FRAME.findall(stack) for stack in _THREAD.split(text)[1:]]
    if what == "crash":
        current = _CURRENT.split(text)
        guilty = [_FRAME.findall(current[1].partition("\n\n")[0])] if len(current) > 1 else []
    else:  # a thread that was called by a session's thread and does not wait for one of ours
        guilty = [stack for stack in stacks if any(frame[0].endswith(_DRIVER) for frame in stack)]
        guilty = [stack for stack in guilty if not stack[0][0].endswith(_WAITING)]
    if not guilty or not guilty[0]:
        return ""
    file_name, line, function = guilty[0][0]
    return f"in {function} at {Path(file_name).name}:{line}"
