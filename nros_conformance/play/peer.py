"""The agent, router or broker of one play: when it is there, and what it can be asked."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from pathlib import Path

from nros_conformance.play.driver import StopPlay
from nros_conformance.rmw.backend import Environment, Listed
from nros_conformance.rmw.clock import Clock
from nros_conformance.rmw.codes import RmwError
from nros_conformance.suite.schema import Fault
from nros_conformance.trace.records import AnyRecord, FaultRecord

LOG = "peer.log"
"""In the scratch folder of the play."""


class Peer:
    """What `Backend.environment` gave, for one play. To be used from the thread of the script."""

    def __init__(self, environment: Environment, clock: Clock, record: Callable[[AnyRecord], None]) -> None:
        self._environment = environment
        self._clock = clock
        self._record = record

    def start(self) -> None:
        """Start it. Raises `StopPlay` when it does not come up."""
        try:
            self._environment.start()
        except RmwError as error:
            raise StopPlay("raised", f"the peer did not start: {error}") from error

    def appoint(self) -> None:
        """Start it and stop it again, so that it has an address at which it is absent. Raises `StopPlay`."""
        self.start()
        self._environment.stop()

    def endpoint(self) -> str:
        """What `SessionOptions.locator` gets."""
        return self._environment.endpoint()

    def inject(self, step: Fault, label: str) -> FaultRecord:
        """Play ``stop`` or ``start``, and write it down."""
        begin = self._clock.now_ns()
        if step.fault == "start":
            self.start()
        else:
            try:
                self._environment.stop(kill=step.kill)
            except RmwError as error:
                raise StopPlay("raised", f"the peer did not stop: {error}") from error
        done = FaultRecord(
            label=label, fault=step.fault, begin=begin, end=self._clock.now_ns(),
            detail={"kill": True} if step.kill else {},
        )  # fmt: skip
        self._record(done)
        return done

    def processes(self) -> Sequence[int]:
        """Those that it runs in now."""
        return self._environment.processes()

    def listed(self, entity: Listed) -> int | None:
        """How many such entities it has in its graph; None: it does not tell."""
        found = self._environment.entities()
        return None if found is None else sum(one == entity for one in found)

    def counted(self, what: str) -> int | None:
        """One of `Environment.counts`; None: it does not tell."""
        return self._environment.counts().get(what)

    def close(self, folder: Path | None, *, clean: bool = False) -> None:
        """Stop it unless it is somebody else's, and keep what it has printed in a folder beside the trace, if any.

        ``clean``: nothing of the play holds on to it, so it need not be stopped.
        """
        with contextlib.suppress(RmwError):
            if clean:
                self._environment.release()
            else:
                self._environment.stop()
        log = self._environment.log()
        if log and folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / LOG).write_text(log, encoding="utf-8")
