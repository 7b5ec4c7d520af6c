"""The process of one session: plays that session's part of a scenario, as it is told by `remote`."""

from __future__ import annotations

import contextlib
import faulthandler
import os
import sys
import threading
from multiprocessing.connection import Connection
from typing import Any

from msgspec.structs import replace

from nros_conformance.play.adapters import load_adapter
from nros_conformance.play.driver import Command, Driver, describe
from nros_conformance.play.faketime import set_ahead
from nros_conformance.play.orders import Cast, Done, Failed, FromSession, Noted, Order, Ready, decode_order, encode
from nros_conformance.play.script import Script
from nros_conformance.play.stage import Stage
from nros_conformance.play.starvation import Watch
from nros_conformance.rmw.clock import MonotonicClock
from nros_conformance.suite import schema
from nros_conformance.suite.loader import typed
from nros_conformance.trace.records import AnyRecord, Starved


class _Line:
    """The connection to the player, for all threads."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._lock = threading.Lock()

    def tell(self, message: FromSession) -> None:
        """Say something; without a player there is no reason to live."""
        try:
            with self._lock:
                self._connection.send_bytes(encode(message))
        except OSError:
            os._exit(1)

    def record(self, record: AnyRecord) -> None:
        """Hand a record over."""
        self.tell(Noted(record))

    def failed(self, outcome: str, detail: str) -> None:
        """Say that the play cannot go on."""
        self.tell(Failed(outcome, detail))


class Host:
    """One session and its part of the script."""

    def __init__(self, cast: Cast, line: _Line) -> None:
        plan = cast.plan
        scenario = typed(plan.header.scenario, plan.key)
        clock = MonotonicClock()
        self._line = line
        self.stage = Stage(
            plan, scenario, load_adapter(plan.adapter), clock, line.record, only=cast.session,
            run_tag=cast.run_tag, failed=line.failed, locator=cast.locator,
        )  # fmt: skip
        for actor in self.stage.actors.values():
            actor.sequence = cast.first_sequence
        self.script = Script(self.stage, cast.start)
        self._session = cast.session
        self._driver = self.stage.drivers[cast.session]

    def starved(self, record: Starved) -> None:
        """Hand over what the threads of this process had to wait."""
        self._line.record(replace(record, session=self._session))

    def carry_out(self, order: Order) -> None:
        """Have it done on the session's thread, and answered."""
        driver, stage = self._driver, self.stage

        def answer(command: Command) -> None:
            self._line.tell(Done(order.number, command.begin, command.end, command.result))

        def internal(run: Any) -> None:
            driver.post(Command(stage.clock, order.due, run, op=order.what, record=False, then=answer))

        match order.what:
            case "connect":
                internal(lambda: stage.lives.connect(driver))
            case "create":
                internal(lambda: stage.lives.create(stage.actors[order.entity]))
            case "destroy":
                internal(lambda: stage.lives.destroy(self._session))
            case "matched":
                internal(lambda: stage.backend.matched(stage.actors[order.entity].created()))
            case "pause":
                internal(driver.pause)
            case "resume":
                driver.resume()
            case "clock":
                begin = stage.clock.now_ns()
                set_ahead(order.ahead_ns)
                self._line.tell(Done(order.number, begin, stage.clock.now_ns()))
            case "step" | "fault":
                self._step(order, driver, answer)

    def _step(self, order: Order, driver: Driver, answer: Any) -> None:
        step = self.script.step(order.label)
        if isinstance(step, schema.Call | schema.Spin):
            driver.background = False  # until the player says that it goes on
        command = self.script.command(step, order.label, order.index, order.entity, order.due)
        command.then = answer
        driver.post(command)


def serve(connection: Connection) -> None:
    """Host the session that the first message names, until the player hangs up."""
    faulthandler.enable()
    sys.setswitchinterval(1.0)  # as in `worker`, and why
    line = _Line(connection)
    watch, watching = Watch(), contextlib.ExitStack()
    watch.start()
    host: Host | None = None
    while True:
        try:
            data = connection.recv_bytes()
        except (EOFError, OSError):
            break
        try:
            message = decode_order(data)
            if isinstance(message, Cast):
                host = Host(message, line)
                watching.enter_context(watch.telling(host.starved))
                line.tell(Ready())
            elif message.what == "end":
                break
            elif host is not None:
                host.carry_out(message)
        except Exception as error:
            line.failed("raised", describe("the session's process", error))
    # Threads of the backend may still run, or hang: nobody waits for them.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
