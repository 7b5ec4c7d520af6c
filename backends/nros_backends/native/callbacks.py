"""Callbacks from C: found again by the context that comes back, and told apart when they come too late.

The boundary has no unregister, so a library may call a function that it was given for as long as the process
lives: functions are never freed, and used again only after a rest. Callback and context of the user are let
go with their entity all the same (LIF-003). A later call is told to the callback's ``late`` (DSP-004).
An exception cannot pass through C: it is raised again by the call of ours that C called back from.
"""

from __future__ import annotations

import collections
import ctypes as ct
import itertools
import struct
import sys
import threading
import traceback
import weakref
from typing import Any

from nros_backends.native.abi import EventFunction
from nros_conformance.rmw.events import (
    CountStatus,
    EventCallback,
    EventKind,
    EventStatus,
    LivelinessChangedStatus,
    kind_label,
    late_callback,
)

_STEP = 16
"""Contexts are multiples of it, so that none looks like a small number or like another one's neighbour."""

_PAYLOAD = 8
_REST = 64
"""Functions that rest before one is used again: a late call mostly meets none that serves somebody else."""

RELEASED = "a context that was released"


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


class Registration:
    """One, from the call that made it until nobody wants to know of late calls any more."""

    def __init__(self, function: Function, pointer: int, kind: int, callback: EventCallback, context: object) -> None:
        self.function = function
        self.pointer = pointer
        self.kind = kind
        self.callback: EventCallback | None = callback
        self.context = context
        self.late = late_callback(callback)

    def call(self, kind: int, status: EventStatus, context: object) -> None:
        """The callback; ``late`` once it is released. Raises RuntimeError when that has nobody to tell."""
        if self.callback is not None:
            self.callback(kind, status, context)
        elif self.late is not None:
            self.late(kind, status, context)
        else:
            raise RuntimeError(f"the library called back, {kind_label(kind)}, for an entity that is destroyed")


class Function:
    """What C calls. It serves one registration after the other."""

    def __init__(self, called: Any) -> None:
        self.pointer = EventFunction(lambda kind, payload, context: called(self, kind, payload, context))
        self.serves: weakref.ref[Registration] | None = None


class Callbacks:
    """All registrations of a library, in this process."""

    def __init__(self) -> None:
        self._live: set[Registration] = set()
        self._known: weakref.WeakValueDictionary[int, Registration] = weakref.WeakValueDictionary()
        self._resting: collections.deque[Function] = collections.deque()
        self._numbers = itertools.count(1)
        self.calls = Calls()

    def make(self, kind: int, callback: EventCallback, context: object) -> Registration:
        """The function and the context to register, kept until it is released.

        ``kind`` says how a payload is read whose own kind is unknown. The context handed to ``callback`` is
        the one that belongs to the pointer that came back, whoever's that is (REG-006).
        """
        function = self._resting.popleft() if len(self._resting) > _REST else Function(self._called)
        made = Registration(function, next(self._numbers) * _STEP, kind, callback, context)
        function.serves = weakref.ref(made)
        self._live.add(made)
        self._known[made.pointer] = made
        return made

    def release(self, one: Registration) -> None:
        """Let callback and context go. Late calls are told for as long as somebody keeps the registration."""
        if one.callback is not None:
            one.callback = one.context = None
            self._live.remove(one)
            self._resting.append(one.function)

    def _called(self, function: Function, kind: int, payload: int | None, pointer: int | None) -> None:
        try:
            given = self._known.get(pointer or 0)
            serves = function.serves() if function.serves is not None else None
            if given is not None and given.function is function:
                one, context = given, given.context if given.callback is not None else ""
            elif serves is None:
                sys.stderr.write(f"the library called back, {kind_label(kind)}, when its play was over\n")
                return
            elif given is not None:  # the function of one registration, the context of another
                one, context = serves, given.context if given.callback is not None else RELEASED
            else:
                one, context = serves, f"a context that nobody registered: {pointer or 0:#x}"
            one.call(kind, _status(kind, one.kind, payload), context)
        except BaseException as error:
            if self.calls.depth:
                self.calls.raised.append(error)
            else:  # on a thread of the backend's: there is no call of ours to raise it from
                traceback.print_exception(error)


def _status(kind: int, registered: int, payload: int | None) -> EventStatus:
    """The payload by the kind that came with it, else by the one that was registered; zeros without one."""
    data = bytes(_PAYLOAD) if payload is None else ct.string_at(payload, _PAYLOAD)
    known = kind if kind in tuple(EventKind) else registered
    if known == EventKind.LIVELINESS_CHANGED:
        return LivelinessChangedStatus(*struct.unpack("=HHhh", data))
    return CountStatus(*struct.unpack("=II", data))
