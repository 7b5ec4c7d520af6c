"""A host, a thread that drives a session, and a backend, simulated: what the player would write down.

Times are milliseconds. The backend's own threads are not simulated: a sample takes up to a millisecond.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from random import Random
from typing import Any

from msgspec.structs import replace

from nros_conformance.trace.records import Act, AnyRecord, Event, Spin, State, Trace
from tests.judge.build import ALL, RDM, START, act, alive, counted, spin, state, step, trace

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

Occurrence = tuple[float, Callable[..., Event]]
"""When it is ready, and the event from the time of its callback, ``wait`` and ``earlier``."""


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
        callbacks, earlier = 0, 0.0
        while waiting and waiting[0][0] <= now:
            records.append(waiting.pop(0)[1](now, wait=waited, earlier=earlier))
            callbacks, earlier = callbacks + 1, waited
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


# --- scenarios ------------------------------------------------------------------------------------

T = 100.0

Change = Callable[[Random, list[float]], list[float]]
"""What a backend makes of the times at which something is really due."""


def correct(dice: Random, due: list[float]) -> list[float]:
    return due


def fires_late(dice: Random, due: list[float]) -> list[float]:
    return [at + 75 for at in due]


def fires_early(dice: Random, due: list[float]) -> list[float]:
    return [at - 20 for at in due]


def one_too_many(dice: Random, due: list[float]) -> list[float]:
    return sorted([*due, due[0] + 10 + 70 * dice.random()])


def one_too_few(dice: Random, due: list[float]) -> list[float]:
    left = dice.randrange(min(3, len(due)))
    return due[:left] + due[left + 1 :]


def never_fires(dice: Random, due: list[float]) -> list[float]:
    return []


BROKEN = {
    "late": fires_late,
    "early": fires_early,
    "one too many": one_too_many,
    "one too few": one_too_few,
    "never": never_fires,
}


def finish(expect: Any, ours: list[AnyRecord], calls: Sequence[Act | State], end: float) -> Trace:
    """Both threads' records, in the order in which they are written."""
    placed = [(written(one.end), one) for one in calls]
    last = 0.0
    for one in ours:
        last = max(last, written(one.t if isinstance(one, Event) else one.end))  # type: ignore[union-attr]
        placed.append((last, one))  # type: ignore[arg-type]
    placed.sort(key=lambda pair: pair[0])
    return trace(expect, [one for _, one in placed], setup=tuple(ALL), end=end + 60)


def numbered(times: list[float], kind: str = RDM) -> list[Occurrence]:
    def event(number: int) -> Callable[..., Event]:
        return lambda t, **waits: counted(t, number, kind=kind, **waits)

    return [(at, event(number)) for number, at in enumerate(times, 1)]


def silence(dice: Random, load: Load, backend: Change) -> Trace:
    """Samples in time, then none for 3.5 T: a miss per period."""
    calls, received = [], 0.0
    for index in range(5):
        begin, effect, end = call(dice, load, 20 + index * 0.4 * T)
        calls.append(act("data", begin, end, index=index, sequence=index + 1))
        received = effect + dice.random()
    begin = end
    over = begin + 3.5 * T
    calls.append(step("silence", begin, over + load.delay(dice)))
    due = [received + n * T for n in range(1, 8)]
    expect = [
        {"periodic": RDM, "of": "listener", "every": "1T", "since": "data.last", "until": "silence.end"},
        {"never": RDM, "of": "listener", "until": "data.last"},
    ]
    return finish(expect, drive(dice, load, numbered(backend(dice, due)), over + 60), calls, over)


def absence(dice: Random, load: Load, backend: Change) -> Trace:
    """A phase in which nobody calls drive_io, in the middle of a silence."""
    begin, effect, end = call(dice, load, 20)
    over = end + 5.5 * T
    due = [effect + dice.random() + n * T for n in range(1, 9)]
    ours = drive(dice, load, numbered(backend(dice, due)), over + 60, idle=(60, 250))
    expect = {"periodic": RDM, "of": "listener", "every": "1T", "since": "one", "until": "rest.end"}
    return finish(expect, ours, [act("one", begin, end, sequence=1), step("rest", end, over)], over)


def lost_once(dice: Random, load: Load, backend: Change) -> Trace:
    """A publisher that stops asserting: one transition, and no more."""
    begin, effect, end = call(dice, load, 20)
    over = end + 3.5 * T
    expect = [
        {"total": RDM, "of": "listener", "at": "one + 0.9T", "is": 0},
        {"total": RDM, "of": "listener", "at": "one + 1.6T", "is": 1},
        {"total": RDM, "of": "listener", "at": "end", "is": 1},
    ]
    ours = drive(dice, load, numbered(backend(dice, [effect + T])), over + 60)
    return finish(expect, ours, [act("one", begin, end, op="assert"), step("rest", end, over)], over)


def gone(dice: Random, load: Load, backend: Change) -> Trace:
    """A publisher that comes and goes."""
    come_begin, came, come_end = call(dice, load, 20)
    go_begin, went, go_end = call(dice, load, come_end + 4 * T)
    over = go_end + 3.5 * T
    times = backend(dice, [came + dice.random() * 1.9 * T, went + dice.random() * 1.9 * T])
    if backend is fires_late:
        times = [came + 3 * T, went + 3 * T]
    steps = [(1, 1), (0, -1), (1, 1)]
    ready: list[Occurrence] = [
        (at, lambda t, count=count, change=change, **waits: alive(t, count, change, **waits))
        for at, (count, change) in zip(times, steps, strict=False)
    ]
    expect = [
        {"level": "alive_count", "of": "listener", "is": 0, "until": "come"},
        {"level": "alive_count", "of": "listener", "is": 1, "by": "come + 2T"},
        {"level": "alive_count", "of": "listener", "is": 1, "from": "come + 2T", "until": "go"},
        {"level": "alive_count", "of": "listener", "is": 0, "by": "go + 2T"},
        {"level": "alive_count", "of": "listener", "is": 0, "from": "go + 2T"},
    ]
    calls = [act("come", come_begin, come_end, op="create"), act("go", go_begin, go_end, op="destroy")]
    created = state("created", come_begin, "talker", end=come_end)
    ours = drive(dice, load, ready, over + 60)
    return finish(expect, ours, [created, *calls, step("rest", go_end, over)], over)


SCENARIOS = {"silence": silence, "absence": absence, "lost once": lost_once, "gone": gone}
