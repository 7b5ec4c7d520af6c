"""Defects of dispatch: where, when and on which thread callbacks run (DSP)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from nros_backends.reference.backend import (
    ReferenceBackend,
    ReferencePublisher,
    ReferenceSession,
    ReferenceSubscription,
)
from nros_backends.reference.mutants.build import mutant
from nros_conformance.rmw.backend import SessionOptions
from nros_conformance.rmw.clock import MS, NEVER, Clock
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.dispatch import EventRegistry, ReadyQueue
from nros_conformance.rmw.events import EventCallback, EventKind
from nros_conformance.rmw.mutants import Mutant
from nros_conformance.rmw.qos import Durability


def hang(clock: Clock) -> None:
    """For a day."""
    clock.wait(None, clock.now_ns() + 86_400_000 * MS)


class _DeafSession(ReferenceSession):
    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        self.clock.wait(None, self.clock.now_ns() + max(timeout_ms, 0) * MS)
        return ReturnCode.INVALID_ARGUMENT if self.destroyed else ReturnCode.OK


class _FiresWhenAsked(ReferenceSubscription):
    def has_data(self) -> bool | int:
        if not self.destroyed and self.session.poll():
            self.session.queue.drain()
        return super().has_data()


class _TimerSession(ReferenceSession):
    def __init__(self, backend: ReferenceBackend, options: SessionOptions) -> None:
        super().__init__(backend, options)
        self.clock.spawn("timer", self._fire)

    def _fire(self) -> None:
        while not self.destroyed:
            self.clock.wait(None, self.clock.now_ns() + 1 * MS)
            if not self.destroyed and ReferenceSession.poll(self):
                self.queue.drain()

    def poll(self) -> bool:
        return False


class _JoinDeadlock(ReferencePublisher):
    readers = 0

    def publish_raw(self, data: bytes) -> int:
        if not self.destroyed and self.qos.durability is Durability.TRANSIENT_LOCAL:
            readers = sum(self.backend.world.matched(self.id, id_) for id_ in self.backend.entities)
            if readers > self.readers and self.session.clock.now_ns() > self.last + 100 * MS:
                hang(self.session.clock)
            self.readers, self.last = readers, self.session.clock.now_ns()
        return super().publish_raw(data)

    last = NEVER - 100 * MS


class _HangsWithin(ReferenceSubscription):
    def destroy(self) -> int:
        if self.session.queue.busy:
            hang(self.session.clock)
        return super().destroy()


class _Undead(EventRegistry):
    def close(self) -> None:
        """Keeps everything."""


class _UndeadSession(ReferenceSession):
    """Goes on polling what has been destroyed."""

    def __init__(self, backend: ReferenceBackend, options: SessionOptions) -> None:
        super().__init__(backend, options)
        self.dead: list[Any] = []

    def poll(self) -> bool:
        super().poll()
        for entity in self.dead:
            entity.registry.poll()
        return len(self.queue) > 0


class _UndeadSubscription(ReferenceSubscription):
    def destroy(self) -> int:
        if not self.destroyed:
            self.session.dead.append(self)  # type: ignore[attr-defined]
        return super().destroy()


class _UndeadPublisher(ReferencePublisher):
    def destroy(self) -> int:
        if not self.destroyed:
            self.session.dead.append(self)  # type: ignore[attr-defined]
        return super().destroy()


class _UseAfterFree(ReferenceSubscription):
    def destroy(self) -> int:
        session = self.session
        if not self.destroyed and self.registry._registered:
            session.queue.push(0, self._freed)
        return super().destroy()

    def _freed(self) -> bool:
        raise MemoryError("use after free")


class _FormerOwner(EventRegistry):
    """Slots of a session hold the callback of whoever had them first."""

    def register(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        slots: dict[int, tuple[EventCallback, object]] = self._queue.__dict__.setdefault("slots", {})
        code = super().register(kind, deadline_ms, callback, context)
        if code == ReturnCode.OK and callback is not None:
            given = self._registered[EventKind(kind)]
            given.callback, given.context = slots.setdefault(kind, (callback, context))
        return code


class _BlocksOnHalfAFrame(ReferenceSession):
    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        if self.link.stalled:
            hang(self.clock)
        return super().drive_io(timeout_ms, max_callbacks)


class _ClockReadsZero(ReferenceSession):
    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        while timeout_ms:
            self.clock.wait(None, self.clock.now_ns() + 1 * MS)
        return super().drive_io(timeout_ms, max_callbacks)


class _SleepsThrough(ReferenceSession):
    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        code = super().drive_io(0, max_callbacks)
        if not self.destroyed:
            self.clock.wait(None, self.clock.now_ns() + max(timeout_ms, 0) * MS)
        return code


class _Probes(ReferenceSession):
    probed = 0

    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        if self.clock.now_ns() - self.probed > 1000 * MS:
            self.clock.wait(None, self.clock.now_ns() + 900 * MS)
            self.probed = self.clock.now_ns()
        return super().drive_io(timeout_ms, max_callbacks)


class _DropsAboveCap(ReadyQueue):
    def drain(self, max_callbacks: int | None = None) -> int:
        ran = super().drain(max_callbacks)
        if max_callbacks is not None and ran >= max_callbacks:
            self._heap.clear()
        return ran


class _IgnoresCap(ReadyQueue):
    def drain(self, max_callbacks: int | None = None) -> int:
        return super().drain(None)


class _MessagesFirst(EventRegistry):
    def poll(self) -> None:
        before = {id(entry[2]) for entry in self._queue._heap}
        super().poll()
        for index, (_, order, call) in enumerate(self._queue._heap):
            if id(call) not in before:
                self._queue._heap[index] = (NEVER, order, call)


class _RaiseKills(ReadyQueue):
    dead = False

    def drain(self, max_callbacks: int | None = None) -> int:
        if self.dead:
            self._heap.clear()
            return 0
        try:
            return super().drain(max_callbacks)
        except Exception:
            self.dead = True
            raise


class _RegisterTakes(ReferenceSubscription):
    def register_event(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        if not self.destroyed:
            self.backend.world.take(self.id, self.backend.clock.now_ns())
        return super().register_event(kind, deadline_ms, callback, context)


class _Wipes(ReferenceBackend):
    def create_session(self, options: SessionOptions) -> ReferenceSession:
        for entity in self.entities.values():
            entity.registry._registered.clear()
            entity.registry._message = None
        return super().create_session(options)


class _DrivesAll(ReferenceSession):
    def poll(self) -> bool:
        for session in {entity.session for entity in self.backend.entities.values()} - {self}:
            if ReferenceSession.poll(session):
                session.queue.drain()
        return super().poll()


class _Reenters(ReadyQueue):
    def drain(self, max_callbacks: int | None = None) -> int:
        self.busy = False
        return super().drain(max_callbacks)


class _ReentrantSession(ReferenceSession):
    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        self.queue.busy = False
        return super().drive_io(timeout_ms, max_callbacks)


class _ReturnsAtOnce(ReferenceSession):
    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        return super().drive_io(0, max_callbacks)


class _LateCall(ReferenceSession):
    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        return super().drive_io(2 * timeout_ms, max_callbacks)


class _AlwaysData(ReferenceSubscription):
    def has_data(self) -> bool | int:
        return super().has_data() if self.destroyed else True


def mutants() -> Iterator[Mutant]:
    """All of this subject."""
    yield mutant(
        "fires-when-asked",
        "D-DSP-01",
        "DSP-001",
        "events fire from has_data and never from drive_io",
        session=_DeafSession,
        subscription=_FiresWhenAsked,
    )
    yield mutant(
        "background-timer",
        "D-DSP-04",
        "DSP-002",
        "a timer of its own calls back between the drives",
        session=_TimerSession,
    )
    yield mutant(
        "join-deadlock",
        "D-DSP-06",
        "DSP-005",
        "publishing after a pause hangs when a reader has joined",
        publisher=_JoinDeadlock,
    )
    yield mutant(
        "hangs-within-callback",
        "D-DSP-08",
        "DSP-012",
        "destroying a subscription inside a callback hangs",
        subscription=_HangsWithin,
    )
    yield mutant(
        "undead-subscription",
        "D-DSP-10",
        "DSP-004",
        "what was due is delivered after destroy",
        session=_UndeadSession,
        subscription=_UndeadSubscription,
        registry=_Undead,
    )
    yield mutant(
        "use-after-free",
        "D-DSP-12",
        "LIF-004",
        "driving crashes after a subscription with callbacks was destroyed",
        subscription=_UseAfterFree,
    )
    yield mutant(
        "undead-publisher",
        "D-DSP-13",
        "DSP-004",
        "the event of a destroyed publisher is delivered",
        session=_UndeadSession,
        publisher=_UndeadPublisher,
        registry=_Undead,
    )
    yield mutant("former-owner", "D-DSP-14", "REG-006", "a reused slot calls its former owner", registry=_FormerOwner)
    yield mutant(
        "blocks-on-half-a-frame",
        "D-DSP-17",
        "DSP-005",
        "drive_io waits for the rest of a frame",
        session=_BlocksOnHalfAFrame,
    )
    yield mutant(
        "clock-reads-zero", "D-DSP-18", "DSP-005", "drive_io never finds that its time is over", session=_ClockReadsZero
    )
    yield mutant("sleeps-through", "D-DSP-21", "DSP-007", "drive_io sleeps its whole timeout", session=_SleepsThrough)
    yield mutant("drops-above-cap", "D-DSP-25", "DSP-008", "what exceeds the cap is dropped", queue=_DropsAboveCap)
    yield mutant(
        "messages-first", "D-DSP-26", "DSP-009", "events wait as long as there are messages", registry=_MessagesFirst
    )
    yield mutant(
        "raise-kills-dispatch",
        "D-DSP-30",
        "DSP-012",
        "nothing is dispatched after a callback has raised",
        queue=_RaiseKills,
    )
    yield mutant("register-takes", "D-DSP-33", "DSP-010", "registering consumes a sample", subscription=_RegisterTakes)
    yield mutant(
        "wipes-registrations",
        "D-DSP-34",
        "DSP-011",
        "a second session wipes what the first has registered",
        backend=_Wipes,
    )
    yield mutant(
        "drives-all", "D-DSP-35", "DSP-011", "drive_io runs the callbacks of other sessions", session=_DrivesAll
    )
    yield mutant(
        "blocking-probe", "D-DSP-36", "DSP-005", "once a second drive_io waits for a slow answer", session=_Probes
    )
    yield mutant(
        "reenters",
        "",
        "DSP-003",
        "drive_io from inside a callback runs callbacks",
        queue=_Reenters,
        session=_ReentrantSession,
    )
    yield mutant("ignores-cap", "", "DSP-008", "the cap is ignored", queue=_IgnoresCap)
    yield mutant("returns-at-once", "", "DSP-006", "drive_io does not wait", session=_ReturnsAtOnce)
    yield mutant("drives-twice-as-long", "", "DSP-005", "drive_io lasts twice as long as it may", session=_LateCall)
    yield mutant("always-data", "", "DSP-010", "has_data is always true", subscription=_AlwaysData)
