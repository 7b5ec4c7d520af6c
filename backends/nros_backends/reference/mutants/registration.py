"""Defects of registering (REG) and of return codes."""

from __future__ import annotations

from collections.abc import Iterator

from nros_backends.reference.backend import ReferenceSubscription
from nros_backends.reference.mutants.build import mutant
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.dispatch import EventRegistry
from nros_conformance.rmw.events import EventCallback, EventKind, EventStatus
from nros_conformance.rmw.mutants import Mutant


class _SupportsNothing(EventRegistry):
    def supports(self, kind: int) -> bool:
        return False


class _RaisesNoLoss(EventRegistry):
    def poll(self) -> None:
        kept = self._registered.pop(EventKind.MESSAGE_LOST, None)
        super().poll()
        if kept is not None:
            self._registered[EventKind.MESSAGE_LOST] = kept


class _Register(EventRegistry):
    """What the plain registry answers is changed by `changed`."""

    def register(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        return self.changed(super().register(kind, deadline_ms, callback, context), kind)

    def changed(self, code: int, kind: int) -> int:
        return code


class _WrongCode(_Register):
    def changed(self, code: int, kind: int) -> int:
        return ReturnCode.ERROR if code == ReturnCode.UNSUPPORTED else code


class _NoPeriodIsFine(_Register):
    def changed(self, code: int, kind: int) -> int:
        return ReturnCode.OK if code == ReturnCode.INCOMPATIBLE_QOS else code


class _LosesState(_Register):
    def changed(self, code: int, kind: int) -> int:
        source = self._sources.get(EventKind(kind)) if code == ReturnCode.OK else None
        if source is not None and kind == EventKind.LIVELINESS_CHANGED:
            source.take()
        return code


class _NoCallbackIsFine(EventRegistry):
    def register(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        if callback is None and not self.closed and kind in tuple(EventKind):
            self._registered.pop(EventKind(kind), None)
            return ReturnCode.OK
        return super().register(kind, deadline_ms, callback, context)


class _OneSlot(_Register):
    def changed(self, code: int, kind: int) -> int:
        if code == ReturnCode.OK:
            last = self._registered[EventKind(kind)]
            for other in self._registered.values():
                other.callback, other.context = last.callback, last.context
        return code


class _Wraps(EventRegistry):
    """Hands callbacks on through `wrapped`."""

    def register(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        given = None if callback is None else self.wrapped(callback)
        return super().register(kind, deadline_ms, given, context)

    def wrapped(self, callback: EventCallback) -> EventCallback:
        return callback


class _WideKind(_Wraps):
    def wrapped(self, callback: EventCallback) -> EventCallback:
        return lambda kind, status, context: callback(kind + 0x100, status, context)


class _Adds(_Wraps):
    def __init__(self, *arguments: object, **named: object) -> None:
        super().__init__(*arguments, **named)  # type: ignore[arg-type]
        self.all: list[EventCallback] = []

    def wrapped(self, callback: EventCallback) -> EventCallback:
        self.all.append(callback)

        def call(kind: int, status: EventStatus, context: object) -> None:
            for one in self.all:
                one(kind, status, context)

        return call


class _ForeignPayload(EventRegistry):
    def _call_event(self, kind: EventKind) -> bool:
        other = EventKind.OFFERED_DEADLINE_MISSED
        if kind is not EventKind.LIVELINESS_LOST:
            return super()._call_event(kind)
        lost, self._sources[kind] = self._sources[kind], self._sources[other]
        try:
            return super()._call_event(kind)
        finally:
            self._sources[kind] = lost


class _MasksKind(EventRegistry):
    def register(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        return super().register(kind & 0xFF, deadline_ms, callback, context)


class _OwnPeriod(ReferenceSubscription):
    def register_event(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        code = super().register_event(kind, deadline_ms, callback, context)
        if code == ReturnCode.OK and kind == EventKind.REQUESTED_DEADLINE_MISSED and not self.qos.has_deadline:
            self.backend.world.set_deadline(self.id, 1000)
        return code


def mutants() -> Iterator[Mutant]:
    """All of this subject."""
    yield mutant(
        "supports-nothing",
        "D-REG-01",
        "REG-001",
        "supports_event is false although registering works",
        registry=_SupportsNothing,
    )
    yield mutant(
        "never-raised",
        "D-REG-03",
        "REG-005",
        "MessageLost can be registered and is never raised",
        registry=_RaisesNoLoss,
    )
    yield mutant("wrong-code", "D-REG-05", "REG-002", "an unsupported kind is refused with ERROR", registry=_WrongCode)
    yield mutant(
        "no-period-is-fine",
        "D-REG-10",
        "REG-008",
        "a deadline kind without any period is registered",
        registry=_NoPeriodIsFine,
    )
    yield mutant(
        "own-period", "D-REG-11", "RDM-001", "the period of the registration is ignored", subscription=_OwnPeriod
    )
    yield mutant(
        "no-callback-is-fine",
        "D-REG-12",
        "REG-004",
        "registering no callback answers OK and drops the earlier one",
        registry=_NoCallbackIsFine,
    )
    yield mutant("one-slot", "D-REG-14", "REG-006", "all kinds of an entity share one callback", registry=_OneSlot)
    yield mutant(
        "foreign-payload",
        "D-REG-16",
        "CNT-002",
        "LivelinessLost carries the counter of the deadline",
        registry=_ForeignPayload,
    )
    yield mutant("loses-state", "D-REG-18", "REG-009", "what was before the registration is lost", registry=_LosesState)
    yield mutant(
        "adds-callbacks", "D-REG-20", "REG-007", "a second registration adds its callback to the first", registry=_Adds
    )
    yield mutant(
        "wide-kind", "D-REG-22", "REG-006", "the kind argument has bits beyond its first byte", registry=_WideKind
    )
    yield mutant("masks-kind", "", "REG-003", "only the first byte of a kind is looked at", registry=_MasksKind)
