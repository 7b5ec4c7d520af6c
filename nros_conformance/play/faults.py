"""Faults: those that the backend injects into itself, and those that hit the process of a session."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nros_conformance.play.actors import Actor
from nros_conformance.play.driver import Command, Driver, StopPlay
from nros_conformance.play.remote import RemoteDriver
from nros_conformance.play.stage import Stage
from nros_conformance.rmw.events import KIND_BY_LABEL
from nros_conformance.suite.injections import INJECTIONS
from nros_conformance.suite.schema import Fault
from nros_conformance.trace.records import FaultRecord

Publish = Callable[[Actor, str, dict[str, Any]], int]
"""``publish(actor, label, args)``: one more sample, ``args`` become those of its record."""


PROCESS_FAULTS = ("crash", "freeze", "thaw", "clock_step")
"""What hits the process that hosts a session."""


def strike(fault: str, driver: RemoteDriver, by_ns: int = 0) -> None:
    """Do it, for real; returns when the kernel says that it is done."""
    match fault:
        case "crash":
            driver.crash()
        case "freeze":
            driver.process.freeze()
        case "thaw":
            driver.process.thaw()
        case "clock_step":
            driver.step_clock(by_ns)


class Injector:
    """Plays fault steps, each on the thread of the session that it hits."""

    def __init__(self, stage: Stage, publish: Publish) -> None:
        self._stage = stage
        self._publish = publish

    def command(self, step: Fault, label: str, begin: int) -> tuple[Driver, Command]:
        """The call that injects the fault at ``begin``; it writes down what the backend answered."""
        injection = INJECTIONS.get(step.fault)
        if injection is None or step.of is None:
            raise StopPlay("error", f"the fault {step.fault} cannot be injected yet")
        stage = self._stage
        if step.fault in PROCESS_FAULTS:
            return self._to_process(step, label, begin)
        if injection.of == "session":
            driver = stage.drivers[step.of]
            arguments: dict[str, Any] = {"session": driver.session}
            if injection.directed:
                arguments["direction"] = step.direction
            if injection.lasting and step.by is not None:
                arguments["by_ns"] = step.by.ns(stage.quantities)
            if injection.counted:
                arguments |= {"count": step.count, "seed": stage.plan.header.seed}
        else:
            (actor,) = stage.members(step.of)
            driver = actor.driver
            arguments = {"count": step.count}
            if injection.publishes:
                arguments["publish"] = self._publisher(actor, label)
            if step.fault == "preset":
                arguments["kind"] = None if step.kind is None else int(KIND_BY_LABEL[step.kind])

        def run() -> int:
            if injection.of != "session":
                arguments["entity"] = actor.created()  # where it lives, which may be another process
            begun = stage.clock.now_ns()
            code = int(stage.backend.inject(step.fault, **arguments))
            record = FaultRecord(
                label=label, fault=step.fault, of=step.of or "", begin=begun, end=stage.clock.now_ns(),
                detail={"code": code},
            )  # fmt: skip
            stage.record(record)
            stage.refused(step.fault, code)
            return code

        return driver, Command(
            stage.clock, begin, run, op=step.fault, label=label, entity=step.of, record=False, order="fault"
        )  # fmt: skip

    def _to_process(self, step: Fault, label: str, begin: int) -> tuple[Driver, Command]:
        """A signal to the process of a session; on the virtual clock the adapter simulates it."""
        stage = self._stage
        assert step.of is not None
        driver = stage.drivers[step.of]
        by = {} if step.by is None else {"by_ns": step.by.ns(stage.quantities)}

        def run() -> None:
            begun = stage.clock.now_ns()
            code = 0
            if isinstance(driver, RemoteDriver):
                strike(step.fault, driver, **by)
            else:
                code = int(stage.backend.inject(step.fault, session=driver.session, **by))
                stage.refused(step.fault, code)
                stage.lives.struck(step.fault, driver)
            stage.record(
                FaultRecord(
                    label=label, fault=step.fault, of=driver.name, begin=begun, end=stage.clock.now_ns(),
                    detail={"code": code, **by},
                )
            )  # fmt: skip

        return driver, Command(stage.clock, begin, run, op=step.fault, label=label, entity=step.of, record=False)

    def _publisher(self, actor: Actor, label: str) -> Callable[[], int]:
        """Publishes one sample, written down like those of a publish step."""
        number = 0

        def publish() -> int:
            nonlocal number
            args: dict[str, Any] = {}
            command = Command(
                self._stage.clock, self._stage.clock.now_ns(), lambda: self._publish(actor, label, args),
                op="publish", label=label, index=number, entity=actor.name, args=args,
            )  # fmt: skip
            number += 1
            actor.driver.execute(command)
            return int(command.result) if command.result is not None else -1

        return publish
