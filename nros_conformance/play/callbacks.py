"""The callbacks that a play registers."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from nros_conformance.rmw.events import EventStatus
from nros_conformance.trace.records import Event

if TYPE_CHECKING:
    from nros_conformance.play.actors import Actor
    from nros_conformance.play.stage import Stage


class StatusCallback:
    """Writes down what it was called with, and does what the script asks for."""

    def __init__(self, stage: Stage, actor: Actor, registration: str) -> None:
        self.late = _Note(stage, actor, registration)
        """Writes down the calls that come when this has been released (`late_callback`)."""

    def __call__(self, kind: int, status: EventStatus, context: object) -> None:
        self.late(kind, status, context)
        self.late.react(kind)


class _Note:
    def __init__(self, stage: Stage, actor: Actor, registration: str) -> None:
        self._stage = stage
        self._actor = actor
        self._registration = registration

    def __call__(self, kind: int, status: EventStatus, context: object) -> None:
        stage, driver = self._stage, self._actor.driver
        t = stage.clock.now_ns()
        thread = stage.clock.task_id()
        own = thread == driver.thread
        inside = driver.inside and own
        driver.callbacks += own
        if driver.name in stage.executors:
            stage.executors[driver.name].note_callback()
        driver.keep(
            Event(
                registration=self._registration, kind=int(kind), entity=self._actor.name, session=driver.name,
                context=str(context), process=os.getpid(), thread=thread, driver=driver.thread,
                spin=driver.spins if inside else -1, inside_drive=inside, nested=driver.running > 0, t=t,
                wait=driver.wait_in_spin() if inside else 0, earlier=driver.wait_at_callback if inside else 0,
                status={name: int(value) for name, value in status._asdict().items()},
            )
        )  # fmt: skip

    def react(self, kind: int) -> None:
        with self._actor.driver.callback():
            self._stage.react(self._actor, kind, self._registration)
