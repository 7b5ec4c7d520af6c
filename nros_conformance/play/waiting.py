"""``until`` steps: let the sessions be driven until something is so, at most for a limit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nros_conformance.play.actors import Actor
from nros_conformance.play.driver import Command, Driver
from nros_conformance.play.stage import Stage
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.suite.schema import Until
from nros_conformance.trace.records import WAITING_BY, WAITING_PING

_LOOK_NS = 2 * MS
"""How often the condition is looked at."""

Publish = Callable[[Actor, str, int | None, dict[str, Any]], int]


class Waiting:
    """Waits on one stage; its calls meanwhile have `WAITING_PING` or `WAITING_BY` behind the label of the step."""

    def __init__(self, stage: Stage, publish: Publish) -> None:
        self._stage = stage
        self._publish = publish
        self._numbers: dict[str, int] = {}

    def until(self, step: Until, label: str, begin: int) -> bool:
        """Whether it was so in time. Raises `StopPlay`."""
        stage, end = self._stage, begin + step.limit.ns(self._stage.quantities)
        every = max(step.every.ns(stage.quantities), _LOOK_NS)
        first = {actor.name: actor.sequence + 1 for actor in stage.members(step.by or "")}
        turn = begin
        while True:
            if stage.clock.now_ns() >= turn:
                turn = max(turn + every, stage.clock.now_ns())
                if self._ask(step, label, every):
                    return True
            if self._is_so(step, begin, first):
                return True
            now = stage.clock.now_ns()
            if now >= end:
                return False
            stage.sleep_until(min(now + _LOOK_NS, end))

    def _is_so(self, step: Until, begin: int, first: dict[str, int]) -> bool:
        """Whether it happened by itself."""
        stage = self._stage
        match step.until:
            case "heard":
                return all(
                    stage.messages.heard.get((name, listener.name), 0) >= number
                    for name, number in first.items()
                    for listener in stage.members(step.of or "")
                )
            case "reported":
                return stage.drivers[step.session or ""].refused_ns >= begin
            case "connected":
                return stage.kept[step.session or ""].connected
        return False

    def _ask(self, step: Until, label: str, every: int) -> bool:
        """Make the calls of one turn; whether their answers decide."""
        stage, timeout_ms = self._stage, every // MS
        answers: list[int | None] = []
        for actor in stage.members(step.by or ""):
            args: dict[str, Any] = {}

            def publish(actor: Actor = actor, args: dict[str, Any] = args) -> int | None:
                # Between two connections there is nothing to publish with.
                return self._publish(actor, label, None, args) if actor.exists else None

            answers.append(self._call(actor.driver, "publish", label + WAITING_BY, publish, actor.name, args))
        if step.until == "reachable":
            run = lambda: stage.probe("", timeout_ms, 1)  # noqa: E731
            return self._call(stage.lobby, "ping", label + WAITING_PING, run) == ReturnCode.OK
        if step.until != "reported":
            return False
        session = stage.drivers[step.session or ""].session
        if session is not None:
            driver = stage.drivers[step.session or ""]
            answers.append(self._call(driver, "ping", label + WAITING_PING, lambda: int(session.ping(timeout_ms, 1))))
        return any(answer not in (None, ReturnCode.OK, ReturnCode.UNSUPPORTED) for answer in answers)

    def _call(
        self, driver: Driver, op: str, label: str, run: Callable[[], int | None], entity: str = "",
        args: dict[str, Any] | None = None,
    ) -> int | None:  # fmt: skip
        clock, number = self._stage.clock, self._numbers.get(label, 0)
        self._numbers[label] = number + 1
        command = Command(clock, clock.now_ns(), run, op=op, label=label, index=number, entity=entity, args=args)
        driver.post(command)
        self._stage.finish([command])
        return command.result if isinstance(command.result, int) else None
