"""One event kind of one entity: the callback that it has, and what is kept for awaits."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from nros_conformance.node.dispatcher import Dispatcher
from nros_conformance.node.errors import raise_for
from nros_conformance.rmw.backend import Entity
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import CountStatus, EventKind, LivelinessChangedStatus

if TYPE_CHECKING:
    from nros_conformance.node.inbox import Inbox

S = TypeVar("S", LivelinessChangedStatus, CountStatus)


class Channel(Generic[S]):
    """Registers itself with the backend when it is first needed, and passes on what comes.

    A callback and awaits do not exclude each other: both get every event, the await's copy first, so
    that a callback that raises costs it nothing.
    """

    def __init__(self, entity: Entity, kind: EventKind, owner: str, dispatcher: Dispatcher) -> None:
        self._entity = entity
        self._kind = kind
        self._owner = owner
        self._dispatcher = dispatcher
        self._deadline_ms: int | None = None  # None: not registered
        self._callback: Callable[[S], None] | None = None
        self._inbox: Inbox[S] | None = None

    def on(self, callback: Callable[[S], None], deadline_ms: int = 0) -> None:
        """Have ``callback(status)`` called from inside ``drive_io``; replaces the former one (REG-007).

        Raises `UnsupportedError`, `RmwError` INCOMPATIBLE_QOS for a deadline kind without any finite
        period (C04), INVALID_ARGUMENT without a callback or when the entity is destroyed; the former
        registration then stays (REG-004).
        """
        if not callable(callback):
            raise RmwError(ReturnCode.INVALID_ARGUMENT, f"no callback for {self._kind.label} of {self._owner}")
        self._register(deadline_ms)
        self._callback = callback

    def next(self, deadline_ms: int | None = None) -> Coroutine[Any, Any, S]:
        """The next event, to be awaited. Kept from the first call on; None: the deadline as registered.

        Raises as `on` does, in the call itself.
        """
        if self._deadline_ms is None or deadline_ms not in (None, self._deadline_ms):
            self._register(deadline_ms or 0)
        if self._inbox is None:
            from nros_conformance.node.inbox import Inbox  # asyncio costs start-up time, not everybody awaits

            self._inbox = Inbox()
        return self._inbox.next()

    def close(self) -> None:
        """The entity is destroyed: let go of the callback, end the awaits."""
        self._callback = None
        if self._inbox is not None:
            self._inbox.close(f"{self._owner} is destroyed")

    def _register(self, deadline_ms: int) -> None:
        code = self._entity.register_event(int(self._kind), deadline_ms, self._arrived, None)
        raise_for(int(code), f"{self._kind.label} of {self._owner}")
        self._deadline_ms = deadline_ms

    def _arrived(self, _kind: int, status: Any, _context: object) -> None:
        self._dispatcher.note_callback()
        if self._inbox is not None:
            self._inbox.put(status)
        if self._callback is not None:
            self._dispatcher.call(self._callback, status)
