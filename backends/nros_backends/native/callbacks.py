"""Callbacks from C: found again by the context that comes back, and kept for as long as C may call them.

The boundary has no unregister, so neither the function nor the context of a registration is ever freed.
An exception cannot pass through C: it is raised again by the call of ours that C called back from.
"""

from __future__ import annotations

import ctypes as ct
import itertools
import struct
import threading
import traceback
from typing import Any

from nros_backends.native.abi import EventFunction
from nros_conformance.rmw.events import (
    CountStatus,
    EventCallback,
    EventKind,
    EventStatus,
    LivelinessChangedStatus,
)

_STEP = 16
"""Contexts are multiples of it, so that none looks like a small number or like another one's neighbour."""

_PAYLOAD = 8


class Calls(threading.local):
    """Held around every call into the library; raises on leaving what a callback raised meanwhile."""

    def __init__(self) -> None:
        self.depth = 0
        self.raised: list[BaseException] = []

    def __enter__(self) -> None:
        self.depth += 1

    def __exit__(self, *_: object) -> None:
        self.depth -= 1
        if self.raised and not self.depth:
            error, self.raised = self.raised[0], []
            raise error


class Callbacks:
    """All registrations of a library, in this process."""

    def __init__(self) -> None:
        self._contexts: dict[int, object] = {}
        self._functions: list[Any] = []
        self._numbers = itertools.count(1)
        self.calls = Calls()

    def make(self, kind: int, callback: EventCallback, context: object) -> tuple[Any, int]:
        """The function and the context to register.

        ``kind`` says how a payload is read whose own kind is unknown. The context handed to ``callback`` is
        the one that belongs to the pointer that came back, whoever's that is (REG-006).
        """
        user = next(self._numbers) * _STEP
        self._contexts[user] = context

        def called(given: int, payload: int | None, pointer: int | None) -> None:
            try:
                known = self._contexts.get(pointer or 0, f"a context that nobody registered: {pointer or 0:#x}")
                callback(given, _status(given, kind, payload), known)
            except BaseException as error:
                if self.calls.depth:
                    self.calls.raised.append(error)
                else:  # on a thread of the backend's: there is no call of ours to raise it from
                    traceback.print_exception(error)

        function = EventFunction(called)
        self._functions.append(function)
        return function, user


def _status(kind: int, registered: int, payload: int | None) -> EventStatus:
    """The payload by the kind that came with it, else by the one that was registered; zeros without one."""
    data = bytes(_PAYLOAD) if payload is None else ct.string_at(payload, _PAYLOAD)
    known = kind if kind in tuple(EventKind) else registered
    if known == EventKind.LIVELINESS_CHANGED:
        return LivelinessChangedStatus(*struct.unpack("=HHhh", data))
    return CountStatus(*struct.unpack("=II", data))
