"""The thread of a session: drives it in the background, and makes the script's calls in between.

Everything that happens on a session happens on this one thread (a greenlet on the virtual clock), as
in an application, so that "the thread that called drive_io" means something.
"""

from __future__ import annotations

import heapq
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from nros_conformance.rmw.backend import Session
from nros_conformance.rmw.clock import MS, NEVER, Clock, Task
from nros_conformance.rmw.codes import RmwError
from nros_conformance.trace.records import Act, AnyRecord, Spin

_QUIET_NS = 50 * MS
"""No longer stretch of quiet calls is one record: a window of an expectation that closes within a record
leaves all of it open, so records are short against the shortest periods (100 ms)."""

_CALM_SLICES = 3
"""Of how many slices a background drive_io may be one while the script lets time pass: nobody has a call to make
then, and a session that waits costs nothing."""

_NOT_DRIVEN = (-1, -1)

_REST_NS = 1 * MS
"""A quiet drive_io that returned at once is followed by this pause, or the loop would burn a core."""


class StopPlay(Exception):
    """The play ends here: ``outcome`` and ``detail`` of the `End` record."""

    def __init__(self, outcome: str, detail: str) -> None:
        super().__init__(detail)
        self.outcome = outcome
        self.detail = detail


class Scripted(Exception):
    """Raised by a callback because the script says so; the text is the label of the step."""


class Command:
    """A call to make at ``due`` on the session's thread. ``record`` False keeps it out of the trace.

    ``order`` says what to do where the session lives in another process (`orders.Order.what`), ``then`` is
    told when it is done.
    """

    def __init__(
        self, clock: Clock, due: int, run: Callable[[], Any], *, op: str, label: str = "", index: int = 0,
        entity: str = "", args: dict[str, Any] | None = None, record: bool = True, order: str = "",
        then: Callable[[Command], None] | None = None,
    ) -> None:  # fmt: skip
        self.due = due
        self.run = run
        self.op = op
        self.label = label
        self.index = index
        self.entity = entity
        self.args = args if args is not None else {}
        self.record = record
        self.order = order
        self.then = then
        self.done = clock.signal()
        self.begin = 0
        self.end = 0
        self.result: Any = None


class Driver:
    """One session and its thread.

    ``failed(outcome, detail)`` is told when a call raised something else than `RmwError`.
    """

    def __init__(
        self, name: str, clock: Clock, record: Callable[[AnyRecord], None], failed: Callable[[str, str], None]
    ) -> None:
        self.name = name
        self.clock = clock
        self.record = record
        self.session: Session | None = None
        self.background = False
        self.slice_ms = 10
        """How long one background ``drive_io`` may wait."""
        self.after_drive: list[Callable[[], None]] = []
        """Called on this thread after every drive: takes of ``take: always``."""
        self.calm_until = 0
        """Until when nobody will `post` a call."""
        self.inside = False
        self.running = 0
        """Callbacks that have not returned yet."""
        self.spins = 0
        self.callbacks = 0
        self.thread = 0
        self.calling: tuple[str, int] | None = None
        """The call in progress and its begin, for whoever looks for a hang."""
        self.turn: Callable[[int], object] | None = None
        """Called with a time in ms in place of the background ``drive_io``, also without a session."""
        self.refused_ns = -1
        """When a ``drive_io`` last answered anything but OK; -1: never."""
        self._failed = failed
        self._mailbox: list[tuple[int, int, Command]] = []
        self._order = 0
        self._lock = threading.Lock()
        self._signal = clock.signal()
        self._stopped = False
        self._quiet: Spin | None = None
        self._span = _NOT_DRIVEN
        """Begin and end of the last `drive`, without what is written down before and after."""
        self._held: list[AnyRecord] = []
        self._delay_at_spin = 0
        self._in_callbacks = 0
        """What callbacks took of the drive_io in progress, ns."""
        self.wait_at_callback = 0
        """`wait_in_spin` when the last callback of the drive_io in progress returned; 0 before the first."""
        self._in_calls = 0
        """All time in calls that callbacks made, ns."""
        self.task = self._start()

    @property
    def connected(self) -> bool:
        """Whether there is a session to call."""
        return self.session is not None

    def _start(self) -> Task:
        return self.clock.spawn(f"session {self.name}", self._loop)

    def post(self, *commands: Command) -> None:
        """Have these calls made at their times; earlier ones first, equal ones in this order."""
        with self._lock:
            for command in commands:
                self._order += 1
                heapq.heappush(self._mailbox, (command.due, self._order, command))
        self._signal.set()

    def pause(self) -> None:
        """No background drive from now on; on this thread, so that none is under way either."""
        self.background = False

    def resume(self) -> None:
        """Drive in the background again."""
        self.background = True
        self._signal.set()

    def stop(self) -> None:
        """End the thread after what has been posted."""
        self._stopped = True
        self._signal.set()

    def wait_in_spin(self) -> int:
        """For how much of the drive_io in progress the backend is not to blame, ns.

        This thread was runnable but not running, or in callbacks, which are the harness's.
        """
        return self.clock.run_delay_ns() - self._delay_at_spin + self._in_callbacks

    @contextmanager
    def callback(self) -> Iterator[None]:
        """A callback of the harness runs: only the calls that it makes take time of the backend's."""
        self.running += 1
        begin, calls, delay = self.clock.now_ns(), self._in_calls, self.clock.run_delay_ns()
        try:
            yield
        finally:
            self.running -= 1
            if not self.running and self.clock.task_id() == self.thread:
                took = self.clock.now_ns() - begin - (self._in_calls - calls)
                self._in_callbacks += max(took - (self.clock.run_delay_ns() - delay), 0)
                self.wait_at_callback = self.wait_in_spin()

    def drive(self, timeout_ms: int, cap: int | None = None, call: Callable[[], int] | None = None) -> int | None:
        """One drive_io (or ``call`` in its place), recorded; on this thread only.

        None when a callback of the script raised and the backend let that out, as it may (DSP-012).
        """
        assert self.session is not None
        before = self.callbacks
        self.spins += 1
        self._in_callbacks = self.wait_at_callback = 0
        self._delay_at_spin = self.clock.run_delay_ns()
        begin = self.clock.now_ns()
        self.inside = True
        code, wait, raised = 0, 0, ""
        try:
            if call is not None:
                code = call()
            elif cap is None:
                code = self.session.drive_io(timeout_ms)
            else:
                code = self.session.drive_io(timeout_ms, cap)
        except Exception as error:
            raised = _scripted(error)
            if not raised:
                raise
        finally:
            end = self.clock.now_ns()
            wait = self.wait_in_spin()
            self.inside = False
            for record in self._held:
                self.record(record)
            self._held.clear()
        self._span = begin, end
        if code:
            self.refused_ns = end
        self._note(begin, end, wait, self.callbacks - before, int(code), raised)
        return None if raised else int(code)

    def look(self, timeout_ms: int) -> int | None:
        """`drive`, and the takes of ``take: always``."""
        code = self.drive(timeout_ms)
        for call in self.after_drive:
            call()
        return code

    def keep(self, record: AnyRecord) -> None:
        """Write a record down, but not before the drive in progress is over.

        Writing gives the GIL away, and getting it back may take long: a status that falls due meanwhile
        would miss this drive, through no fault of the backend.
        """
        if self.inside and self.clock.task_id() == self.thread:
            self._held.append(record)
        else:
            self.record(record)

    def flush(self) -> None:
        """Write down the quiet spins so far."""
        if self._quiet is not None:
            self.record(self._quiet)
            self._quiet = None

    def _loop(self) -> None:
        self.thread = self.clock.task_id()
        while True:
            self._signal.clear()
            with self._lock:
                due = self._mailbox[0][0] if self._mailbox else NEVER
                command = heapq.heappop(self._mailbox)[2] if due <= self.clock.now_ns() else None
            if command is not None:
                self.execute(command)
            elif self._stopped and due == NEVER:
                break
            elif self.background and (self.session is not None or self.turn is not None):
                self._drive_until(due)
            else:
                self.clock.wait(self._signal, due)
        self.flush()

    def _drive_until(self, due: int) -> None:
        begin, before = self.clock.now_ns(), self.callbacks
        timeout_ms = min(self._patience_ms(begin), max(0, due - begin) // MS)
        self.calling = ("drive_io", begin)
        try:
            if self.turn is not None:
                self.turn(timeout_ms)
            else:
                self.look(timeout_ms)
        except StopPlay as stop:
            self._failed(stop.outcome, stop.detail)
        except Exception as error:
            self.background = False
            self._failed("raised", describe("drive_io", error))
        finally:
            self.calling = None
        now = self.clock.now_ns()
        if (self.callbacks == before and now - begin < min(timeout_ms * MS, _REST_NS) // 2) or timeout_ms == 0:
            self.clock.wait(self._signal, min(due, now + _REST_NS))

    def _patience_ms(self, now: int) -> int:
        """How long a drive_io may last that begins now. Takes after each want to be made soon.

        The last one of a calm is a usual one, and goes on when that is over: what falls due then is seen too.
        """
        slices = 1 if self.after_drive else (self.calm_until - now) // (self.slice_ms * MS) - 1
        return self.slice_ms * max(1, min(slices, _CALM_SLICES))

    def execute(self, command: Command, within: str = "") -> None:
        """Make a call now and write it down; on this thread only. ``within``: the callback that makes it."""
        raised = ""
        if command.record:
            self.flush()  # a drive that the script calls is a record of its own
        outer, delay = self.calling, self.clock.run_delay_ns()
        command.begin, self._span = self.clock.now_ns(), _NOT_DRIVEN
        self.calling = (command.op, command.begin)
        try:
            command.result = command.run()
        except RmwError as error:
            command.result = int(error.code)
            command.args["detail"] = error.detail
        except StopPlay as stop:
            self._failed(stop.outcome, stop.detail)
        except Exception as error:
            raised = describe(command.op, error)
        finally:
            self.calling = outer
        command.run = _made  # it may hold a callback that the script wants to see released
        command.end = self.clock.now_ns()
        if self._span != _NOT_DRIVEN:
            command.begin, command.end = self._span
        if self.running:
            self._in_calls += command.end - command.begin
        wait = self.clock.run_delay_ns() - delay
        if command.record:
            self.flush()
            self.keep(
                Act(
                    label=command.label, index=command.index, op=command.op, session=self.name, entity=command.entity,
                    args=command.args, due=command.due, begin=command.begin, end=command.end,
                    result=command.result, raised=raised, wait=wait, within=within,
                )
            )  # fmt: skip
        if raised:
            self._failed("raised", raised)
        command.done.set()
        if command.then is not None:
            command.then(command)

    def _note(self, begin: int, end: int, wait: int, callbacks: int, code: int, raised: str) -> None:
        quiet, sure = self._quiet, end - wait
        if quiet is not None and (quiet.code != code or callbacks or raised or end - quiet.begin > _QUIET_NS):
            self.flush()
            quiet = None
        gap = begin - quiet.end if quiet else 0
        merged = Spin(
            session=self.name,
            begin=quiet.begin if quiet else begin,
            end=end,
            sure=max(sure, quiet.sure) if quiet else sure,
            calls=quiet.calls + 1 if quiet else 1,
            callbacks=callbacks,
            code=code,
            gap=max(gap, quiet.gap) if quiet else gap,
            longest=max(end - begin, quiet.longest) if quiet else end - begin,
            wait=max(wait, quiet.wait) if quiet else wait,
            raised=raised,
        )
        self._quiet = merged
        if callbacks or raised:
            self.flush()


def _made() -> None:
    """In the place of a call that has been made."""


def _scripted(error: BaseException | None) -> str:
    """The label of the step that raised, also when the backend wrapped it; empty for an error of its own."""
    while error is not None and not isinstance(error, Scripted):
        error = error.__cause__
    return str(error) if error is not None else ""


def describe(call: str, error: Exception) -> str:
    """One line for an exception of a backend: what raised, what, and where."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"{call} raised {type(error).__name__}: {error} at {Path(frame.filename).name}:{frame.lineno}"
