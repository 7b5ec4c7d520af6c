"""Scenario and backend in, trace out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext

import msgspec

from nros_conformance.play.driver import StopPlay, describe
from nros_conformance.play.plan import Plan
from nros_conformance.play.script import Script
from nros_conformance.play.stage import Stage
from nros_conformance.play.starvation import Watch
from nros_conformance.rmw.backend import Backend
from nros_conformance.rmw.clock import Clock, VirtualClock
from nros_conformance.suite.loader import typed
from nros_conformance.trace.records import AnyRecord, End, Header

_OPEN: AbstractContextManager[None] = nullcontext()


def play(
    plan: Plan, adapter: type[Backend], clock: Clock, write: Callable[[Header | AnyRecord], None],
    gate: AbstractContextManager[object] = _OPEN, watch: Watch | None = None,
) -> End:  # fmt: skip
    """Play one scenario; ``write`` gets the header, every record as it happens, and the end.

    ``gate`` is held while the stage is set up; ``watch`` says what threads have to wait for.

    Whatever the backend does ends up in the trace; nothing is raised but interrupts. On a
    `VirtualClock` the call has to come from inside `VirtualClock.run`.
    """
    start = clock.now_ns()
    write(msgspec.structs.replace(plan.header, start=start))
    outcome, detail = "done", ""
    stage: Stage | None = None

    def peers() -> Sequence[int]:
        return [] if stage is None else stage.peer.processes()

    with _OPEN if watch is None else watch.telling(write, peers):
        try:
            scenario = typed(plan.header.scenario, plan.key)
            with gate:
                try:
                    stage = Stage(plan, scenario, adapter, clock, write)
                except StopPlay:
                    raise
                except Exception as error:
                    raise StopPlay("raised", describe(adapter.__name__, error)) from error
                script = Script(stage, start)  # before anything can call back
                stage.open()
            script.play(scenario.script)
        except StopPlay as stop:
            outcome, detail = stop.outcome, stop.detail
        except Exception as error:
            outcome, detail = "error", describe("the player", error)
        if stage is not None and outcome != "hang":
            outcome, detail = _leave(stage, outcome, detail)
        elif stage is not None:
            stage.peer.close(stage.folder)  # what hangs may be the call of another thread
    end = End(outcome=outcome, t=clock.now_ns(), detail=detail)
    write(end)
    return end


def _leave(stage: Stage, outcome: str, detail: str) -> tuple[str, str]:
    """Close everything; a failure here counts only if there was none before."""
    stage.stopped = None
    stage.abort.clear()
    try:
        stage.close()
    except StopPlay as stop:
        return (outcome, detail) if outcome != "done" else (stop.outcome, stop.detail)
    except Exception as error:
        return (outcome, detail) if outcome != "done" else ("raised", describe("close", error))
    return outcome, detail


def play_virtually(plan: Plan, adapter: type[Backend]) -> list[Header | AnyRecord]:
    """Play on a virtual clock of its own, in this thread; the records in order."""
    records: list[Header | AnyRecord] = []
    clock = VirtualClock()
    clock.run(lambda: play(plan, adapter, clock, records.append))
    return records
