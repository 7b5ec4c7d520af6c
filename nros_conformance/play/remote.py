"""The player's end of a session that lives in a process of its own."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable
from typing import Literal, cast

from nros_conformance.play.driver import Command, Driver, StopPlay
from nros_conformance.play.orders import Cast, Done, Failed, Noted, Order, Ready, decode_answer, encode
from nros_conformance.play.processes import START_NS, SessionProcess, death
from nros_conformance.rmw.clock import MS, Clock, Signal, Task
from nros_conformance.trace.records import AnyRecord, State

_GENERATION = 100_000
"""Sequence numbers per process: no script publishes as many from one."""

_STEP_NS = 5_000 * MS
"""For a process to set its wall clock, which takes some microseconds."""


class RemoteDriver(Driver):
    """Passes calls on to the process that hosts the session, and its records to the trace.

    ``launch()`` starts such a process, ``cast(generation)`` says what it has to host.
    """

    def __init__(
        self, name: str, clock: Clock, record: Callable[[AnyRecord], None], failed: Callable[[str, str], None],
        launch: Callable[[], SessionProcess], cast: Callable[[int], Cast], driven: bool,
    ) -> None:  # fmt: skip
        self._launch = launch
        self._cast = cast
        self._numbers = itertools.count(1)
        self._pending: dict[int, Command] = {}
        self._send_lock = threading.Lock()
        self._generation = 0
        self._ending = False
        self.living: set[str] = set()
        """The entities that exist there."""
        self._connected = False
        self._driven = driven
        super().__init__(name, clock, record, failed)

    @property
    def connected(self) -> bool:
        """Whether there is a session to call."""
        return self._connected

    @property
    def process(self) -> SessionProcess:
        """The process that hosts it now."""
        return self._process

    def post(self, *commands: Command) -> None:
        """Have these calls made there; one without an order is made here, at its time."""
        for command in commands:
            if not command.order:
                self.clock.wait(None, command.due)
                self.execute(command)
                continue
            if self._ending:  # the one before was killed
                self.task = self._start()
            number = next(self._numbers)
            self._pending[number] = command
            what = cast('Literal["connect", "create", "step", "fault", "destroy", "matched", "pause"]', command.order)
            self._tell(Order(number, what, command.due, command.label, command.index, command.entity))

    def owes(self, command: Command) -> bool:
        """Whether this call was passed on and has not been answered."""
        return any(one is command for one in list(self._pending.values()))

    def pause(self) -> None:
        """Not called: a pause is an order."""
        raise StopPlay("error", f"session {self.name} lives in another process")

    def resume(self) -> None:
        """Drive in the background again."""
        self.background = True
        self._tell(Order(next(self._numbers), "resume", self.clock.now_ns()))

    def stop(self) -> None:
        """End the process; what it hosted is closed already, or cannot be."""
        self._ending = True
        if self._process.frozen:
            self._process.kill()
        else:
            self._tell(Order(next(self._numbers), "end", self.clock.now_ns()))

    def crash(self) -> None:
        """SIGKILL to the process."""
        self._ending = True
        self._process.kill()
        self.clock.wait(self.task.done, self.clock.now_ns() + 5_000 * MS)  # what it had sent is in the trace
        self._connected = self.background = False
        self.living.clear()

    def step_clock(self, by_ns: int) -> None:
        """Set the wall clock of the process forward, or back; one that is frozen does so when it is thawed."""
        self._ahead_ns += by_ns
        number, now = next(self._numbers), self.clock.now_ns()
        command = self._pending[number] = Command(self.clock, now, lambda: None, op="clock_step")
        self._tell(Order(number, "clock", now, ahead_ns=self._ahead_ns))
        if not self._process.frozen and not self.clock.wait(command.done, now + _STEP_NS):
            raise StopPlay("error", f"the process of session {self.name} has not set its clock")

    def _start(self) -> Task:
        self._ending = False
        self._ahead_ns = 0
        try:
            self._process = self._launch()
        except (TimeoutError, ChildProcessError) as error:
            raise StopPlay("error", f"the process of session {self.name}: {error}") from error
        self._tell(self._cast(self._generation * _GENERATION))
        self._generation += 1
        process, ready = self._process, self.clock.signal()
        task = self.clock.spawn(f"process of session {self.name}", lambda: self._listen(process, ready))
        if not self.clock.wait(ready, self.clock.now_ns() + START_NS):
            self._ending = True
            process.kill()
            raise StopPlay("error", f"the process of session {self.name} has not started within {START_NS / 1e9:g} s")
        return task

    def _tell(self, message: Cast | Order) -> None:
        try:
            with self._send_lock:
                self._process.connection.send_bytes(encode(message))
        except OSError:
            pass  # it is dead, which `_listen` notices

    def _listen(self, process: SessionProcess, ready: Signal) -> None:
        while True:
            try:
                data = process.connection.recv_bytes()
            except (EOFError, OSError):
                break
            match decode_answer(data):
                case Noted(record):
                    self._note_state(record)
                    self.record(record)
                case Done(number, begin, end, result):
                    command = self._pending.pop(number, None)
                    if command is not None:
                        command.begin, command.end, command.result = begin, end, result
                        command.done.set()
                case Ready():
                    ready.set()
                case Failed(outcome, detail):
                    self._failed(outcome, detail)
                    ready.set()
        ready.set()
        code = process.wait(2.0)
        process.connection.close()
        if not self._ending:
            self._connected = False
            self._failed("crash", f"the process of session {self.name} {death(code)}")
            for command in list(self._pending.values()):
                command.done.set()  # nobody else will

    def _note_state(self, record: AnyRecord) -> None:
        if not isinstance(record, State) or record.code:
            return
        if not record.entity:
            self._connected = record.what == "created"
            self.background = self._connected and self._driven
            if not self._connected:
                self.living.clear()
        elif record.what == "created":
            self.living.add(record.entity)
        elif record.what == "destroyed":
            self.living.discard(record.entity)
