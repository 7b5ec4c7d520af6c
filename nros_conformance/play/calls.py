"""What a step of a script calls: operations on the entities and sessions that it names."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable
from typing import Any, NamedTuple

from nros_conformance.play import payload
from nros_conformance.play.actors import Actor
from nros_conformance.play.driver import Driver, StopPlay
from nros_conformance.play.stage import Stage
from nros_conformance.rmw.backend import Publisher, Session, Subscription
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.events import KIND_BY_LABEL
from nros_conformance.rmw.qos import INFINITE_MS
from nros_conformance.suite import schema


class Call(NamedTuple):
    """One call, to be made on the thread of ``driver``."""

    driver: Driver
    entity: str
    """Empty for a session."""
    op: str
    args: dict[str, Any]
    """What is written down of it; some of it is known when it has run."""
    run: Callable[[], Any]


class Calls:
    """The calls of all steps on one stage, and what they leave behind."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._held: dict[str, list[weakref.ref[Any]]] = {}
        """Callback and context of each registration, by the label of its step."""

    def of(self, step: Any, label: str, *, within: bool = False) -> list[Call]:
        """Those of one turn of a step: one per addressed entity. Raises `StopPlay`.

        ``within`` a callback a drive_io is no spin: nothing is due to be delivered by it.
        """
        stage = self._stage
        match step:
            case schema.Call():
                driver, timeout = stage.drivers[step.session], step.timeout.ns(stage.quantities) // MS
                drive = _session(driver).drive_io if within else driver.drive
                return [Call(driver, "", "drive", {"timeout_ms": timeout}, lambda: drive(timeout))]
            case schema.Spin():
                driver, timeout = stage.drivers[step.session], step.timeout.ns(stage.quantities) // MS
                executor = stage.executors[step.session]

                def spin() -> int | None:
                    return driver.drive(timeout, call=lambda: executor.spin_once(timeout, step.cap))

                return [Call(driver, "", "spin", {"timeout_ms": timeout, "cap": step.cap}, spin)]
            case schema.Ping(session=None):
                timeout = step.timeout.ns(stage.quantities) // MS
                args = {"timeout_ms": timeout, "attempts": step.attempts}
                return [Call(stage.lobby, "", "ping", args, lambda: stage.probe("", timeout, step.attempts))]
            case schema.Ping(session=str(session)):
                driver, timeout = stage.drivers[session], step.timeout.ns(stage.quantities) // MS
                args = {"timeout_ms": timeout, "attempts": step.attempts}
                return [Call(driver, "", "ping", args, lambda: int(_session(driver).ping(timeout, step.attempts)))]
            case schema.Destroy(of=name) if name in stage.drivers:
                return [Call(stage.drivers[name], "", "destroy", {}, lambda: stage.lives.destroy(name))]
        name = step.entity if isinstance(step, schema.Create) else _subject(step)
        calls = []
        for actor in stage.members(name):
            op, args, run = self._call(step, label, actor)
            calls.append(Call(actor.driver, actor.name, op, args, run))
        return calls

    def publish(self, actor: Actor, label: str, size: int | None, args: dict[str, Any]) -> int:
        """``publish_raw`` with the next number of that publisher; ``args`` become those of its record."""
        actor.sequence += 1
        identity = payload.Identity(self._stage.run_tag, actor.index, self._stage.label_index(label), actor.sequence)
        data = b"" if size == 0 else payload.encode(identity, size or payload.MIN_SIZE)
        args |= {"sequence": actor.sequence, "size": len(data)}
        return int(_publisher(actor).publish_raw(data))

    def released(self, step: schema.Released) -> bool:
        """Whether callbacks and contexts of these registrations are gone."""
        held = self._held.get(step.registration, [])
        held = held[:-2] if step.but_last else held
        if any(one() is not None for one in held):
            gc.collect()  # 30 to 100 ms in which no other thread runs: only when it can change the answer
        return all(one() is None for one in held)

    def _call(self, step: Any, label: str, actor: Actor) -> tuple[str, dict[str, Any], Callable[[], Any]]:
        stage = self._stage
        args: dict[str, Any] = {}
        match step:
            case schema.Publish():
                return "publish", args, lambda: self.publish(actor, label, step.size, args)
            case schema.Assert():
                return "assert", args, lambda: int(_publisher(actor).assert_liveliness())
            case schema.Take():
                limits = {"max": step.max, "size": step.size}
                return "take", limits, lambda: stage.messages.take(actor, step.max, step.size)
            case schema.HasData():
                return "has_data", args, lambda: _plain(_subscription(actor).has_data())
            case schema.Supports():
                kind = _kind(step.kind)
                return "supports", {"kind": kind}, lambda: bool(actor.created().supports_event(kind))
            case schema.Register():
                return self._register(step, label, actor)
            case schema.Create():
                stale = step.stale
                return "create", args, lambda: stage.lives.create(actor, stale=stale)
            case schema.Destroy():
                return "destroy", args, lambda: stage.lives.destroy(actor.name)
        raise StopPlay("error", f"no way to play {type(step).__name__}")

    def _register(
        self, step: schema.Register, label: str, actor: Actor
    ) -> tuple[str, dict[str, Any], Callable[[], Any]]:
        kind = _kind(step.kind)
        if step.deadline is None:
            deadline = self._stage.lives.registration_deadline_ms(actor)
        else:
            deadline = INFINITE_MS if step.deadline.is_infinite else step.deadline.ns(self._stage.quantities) // MS
        callback = None if step.callback == "none" else self._stage.lives.callback(actor, label)
        context = _Context(step.context or label)
        self._held.setdefault(label, []).extend(weakref.ref(one) for one in (callback, context) if one is not None)
        args = {"kind": kind, "deadline_ms": deadline, "callback": step.callback, "context": str(context)}
        return "register", args, lambda: int(actor.created().register_event(kind, deadline, callback, context))


class _Context(str):
    """A context whose life can be watched."""


def _session(driver: Driver) -> Session:
    assert driver.session is not None
    return driver.session


def _subject(step: Any) -> str:
    return str(getattr(step, "by", None) or getattr(step, "of", None) or getattr(step, "from_", None))


def _kind(kind: str | int) -> int:
    return int(KIND_BY_LABEL[kind]) if isinstance(kind, str) else kind


def _plain(answer: bool | int) -> bool | int:
    return answer if isinstance(answer, bool) else int(answer)


def _publisher(actor: Actor) -> Publisher:
    handle = actor.created()
    assert isinstance(handle, Publisher)
    return handle


def _subscription(actor: Actor) -> Subscription:
    handle = actor.created()
    assert isinstance(handle, Subscription)
    return handle
