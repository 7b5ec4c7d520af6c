"""Where an application meets a middleware: a backend by name, its clock, and the nodes on it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from datetime import timedelta
from types import TracebackType

from nros_conformance.node.node import Node
from nros_conformance.rmw.backend import Backend, Environment, Host, SessionOptions
from nros_conformance.rmw.clock import Clock, MonotonicClock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.qos import milliseconds


class Context:
    """A backend in use; as a context manager it closes what it has opened.

    ``backend``: the name of an installed one, ``module:Class``, or an instance, which then stays open.
    ``host``: what a backend made from a name is lent; without it the real clock, and the network that
    the backend has by default.

    Raises `RmwError` UNKNOWN_BACKEND when there is none of that name, NO_BACKEND when its middleware is
    missing here; both texts say what to do.
    """

    def __init__(self, backend: str | Backend, host: Host | None = None) -> None:
        self._owned = isinstance(backend, str)
        if isinstance(backend, str):
            backend = _adapter(backend)(host or Host(MonotonicClock()))
        elif host is not None:
            raise TypeError("a backend that exists has its host already")
        self.backend = backend
        self._environment: Environment | None = None
        self._nodes: dict[Node, None] = {}

    @property
    def clock(self) -> Clock:
        """The clock that the backend lives by."""
        return self.backend.host.clock

    def create_node(self, name: str, options: SessionOptions | None = None) -> Node:
        """A node, which is one session. ``name`` replaces the one in ``options``.

        Without a locator, a backend that needs a peer (agent, router, broker) gets its own beside it.
        Raises `RmwError` CONNECTION_FAILED, INVALID_ARGUMENT, INVALID_CONFIG...
        """
        options = self.located(dataclasses.replace(options or SessionOptions(), node_name=name))
        node = Node(self.backend.create_session(options), name, self.clock, self._nodes.pop)
        self._nodes[node] = None
        return node

    def ping(self, timeout: timedelta | int, attempts: int = 1, options: SessionOptions | None = None) -> int:
        """Ping the peer without a session: OK, TIMEOUT, or UNSUPPORTED where there is nothing to ask.

        ``timeout`` of one attempt: a timedelta (a fraction of 1 ms rounds up), or whole milliseconds.
        """
        timeout_ms = milliseconds(timeout) if isinstance(timeout, timedelta) else timeout
        return int(self.backend.ping(self.located(options or SessionOptions()), timeout_ms, attempts))

    def located(self, options: SessionOptions) -> SessionOptions:
        """With the locator of this context's own peer, which is started for it, where ``options`` has none."""
        return options if options.locator else dataclasses.replace(options, locator=self._peer().endpoint())

    def close(self) -> None:
        """Destroy the nodes, then stop the peer and the backend if they are this context's own.

        Goes through with all of it; raises the last failure, chained to those before.
        """
        environment, self._environment = self._environment, None
        steps: list[Callable[[], object]] = [node.destroy for node in reversed(self._nodes)]
        if environment is not None:
            steps.append(environment.stop)
        if self._owned:
            steps.append(self.backend.close)
        _all_of(steps)

    def __enter__(self) -> Context:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:  # fmt: skip
        self.close()

    def _peer(self) -> Environment:
        if self._environment is None:
            environment = self.backend.environment()
            environment.start()
            self._environment = environment
        return self._environment


def _all_of(steps: list[Callable[[], object]]) -> None:
    if steps:
        try:
            steps[0]()
        finally:
            _all_of(steps[1:])


def _adapter(name: str) -> type[Backend]:
    from nros_conformance.formats.places import FormatError
    from nros_conformance.rmw.discovery import BackendNotFound, find_backend  # entry points cost start-up time

    try:
        found = find_backend(name)
    except BackendNotFound as error:
        raise RmwError(ReturnCode.UNKNOWN_BACKEND, str(error)) from error
    try:
        return found.load()
    except ImportError as error:
        install = found.declaration.subject.install if found.declaration is not None else ""
        raise RmwError(ReturnCode.NO_BACKEND, f"{error}" + (f"; {install}" if install else "")) from error
    except FormatError as error:
        raise RmwError(ReturnCode.UNKNOWN_BACKEND, str(error)) from error
