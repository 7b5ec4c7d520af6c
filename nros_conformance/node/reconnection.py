"""The reconnection state machine of micro-ROS' documents: an application that outlives its agent.

    WAITING_AGENT -> AGENT_AVAILABLE -> AGENT_CONNECTED -> AGENT_DISCONNECTED -> WAITING_AGENT

Wait until the peer (agent, router, broker) answers a ping; create what is needed; use it; when a ping within
the session or any call fails, destroy everything and begin anew. The ping of the connected state is the one
*within the session*: a peer that restarted between two pings answers a plain one and has forgotten the session.
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Callable
from datetime import timedelta
from typing import NamedTuple, Protocol

from nros_conformance.node.context import Context
from nros_conformance.node.executor import Executor
from nros_conformance.node.node import Node
from nros_conformance.rmw.backend import SessionOptions
from nros_conformance.rmw.clock import MS, Clock
from nros_conformance.rmw.codes import ReturnCode, RmwError, code_name
from nros_conformance.rmw.qos import milliseconds


class LinkState(enum.Enum):
    """Where the application stands; names as in micro-ROS."""

    WAITING_AGENT = "WAITING_AGENT"
    AGENT_AVAILABLE = "AGENT_AVAILABLE"
    AGENT_CONNECTED = "AGENT_CONNECTED"
    AGENT_DISCONNECTED = "AGENT_DISCONNECTED"


class Transition(NamedTuple):
    """A change of state: when (ns of the backend's clock), from where to where, and why."""

    at_ns: int
    before: LinkState
    state: LinkState
    reason: str


@dataclasses.dataclass(frozen=True, slots=True)
class Pace:
    """How often to ping, and how long to wait. A fraction of 1 ms rounds up."""

    ping_timeout: timedelta = timedelta(milliseconds=100)
    """For the answer to one ping."""
    attempts: int = 1
    """Pings that have to fail in a row, each with that timeout, before the peer counts as gone."""
    waiting: timedelta = timedelta(milliseconds=500)
    """From one failed attempt to connect to the next."""
    connected: timedelta = timedelta(milliseconds=500)
    """From one ping within the session to the next."""


class Hooks(Protocol):
    """What the state machine does to its surroundings. Codes are those of `ReturnCode`."""

    def probe(self, timeout_ms: int, attempts: int) -> int:
        """Ping before a session. UNSUPPORTED: it cannot be asked, so creating is the probe."""

    def create(self) -> None:
        """Create the session and all that is needed; raises `RmwError`."""

    def spin(self, timeout_ms: int) -> int:
        """Use it: drive the session for at most so long."""

    def check(self, timeout_ms: int, attempts: int) -> int:
        """Ping within the session. UNSUPPORTED: only the codes of `spin` tell."""

    def destroy(self) -> None:
        """Destroy what `create` made, also when it failed halfway; raises `RmwError` for what went wrong."""


class StateMachine:
    """The states and what is done in each, over `Hooks`; knows no backend.

    ``changed(transition)`` is told of every change of state, on the thread that steps.
    """

    def __init__(
        self, hooks: Hooks, clock: Clock, pace: Pace | None = None,
        changed: Callable[[Transition], object] | None = None,
    ) -> None:  # fmt: skip
        self.pace = pace or Pace()
        self.clock = clock
        self.state = LinkState.WAITING_AGENT
        self.connections = 0
        """How often it has reached AGENT_CONNECTED."""
        self._hooks = hooks
        self._changed = changed or (lambda transition: None)
        self._next_ns = clock.now_ns()
        """When to ping next."""
        self._failure = ""

    def step(self, timeout_ms: int = 0) -> LinkState:
        """Do what the present state asks for, once; the state afterwards.

        Lasts at most ``timeout_ms``, plus ``ping_timeout`` times ``attempts`` when a ping is due; creating
        and destroying with a dead peer last as long as the backend lets them (twice the connection lease, CON-006).
        """
        match self.state:
            case LinkState.WAITING_AGENT:
                self._wait(timeout_ms)
            case LinkState.AGENT_AVAILABLE:
                self._create()
            case LinkState.AGENT_CONNECTED:
                self._use(timeout_ms)
            case LinkState.AGENT_DISCONNECTED:
                self._begin_anew(self._destroy("destroyed"), self.clock.now_ns())
        return self.state

    def failed(self, reason: str) -> None:
        """The application has seen a failure itself, such as a publish that answered an error."""
        self._failure = self._failure or reason

    def leave(self) -> None:
        """Destroy what there is, and wait for the peer again from the next step on."""
        if self.state in (LinkState.AGENT_CONNECTED, LinkState.AGENT_DISCONNECTED):
            self._begin_anew(self._destroy("left"), self.clock.now_ns())

    def _wait(self, timeout_ms: int) -> None:
        until = self.clock.now_ns() + max(timeout_ms, 0) * MS
        if self._next_ns > self.clock.now_ns():
            self.clock.wait(None, min(until, self._next_ns))
        if self._next_ns > self.clock.now_ns():
            return
        code = self._hooks.probe(milliseconds(self.pace.ping_timeout), self.pace.attempts)
        if code in (ReturnCode.OK, ReturnCode.UNSUPPORTED):
            self._to(LinkState.AGENT_AVAILABLE, f"ping answered {code_name(code)}")
        else:
            self._next_ns = self.clock.now_ns() + milliseconds(self.pace.waiting) * MS

    def _create(self) -> None:
        try:
            self._hooks.create()
        except RmwError as error:
            reason = self._destroy(f"creating failed: {error}")
            self._begin_anew(reason, self.clock.now_ns() + milliseconds(self.pace.waiting) * MS)
            return
        self._failure = ""
        self._schedule_check()
        self.connections += 1
        self._to(LinkState.AGENT_CONNECTED, "created")

    def _use(self, timeout_ms: int) -> None:
        code = self._hooks.spin(max(timeout_ms, 0))
        if code != ReturnCode.OK:
            self.failed(f"drive_io answered {code_name(code)}")
        elif not self._failure and self.clock.now_ns() >= self._next_ns:
            code = self._hooks.check(milliseconds(self.pace.ping_timeout), self.pace.attempts)
            if code not in (ReturnCode.OK, ReturnCode.UNSUPPORTED):
                self.failed(f"ping answered {code_name(code)}")
            self._schedule_check()
        if self._failure:
            self._to(LinkState.AGENT_DISCONNECTED, self._failure)

    def _schedule_check(self) -> None:
        self._next_ns = self.clock.now_ns() + milliseconds(self.pace.connected) * MS

    def _destroy(self, reason: str) -> str:
        """Destroy everything; with a dead peer that may answer an error, which ends nothing."""
        try:
            self._hooks.destroy()
        except RmwError as error:
            return f"{reason}; {error}"
        return reason

    def _begin_anew(self, reason: str, next_ns: int) -> None:
        self._next_ns = next_ns
        self._to(LinkState.WAITING_AGENT, reason)

    def _to(self, state: LinkState, reason: str) -> None:
        before, self.state = self.state, state
        self._changed(Transition(self.clock.now_ns(), before, state, reason))


class Reconnector:
    """Keeps a node connected: `StateMachine` over a `Context`.

    ``create(node)`` makes the entities whenever a connection is new; `RmwError` out of it means that it
    failed. ``destroy()`` is called before that node is destroyed, also after a ``create`` that failed: forget the
    entities, which go with the node. ``options``: where the peer is (``locator``), lease, hard liveliness.
    """

    def __init__(
        self, context: Context, name: str, create: Callable[[Node], object], *,
        destroy: Callable[[], object] = lambda: None, options: SessionOptions | None = None, pace: Pace | None = None,
        changed: Callable[[Transition], object] | None = None,
    ) -> None:  # fmt: skip
        self._hooks = _NodeHooks(
            context, dataclasses.replace(options or SessionOptions(), node_name=name), create, destroy
        )
        self._machine = StateMachine(self._hooks, context.clock, pace, changed)

    @property
    def state(self) -> LinkState:
        """Where it stands."""
        return self._machine.state

    @property
    def node(self) -> Node | None:
        """The node while connected."""
        return self._hooks.node if self.state is LinkState.AGENT_CONNECTED else None

    @property
    def connections(self) -> int:
        """How often it has connected."""
        return self._machine.connections

    def spin_once(self, timeout: timedelta | int = 0) -> LinkState:
        """One step: ping, create, spin or destroy; the state afterwards. See `StateMachine.step` for how long.

        ``timeout``: a timedelta, or whole milliseconds. Raises what callbacks of the application raise.
        """
        return self._machine.step(milliseconds(timeout) if isinstance(timeout, timedelta) else timeout)

    def spin(self, duration: timedelta, until: Callable[[], bool] = lambda: False) -> bool:
        """Step for ``duration`` or until ``until()`` holds, which is looked at before each step; whether it held."""
        end = self._machine.clock.now_ns() + milliseconds(duration) * MS
        while not until():
            left = end - self._machine.clock.now_ns()
            if left <= 0:
                return False
            self.spin_once(min(10, -(-left // MS)))
        return True

    def failed(self, error: Exception | str) -> None:
        """Tell it of a failure that the application has seen itself: it connects anew."""
        self._machine.failed(str(error))

    def close(self) -> None:
        """Destroy the node, if there is one."""
        self._machine.leave()


class _NodeHooks:
    """A node and its executor, made anew for each connection."""

    def __init__(
        self, context: Context, options: SessionOptions, create: Callable[[Node], object],
        destroy: Callable[[], object],
    ) -> None:  # fmt: skip
        self._context = context
        self._options = options
        self._create = create
        self._destroy = destroy
        self.node: Node | None = None
        self._executor: Executor | None = None

    def probe(self, timeout_ms: int, attempts: int) -> int:
        return self._context.ping(timeout_ms, attempts, self._options)

    def create(self) -> None:
        self.node = self._context.create_node(self._options.node_name, self._options)
        self._executor = Executor(self.node)
        self._create(self.node)

    def spin(self, timeout_ms: int) -> int:
        assert self._executor is not None
        return self._executor.spin_once(timeout_ms)

    def check(self, timeout_ms: int, attempts: int) -> int:
        assert self.node is not None
        return int(self.node.session.ping(timeout_ms, attempts))

    def destroy(self) -> None:
        node, self.node, self._executor = self.node, None, None
        self._destroy()
        if node is not None:
            node.destroy()
