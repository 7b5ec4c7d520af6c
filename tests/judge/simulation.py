"""A host, a thread that drives a session, and a backend, simulated: what the player would write down.

Times are milliseconds. The backend's own threads are not simulated: a sample takes up to a millisecond.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from random import Random

from msgspec.structs import replace

from nros_conformance.trace.records import AnyRecord, Event, Spin
from tests.judge.build import START, spin

MS = 1_000_000
SLICE = 10.0


@dataclasses.dataclass(frozen=True)
class Load:
    """How often a thread that could run has to wait for a processor, and for how long on average."""

    share: float
    mean: float

    def delay(self, dice: Random) -> float:
        return min(dice.expovariate(1 / self.mean), 150.0) if dice.random() < self.share else dice.random() * 0.05


LOADS = {"idle": Load(0.01, 0.3), "busy": Load(0.15, 6.0), "overloaded": Load(0.4, 25.0)}

Occurrence = tuple[float, Callable[[float, float], Event]]
"""When it is ready, and the event from the time of its callback and its wait."""


def drive(
    dice: Random, load: Load, ready: Sequence[Occurrence], until: float, idle: tuple[float, float] = (0, 0)
) -> list[AnyRecord]:
    """What the thread of session ``sub`` writes down while it calls drive_io in slices, but not while ``idle``."""
    records: list[AnyRecord] = []
    quiet: Spin | None = None
    waiting = sorted(ready, key=lambda one: one[0])
    now = 0.0
    while now < until:
        if idle[0] <= now < idle[1]:
            now = idle[1] + load.delay(dice)
            records += [quiet] if quiet is not None else []
            quiet = None
        begin = now
        # It sleeps until something is ready or the slice is over, and runs when the host lets it.
        wake = min(max(waiting[0][0], begin), begin + SLICE) if waiting else begin + SLICE
        waited = load.delay(dice)
        now = wake + waited
        callbacks = 0
        while waiting and waiting[0][0] <= now:
            records.append(waiting.pop(0)[1](now, waited))
            callbacks += 1
            more = load.delay(dice)
            waited, now = waited + more, now + more + 0.01
        one = spin(begin, now, wait=waited, callbacks=callbacks, longest=now - begin)
        one = replace(one, wait=one.end - one.sure)
        if quiet is not None and callbacks:
            records.append(quiet)
            quiet = None
        quiet = one if quiet is None else _merged(quiet, one)
        if callbacks:
            records.append(quiet)
            quiet = None
        now += load.delay(dice) + 0.002
    return [*records, quiet] if quiet is not None else records


def _merged(quiet: Spin, one: Spin) -> Spin:
    return Spin(
        session=quiet.session, begin=quiet.begin, end=one.end, sure=max(quiet.sure, one.sure), calls=quiet.calls + 1,
        gap=max(quiet.gap, one.begin - quiet.end), longest=max(quiet.longest, one.longest),
        wait=max(quiet.wait, one.wait),
    )  # fmt: skip


def call(dice: Random, load: Load, due: float) -> tuple[float, float, float]:
    """A call that the script makes: its begin, when it took effect, its end."""
    begin = due + load.delay(dice)
    effect = begin + load.delay(dice)
    return begin, effect, effect + load.delay(dice)


def written(t: int) -> float:
    """Milliseconds of a time in a record."""
    return (t - START) / MS
