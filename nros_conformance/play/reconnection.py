"""A session that a reconnector keeps: the application's state machine in place of the script's order."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING

from nros_conformance.node.reconnection import LinkState, Pace, StateMachine, Transition
from nros_conformance.play.driver import Driver
from nros_conformance.rmw.codes import PUBLISHED_ERRORS, ReturnCode, RmwError
from nros_conformance.trace.records import Changed

if TYPE_CHECKING:
    from nros_conformance.play.stage import Stage


class Kept:
    """The hooks of the state machine on one session of a stage; every step on its thread.

    Two pings in a row have to fail, each with a timeout of 1T, before the peer counts as gone; twice per T it is
    looked for, and the session pinged.
    """

    def __init__(self, stage: Stage, driver: Driver) -> None:
        self._stage = stage
        self._driver = driver
        scale = timedelta(microseconds=stage.quantities["T"] // 1000)
        pace = Pace(ping_timeout=scale, attempts=2, waiting=scale / 2, connected=scale / 2)
        self.machine = StateMachine(self, driver.clock, pace, self._changed)
        driver.turn = self.machine.step

    @property
    def connected(self) -> bool:
        """Whether the application uses its entities now."""
        return self.machine.state is LinkState.AGENT_CONNECTED

    def probe(self, timeout_ms: int, attempts: int) -> int:
        return self._stage.probe(self._driver.name, timeout_ms, attempts)

    def create(self) -> None:
        """The session, then its entities; those that the script creates only once it has created them."""
        code = self._stage.lives.connect(self._driver)
        for actor in self._stage.actors.values():
            if code == 0 and actor.driver is self._driver and (not actor.spec.deferred or actor.handle is not None):
                code = self._stage.lives.create(actor)
        _check(code, "the session or one of its entities was refused")

    def spin(self, timeout_ms: int) -> int:
        return self._driver.look(timeout_ms) or 0

    def check(self, timeout_ms: int, attempts: int) -> int:
        session = self._driver.session
        return int(ReturnCode.CONNECTION_FAILED) if session is None else int(session.ping(timeout_ms, attempts))

    def destroy(self) -> None:
        """The session, if there is one; the machine goes on without it."""
        if self._driver.session is None:
            return
        code = self._stage.lives.destroy(self._driver.name)
        self._driver.session, self._driver.background = None, True
        _check(code, "destroying the session")

    def _changed(self, transition: Transition) -> None:
        self._driver.flush()
        self._driver.keep(
            Changed(
                session=self._driver.name, before=transition.before.value, state=transition.state.value,
                reason=transition.reason, t=transition.at_ns,
            )
        )  # fmt: skip


def _check(code: int, what: str) -> None:
    """Raise what a code stands for; one that nobody has published is on record, and stands for ERROR."""
    if code != ReturnCode.OK:
        raise RmwError(ReturnCode(code) if code in PUBLISHED_ERRORS else ReturnCode.ERROR, what)
