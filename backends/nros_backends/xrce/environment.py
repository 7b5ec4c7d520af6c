"""The agent beside the sessions: in a thread of this process, in a process of its own, or the user's.

An own agent has the same UDP port in all its lives. So that nobody takes it while the agent is down, the
TCP port of the same number is held all the time, by which all that do so agree.
"""

from __future__ import annotations

import socket
from collections.abc import Iterable, Iterator, Mapping, Sequence

from nros_backends.xrce.agent.core import EntityInfo
from nros_backends.xrce.agent.server import AgentServer
from nros_backends.xrce.client.client import ping_agent
from nros_backends.xrce.external import LOOPBACK, Pings, endpoints
from nros_backends.xrce.link import Link
from nros_backends.xrce.policies import given_topic
from nros_conformance.rmw.backend import Environment, Listed
from nros_conformance.rmw.clock import MS, Clock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import Side

_PORT_TRIES = 64

_REACH_NS = 1_000 * MS
_REACH_ATTEMPTS = 3


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
        return listed(endpoints(self.graph()))

    def counts(self) -> Mapping[str, int]:
        return dict(self._pings.counts)

    def _serve(self, port: int) -> None:
        assert self._server is None
        self._server = AgentServer(port, LOOPBACK, self._pings.watch)
        self._server.start()


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


def listed(found: Iterable[Sequence[str]]) -> list[Listed]:
    """Data writers and readers, kind and DDS topic each, as the harness asks for them."""
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
