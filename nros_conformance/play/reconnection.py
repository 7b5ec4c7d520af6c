"""A session that a reconnector keeps: the application's state machine in place of the script's order."""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta

from nros_conformance.node.reconnection import LinkState, Pace, StateMachine, Transition
from nros_conformance.play.driver import Driver
from nros_conformance.rmw.codes import PUBLISHED_ERRORS, ReturnCode, RmwError
from nros_conformance.trace.records import Changed


class Kept:
    """The hooks of the state machine on one driver; every step on its thread.

    ``connect`` creates the session with its entities and returns a code; ``probe(timeout_ms, attempts)``
    pings without a session; ``destroy`` destroys the session.
    """

    def __init__(
        self, driver: Driver, t_ns: int, connect: Callable[[], int], probe: Callable[[int, int], int],
        destroy: Callable[[], int],
    ) -> None:  # fmt: skip
        self._driver = driver
        self._connect = connect
        self._probe = probe
        self._destroy = destroy
        scale = timedelta(microseconds=t_ns // 1000)
        pace = Pace(ping_timeout=scale, attempts=2, waiting=scale / 2, connected=scale / 2)
        self.machine = StateMachine(self, driver.clock, pace, self._changed)
        driver.turn = self.machine.step

    @property
    def connected(self) -> bool:
        """Whether the application uses its entities now."""
        return self.machine.state is LinkState.AGENT_CONNECTED

    def probe(self, timeout_ms: int, attempts: int) -> int:
        return self._probe(timeout_ms, attempts)

    def create(self) -> None:
        _check(self._connect(), "the session or one of its entities was refused")

    def spin(self, timeout_ms: int) -> int:
        return self._driver.look(timeout_ms) or 0

    def check(self, timeout_ms: int, attempts: int) -> int:
        session = self._driver.session
        return int(ReturnCode.CONNECTION_FAILED) if session is None else int(session.ping(timeout_ms, attempts))

    def destroy(self) -> None:
        _check(self._destroy(), "destroying the session")

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
