"""Registration and dispatch that adapters compose: a registry per entity, a ready queue per session.

Events become ready in the registry and are called from the queue, which the session drains inside
`drive_io` and nowhere else (DSP-001).
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping
from typing import TypeAlias

from nros_conformance.rmw.backend import MessageCallback
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import Source
from nros_conformance.rmw.events import EventCallback, EventKind
from nros_conformance.rmw.qos import is_finite

_Entry: TypeAlias = tuple[int, int, Callable[[], bool]]


class ReadyQueue:
    """Callbacks of one session that are ready to run, oldest first, messages and events alike."""

    def __init__(self) -> None:
        self._heap: list[_Entry] = []
        self._order = 0
        self.busy = False

    def push(self, ready_ns: int, call: Callable[[], bool]) -> None:
        """Queue ``call``, ready since ``ready_ns``; it returns whether it ran a callback."""
        self._order += 1
        heapq.heappush(self._heap, (ready_ns, self._order, call))

    def __len__(self) -> int:
        return len(self._heap)

    def drain(self, max_callbacks: int | None = None) -> int:
        """Run what is queued now, at most ``max_callbacks`` of it; returns how many ran.

        What callbacks queue themselves waits for the next drain. Never re-enters (DSP-003): a drain
        from inside a callback runs nothing. An exception of a callback leaves the rest queued and
        goes on to the caller.
        """
        if self.busy:
            return 0
        self.busy = True
        ran = 0
        last_order = self._order
        later: list[_Entry] = []
        try:
            while self._heap and (max_callbacks is None or ran < max_callbacks):
                entry = heapq.heappop(self._heap)
                if entry[1] > last_order:
                    later.append(entry)
                else:
                    ran += entry[2]()
        finally:
            self.busy = False
            for entry in later:
                heapq.heappush(self._heap, entry)
        return ran


class _Registration:
    __slots__ = ("callback", "context", "queued")

    def __init__(self, callback: EventCallback, context: object) -> None:
        self.callback = callback
        self.context = context
        self.queued = False


class EventRegistry:
    """The event half of one entity: what it supports, who is registered, what is ready.

    ``sources`` are the supported kinds. For a deadline it checks that there is a period; whoever has the clock
    applies it, as `ends.ClockedEnd` does.
    """

    def __init__(
        self,
        queue: ReadyQueue,
        sources: Mapping[EventKind, Source],
        *,
        qos_deadline_ms: int = 0,
        has_data: Callable[[], bool] = lambda: True,
    ) -> None:
        self._queue = queue
        self._sources = dict(sources)
        self._qos_deadline_ms = qos_deadline_ms
        self._has_data = has_data
        self._registered: dict[EventKind, _Registration] = {}
        self._message: tuple[MessageCallback, object] | None = None
        self.closed = False

    def supports(self, kind: int) -> bool:
        """`Entity.supports_event`."""
        return not self.closed and _plain(kind) in self._sources

    def register(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        """`Entity.register_event`, with the checks that the contract asks for."""
        if self.closed:
            return ReturnCode.INVALID_ARGUMENT
        known = _plain(kind)
        if known is None or known not in self._sources:
            return ReturnCode.UNSUPPORTED
        if callback is None or not callable(callback):
            return ReturnCode.INVALID_ARGUMENT
        if known.is_deadline:
            period_ms = self._qos_deadline_ms if is_finite(self._qos_deadline_ms) else deadline_ms
            if not is_finite(period_ms):
                return ReturnCode.INCOMPATIBLE_QOS
        self._registered[known] = _Registration(callback, context)
        return ReturnCode.OK

    def set_message_callback(self, callback: MessageCallback | None, context: object) -> int:
        """`Subscription.set_message_callback`."""
        if self.closed:
            return ReturnCode.INVALID_ARGUMENT
        self._message = None if callback is None else (callback, context)
        return ReturnCode.OK

    def message(self, at_ns: int, waits: Callable[[], bool] | None = None) -> None:
        """A sample that can be taken arrived at ``at_ns``; ``waits()``: whether it still can.

        Without ``waits`` the callback runs as long as any sample can be taken. In a flood that overruns
        the queue that is for ever, and an event that became ready later waits behind it (DSP-009).
        """
        if self._message is not None:
            self._queue.push(at_ns, lambda: self._call_message(waits or self._has_data))

    def poll(self) -> None:
        """Queue a callback for every registered kind whose source has something to report."""
        for kind, registration in self._registered.items():
            ready_ns = self._sources[kind].ready_ns
            if ready_ns is not None and not registration.queued:
                registration.queued = True
                self._queue.push(ready_ns, lambda kind=kind: self._call_event(kind))  # type: ignore[misc]

    def close(self) -> None:
        """Forget callbacks and contexts; nothing of this entity runs any more (DSP-004, LIF-003)."""
        self.closed = True
        self._registered.clear()
        self._message = None

    def _call_event(self, kind: EventKind) -> bool:
        registration = self._registered.get(kind)
        if registration is None:
            return False
        registration.queued = False
        status = self._sources[kind].take()
        if status is None:
            return False
        registration.callback(int(kind), status, registration.context)
        return True

    def _call_message(self, waits: Callable[[], bool]) -> bool:
        if self._message is None or not waits():
            return False
        callback, context = self._message
        callback(context)
        return True


def _plain(kind: int) -> EventKind | None:
    """The known kind of this value. No other integer aliases one (REG-003)."""
    try:
        return EventKind(kind)
    except ValueError:
        return None
