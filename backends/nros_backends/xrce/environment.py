"""The agent beside the sessions: in a thread of this process, in a process of its own, or the user's.

An own agent has the same UDP port in all its lives. So that nobody takes it while the agent is down, the
TCP port of the same number is held all the time, by which all that do so agree.
"""

from __future__ import annotations

import contextlib
import json
import queue
import socket
import subprocess
import threading
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from nros_backends.xrce.agent.core import EntityInfo
from nros_backends.xrce.agent.server import AgentServer
from nros_backends.xrce.client.client import ping_agent
from nros_backends.xrce.external import ASK, LOOPBACK, SAYS, Pings, endpoints
from nros_backends.xrce.link import Link
from nros_backends.xrce.policies import given_topic
from nros_conformance.rmw.backend import Environment, Listed
from nros_conformance.rmw.child import Child, Launch, launch
from nros_conformance.rmw.clock import MS, Clock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import Side

_PORT_TRIES = 64

_START_S = 60.0
"""For a process to start and say so; 0.2 s on an idle host, more than 20 s on one with 35 busy threads a core."""

_STOP_S = 5.0
"""For a process to end by itself; then it is killed."""

_REACH_NS = 1_000 * MS
_REACH_ATTEMPTS = 3

_ANSWER_S = 5.0
"""For a process that runs to say something about itself."""


class OwnAgent(Environment):
    """What the two agents of this project have in common: a port of their own."""

    def __init__(self, ports: range, first: int) -> None:
        self._ports = ports
        self._first = first
        self._port = 0
        self._reservation: socket.socket | None = None
        self.started = False
        """Whether it ever was, or somebody else takes care of that."""

    def start(self) -> None:
        """Start it, at the same port each time. Raises `RmwError` CONNECTION_FAILED."""
        self.started = True
        problem = "there is no free port"
        for port in [self._port] if self._port else self._candidates():
            reservation = self._reservation or _reserve(port)
            if reservation is None:
                continue
            try:
                self._serve(port)
            except OSError as error:
                problem = f"port {port}: {error.strerror or error}"
                if self._reservation is None:
                    reservation.close()
                continue
            self._port, self._reservation = port, reservation
            return
        raise RmwError(ReturnCode.CONNECTION_FAILED, f"the agent did not start: {problem}")

    def endpoint(self) -> str:
        return f"{LOOPBACK}:{self._port}" if self._port else ""

    def close(self) -> None:
        """Stop it for good, and give its port back."""
        self.stop()
        if self._reservation is not None:
            self._reservation.close()
            self._reservation = None
        self._port = 0

    def _candidates(self) -> Iterator[int]:
        """From the end of the leased range: other backends of the run begin at its start."""
        if self._ports:
            for step in range(min(_PORT_TRIES, len(self._ports))):
                yield self._ports[-1 - (self._first + step) % len(self._ports)]
        for _ in range(_PORT_TRIES):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.bind((LOOPBACK, 0))
                port: int = probe.getsockname()[1]
            yield port

    def _serve(self, port: int) -> None:
        """Serve at this port; raises OSError when it cannot be had."""
        raise NotImplementedError


class EmbeddedAgent(OwnAgent):
    """`AgentServer` in a thread of this process. Killed or stopped in an orderly way, it forgets all the same."""

    def __init__(self, ports: range = range(0), first: int = 0) -> None:
        super().__init__(ports, first)
        self._server: AgentServer | None = None
        self._pings = Pings()

    def stop(self, *, kill: bool = False) -> None:
        server, self._server = self._server, None
        if server is not None:
            server.close()

    def graph(self) -> tuple[EntityInfo, ...]:
        """All entities of all clients now."""
        server = self._server
        return () if server is None else server.entities()

    def entities(self) -> Sequence[Listed]:
        return _listed(endpoints(self.graph()))

    def counts(self) -> Mapping[str, int]:
        return dict(self._pings.counts)

    def _serve(self, port: int) -> None:
        assert self._server is None
        self._server = AgentServer(port, LOOPBACK, self._pings.watch)
        self._server.start()


class ExternalAgent(OwnAgent):
    """The agent as a process (`external`); ``stop(kill=True)`` is a real SIGKILL."""

    def __init__(self, ports: range = range(0), first: int = 0, launch: Launch = launch) -> None:
        super().__init__(ports, first)
        self._launch = launch
        self._process: Child | None = None
        self._reader: threading.Thread | None = None
        self._answers: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._lines: list[str] = []
        self._before: Counter[str] = Counter()
        """What former lives had counted when they were asked last."""
        self._latest: Mapping[str, int] = {}

    def stop(self, *, kill: bool = False) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        self._before.update(self._latest)
        self._latest = {}
        assert process.stdin is not None
        if kill:
            process.kill()
        else:
            process.stdin.close()
        try:
            process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        self._forget(process)

    def log(self) -> str:
        return "".join(self._lines)

    def processes(self) -> Sequence[int]:
        process = self._process
        return () if process is None else (process.pid,)

    def entities(self) -> Sequence[Listed] | None:
        answer = self._ask()
        return [] if answer is None else _listed(answer["entities"])

    def counts(self) -> Mapping[str, int]:
        self._ask()
        return self._before + Counter(self._latest) if self._latest or self._before else {}

    def _ask(self) -> dict[str, Any] | None:
        """What it says about itself; None when it does not run, or no more."""
        process = self._process
        if process is None:
            return None
        assert process.stdin is not None
        try:
            process.stdin.write(ASK)
            process.stdin.flush()
            answer: dict[str, Any] = json.loads(self._answers.get(timeout=_ANSWER_S))
        except (OSError, queue.Empty):
            return None
        self._latest = answer["counts"]
        return answer

    def _serve(self, port: int) -> None:
        assert self._process is None
        process = self._launch("nros_backends.xrce.external", [str(port)], None)
        assert process.stdout is not None
        answers: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        lines, output = self._lines, process.stdout

        def read() -> None:
            for line in output:
                if line.startswith(b"{"):
                    answers.put(line)
                    continue
                lines.append(line.decode(errors="replace"))
                if line.startswith(SAYS.encode()):
                    answers.put(line)
            answers.put(b"")

        self._reader = threading.Thread(target=read, name="xrce-agent-log", daemon=True)
        self._reader.start()
        try:
            said = answers.get(timeout=_START_S)
        except queue.Empty:
            said = b""
            lines.append(f"nothing was heard of the process within {_START_S:.0f} s\n")
        if said:
            self._process, self._answers = process, answers
            return
        process.kill()
        process.wait()
        self._forget(process)
        raise OSError(lines[-1].strip() if lines else "the process ended without a word")

    def _forget(self, process: Child) -> None:
        if self._reader is not None:
            self._reader.join()
            self._reader = None
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with contextlib.suppress(BrokenPipeError):
                    pipe.close()


class UserAgent(Environment):
    """Somebody else's agent, which can be pinged and not be stopped."""

    def __init__(self, address: tuple[str, int], clock: Clock) -> None:
        self.address = address
        self._clock = clock
        self.not_ours = f"the agent at {self.endpoint()} is not ours to stop"

    def start(self) -> None:
        """Raises `RmwError` CONNECTION_FAILED when it does not answer a ping."""
        attachment = Link(self.address).open()
        try:
            reached = ping_agent(attachment.transport, self._clock, _REACH_NS, _REACH_ATTEMPTS)
        finally:
            attachment.close()
        if not reached:
            raise RmwError(ReturnCode.CONNECTION_FAILED, f"no XRCE agent answers at {self.endpoint()}")

    def stop(self, *, kill: bool = False) -> None:
        """Raises `RmwError` UNSUPPORTED."""
        raise RmwError(ReturnCode.UNSUPPORTED, self.not_ours)

    def endpoint(self) -> str:
        return f"{self.address[0]}:{self.address[1]}"


def _listed(found: Iterable[Sequence[str]]) -> list[Listed]:
    sides = {"DATAWRITER": Side.PUBLISHER, "DATAREADER": Side.SUBSCRIPTION}
    return [Listed(sides[kind], given_topic(name)) for kind, name in found]


def _reserve(port: int) -> socket.socket | None:
    """The TCP port of this number, or None when somebody has it."""
    holder = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        holder.bind((LOOPBACK, port))
    except OSError:
        holder.close()
        return None
    return holder
