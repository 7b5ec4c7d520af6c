"""Expectations about the turns of a cycle step."""

from __future__ import annotations

from nros_conformance.formats.counts import repeatedly
from nros_conformance.judge.calls import fits, told
from nros_conformance.judge.findings import Judged
from nros_conformance.judge.index import Index
from nros_conformance.suite import schema
from nros_conformance.trace.records import Cycles


def cycles(index: Index, expected: schema.Cycles) -> Judged:
    """What every cycle did. A cycle that was not played to its end says nothing."""
    played = index.cycles.get(expected.cycles)
    if played is None or not played.times:
        return Judged("none" if index.whole else "unclear", got=f"no cycle of {expected.cycles} was played")
    return _answers(played, expected) if expected.step is not None else _amount(played, expected)


def _answers(played: Cycles, expected: schema.Cycles) -> Judged:
    step = expected.step or ""
    wanted = f"{step} answers {' or '.join(expected.is_)} in each cycle"
    acts, counts = played.calls.get(step, []), played.answers.get(step, [])
    if not acts:
        return Judged("none", wanted, f"{step} was not called")
    wrong = [(act, count) for act, count in zip(acts, counts, strict=True) if not fits(act, expected.is_)]
    if wrong:
        answers = ", ".join(f"{told(act)} {repeatedly(count)}" for act, count in wrong)
        return Judged("fail", wanted, f"{answers} in {played.times} cycles", at=wrong[0][0].begin)
    return Judged("pass", wanted, f"{repeatedly(sum(counts))} in {played.times} cycles", at=played.begin)


def _amount(played: Cycles, expected: schema.Cycles) -> Judged:
    what, unit = f"{expected.of} counts", str(expected.event)
    if expected.sampled is not None:
        what, unit = f"{expected.sampled} takes", "samples"
    wanted = f"{what} at least {expected.at_least} {unit} in each cycle"
    few, many = amount(played, expected)
    got = f"{few} to {many} in {played.times} cycles" if few != many else f"{few} in each of {played.times} cycles"
    return Judged("pass" if few >= expected.at_least else "fail", wanted, got, at=played.begin)


def amount(played: Cycles, expected: schema.Cycles) -> tuple[int, int]:
    """The fewest and the most samples or events in a cycle."""
    if expected.sampled is not None:
        few, many = played.received.get(expected.sampled, [0, 0])
    else:
        few, many = played.events.get(f"{expected.of}/{expected.event}", [0, 0])
    return few, many
