"""Arbitrary traces for Hypothesis: well-formed, not plausible, on a coarse grid so that ties are frequent."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from random import Random
from typing import Any

from hypothesis import strategies as st
from msgspec.structs import replace

from nros_conformance.rmw.clock import MS
from nros_conformance.trace.records import Act, AnyRecord, Event, FaultRecord, Spin, State, Trace
from tests.judge.build import (
    RDM,
    START,
    act,
    alive,
    call,
    counted,
    fault,
    spin,
    state,
    step,
    take,
    taken,
    trace,
)
from tests.judge.simulation import BROKEN, LOADS, SCENARIOS, correct

GRID = 5
END = 600

EXPECTATIONS: list[dict[str, Any]] = [
    {"never": RDM, "of": "listener", "until": "one"},
    {"never": "ANY", "of": "ALL", "from": "one", "until": "two + 0.5T"},
    {"periodic": RDM, "of": "listener", "every": "1T", "since": "one", "until": "two"},
    {"periodic": RDM, "of": "listener", "every": "1T", "since": "data.last", "until": "end"},
    {"periodic": RDM, "of": "listener", "every": "0.5T", "since": "data.first", "until": "rest.end"},
    {"total": RDM, "of": "listener", "at": "two", "is": 2},
    {"total": RDM, "of": "listener", "at": "end", "at_least": 3},
    {"total": RDM, "of": "listener", "at": "call.end", "is": 1},
    {"total": "MessageLost", "of": "listener", "at": "one + 1T", "at_most": 1},
    {"level": "alive_count", "of": "listener", "is": 1, "by": "one + 1T"},
    {"level": "alive_count", "of": "listener", "is": 0, "by": "two"},
    {"level": "alive_count", "of": "listener", "is": 1, "from": "one", "until": "two"},
    {"level": "alive_count", "of": "listener", "is": 0, "from": "two + 0.5T"},
    {"inside": "call", "event": RDM, "of": "listener", "at_least": 1},
    {"callbacks": "call", "each": True, "at_most": 1},
    {"callbacks": "call", "at_least": 1, "counting": ["events"]},
    {"takes": "call", "at_most": "1T"},
    {"takes": "call", "at_least": "0.2T"},
    {"callback": "reg", "is": "never", "from": "one", "until": "two"},
    {"callback": "reg", "is": "some", "until": "two"},
    {"returns": "data", "is": ["OK"]},
    {"returns": "data", "is": ["ANY_ERROR"], "some": True},
    {"received": "data", "of": "listener"},
    {"received": "data", "of": "listener", "is": "none"},
    {"conserved": "listener", "from": ["talker"], "since": "one"},
    {"any_of": [[{"never": RDM, "of": "listener", "from": "two"}], [{"total": RDM, "of": "listener", "is": 1}]]},
    {"never": RDM, "of": "listener", "from": "listener.LivelinessChanged[0]", "until": "gone"},
]
GIVENS: list[dict[str, Any]] = [{"gap": "data", "max": "1T"}, {"driven": "sub", "max": "1T", "from": "one"}]

WAITS = (0, 0, 5, 10, 40)


class Dice(Random):
    """The choices of a story: one number of Hypothesis decides them all, which is twenty times as fast."""

    def grid(self, most: float) -> int:
        """A time up to ``most``, ms."""
        return self.randint(0, int(most) // GRID) * GRID


def _subscriber(dice: Dice, calls: int) -> list[tuple[float, AnyRecord]]:
    """What the thread of session ``sub`` writes down, each record with the time at which it does."""
    records: list[tuple[float, AnyRecord]] = []
    now, number, numbers = 0.0, 0, {RDM: 0, "MessageLost": 0}
    present = 0
    for _ in range(calls):
        now += dice.choice((0, 0, 0, 5, 60))
        length = dice.choice((0, 10, 10, 30, 100, 250))
        end, wait = now + length, min(dice.choice(WAITS), length)
        times = sorted(now + dice.grid(length) for _ in range(dice.choice((0, 0, 0, 1, 1, 2))))
        for t in times:
            own = min(dice.choice(WAITS), t - now)
            waits: dict[str, Any] = {"wait": own, "earlier": dice.choice((0, own / 2))}
            what = dice.choice((RDM, RDM, "MessageLost", "LivelinessChanged", "reg"))
            if what == "LivelinessChanged":
                change = 1 if present == 0 else dice.choice((-1, -1, 1, 0))
                present += change
                records.append((t, alive(t, present, change, **waits)))
            else:
                kind = RDM if what == "reg" else what
                change = dice.choice((1, 1, 1, 2, 0))
                numbers[kind] += change
                registration = "reg" if what == "reg" else ""
                records.append((t, counted(t, numbers[kind], change, kind=kind, registration=registration, **waits)))
        many = 1 if times else dice.choice((1, 1, 5))
        longest = max(length / many, GRID) if dice.random() < 0.5 else 0
        records.append((end, spin(now, end, wait=wait, calls=many, callbacks=len(times), longest=longest)))
        if dice.random() < 0.25:
            records.append((end, call("call", now, end, index=number)))
            number += 1
        if dice.random() < 0.2:
            sequences = dice.choices(range(1, 5), k=dice.randint(0, 3))
            records += [(end, one) for one in taken(end, *sequences)]
            records.append((end, take("take", end, len(sequences) or -10)))
        if dice.random() < 0.08:
            records.append((end, state("destroyed", end, "listener")))
        now = end
    return records


def _others(dice: Dice) -> Iterator[Act]:
    """What the script does elsewhere."""

    def instantly(label: str, at: float, **more: Any) -> Act:
        return act(label, at, at + dice.grid(20), **more)

    at = dice.grid(20)
    for index in range(dice.randint(1, 3)):
        yield instantly("data", at, index=index, sequence=index + 1, result=dice.choice((0, 0, 0, -2)))
        at += dice.grid(100)
    yield instantly("one", dice.grid(300), op="assert")
    yield instantly("two", dice.grid(300), op="assert")
    yield instantly("reg", dice.grid(20), op="register", entity="listener", session="sub", kind=1)


def _story(
    seed: int, calls: int, expect: list[dict[str, Any]], given: list[dict[str, Any]], level: str
) -> Trace:  # fmt: skip
    dice = Dice(seed)
    records = _subscriber(dice, calls)
    records += [((one.end - START) / MS, one) for one in _others(dice)]
    gone = dice.grid(400)
    records += [(gone + 10, fault("gone", gone, "freeze", end=gone + 10)), (END, step("rest", 0, END))]
    records.sort(key=lambda placed: placed[0])
    began = [state("created", 0, "talker"), state("created", 0, "listener")]
    return trace(
        expect, began, [one for _, one in records], given=given, levels={"RDM-001": level}, end=END + 50
    )  # fmt: skip


def stories() -> st.SearchStrategy[Trace]:
    """Whole traces with one to four expectations."""
    return st.builds(
        _story,
        seed=st.integers(0, 2**32),
        calls=st.integers(1, 9),
        expect=st.lists(st.sampled_from(EXPECTATIONS), min_size=1, max_size=4, unique_by=str),
        given=st.lists(st.sampled_from(GIVENS), max_size=1),
        level=st.sampled_from(["must", "must", "should"]),
    )


def plays() -> st.SearchStrategy[Trace]:
    """Traces of backends, correct and defective, on hosts of all kinds."""
    return st.builds(
        lambda scenario, load, backend, seed: scenario(Random(seed), load, backend),
        st.sampled_from(list(SCENARIOS.values())),
        st.sampled_from(list(LOADS.values())),
        st.sampled_from([correct, correct, *BROKEN.values()]),
        st.integers(0, 2**32),
    )


def narrowed(wide: Trace, seed: int) -> Trace:
    """The same with each act, event and end of a spin somewhere inside of the interval that it had."""
    dice = Dice(seed)
    began = [one.begin for one in wide.records if isinstance(one, State)]

    def within(lo: int, hi: int) -> tuple[int, int]:
        left, right = sorted((dice.randint(0, 4), dice.randint(0, 4)))
        return lo + (hi - lo) * left // 4, lo + (hi - lo) * right // 4

    def narrow(one: AnyRecord) -> AnyRecord:
        if isinstance(one, Event):
            # An effect stays behind its cause.
            lo, hi = within(max([one.t - one.wait, *(t for t in began if t <= one.t)]), one.t)
            soonest = one.t - one.wait + one.earlier
            hi = max(hi, soonest)
            return replace(one, t=hi, wait=hi - lo, earlier=max(0, soonest - lo))
        if isinstance(one, Spin):
            lo, hi = within(one.sure, one.end)
            return replace(one, sure=lo, end=hi)
        if isinstance(one, FaultRecord) or (isinstance(one, Act) and one.op not in ("drive", "take")):
            lo, hi = within(one.begin, one.end)
            return replace(one, begin=lo, end=hi)
        return one

    return Trace(wide.header, tuple(narrow(one) for one in wide.records))


def stretched(one: Trace, factor: int) -> Trace:
    """The same story told ``factor`` times more slowly."""

    def moment(t: int) -> int:
        return START + (t - START) * factor

    fields: dict[str, Callable[[int], int]] = dict.fromkeys(("begin", "end", "sure", "t", "due"), moment)
    fields |= dict.fromkeys(("wait", "earlier", "gap", "longest"), lambda ns: ns * factor)

    def slower(record: AnyRecord) -> AnyRecord:
        present = {name: change(getattr(record, name)) for name, change in fields.items() if hasattr(record, name)}
        return replace(record, **present)

    quantities = {name: ns * factor for name, ns in one.header.quantities.items()}
    return Trace(replace(one.header, quantities=quantities), tuple(slower(record) for record in one.records))
