"""What must have happened for the rest of a scenario to mean anything. Not certainly met: inconclusive."""

from __future__ import annotations

from itertools import pairwise

from nros_conformance.judge.callbacks import not_made
from nros_conformance.judge.calls import fits, told
from nros_conformance.judge.events import span
from nros_conformance.judge.findings import Judged, clock, milliseconds
from nros_conformance.judge.index import CALLS, Index
from nros_conformance.judge.intervals import INF, Interval
from nros_conformance.judge.moments import resolve
from nros_conformance.suite import schema
from nros_conformance.trace.records import Act


def gap(index: Index, given: schema.GapGiven) -> Judged:
    """Time between consecutive actions, wherever each of them lies in its interval; drive_io is where it begins."""
    bounds = [f"at least {given.min}"] if given.min is not None else []
    bounds += [f"at most {given.max}"] if given.max is not None else []
    labels = [given.gap] if isinstance(given.gap, str) else given.gap
    wanted = f"{' and '.join(bounds)} between consecutive {' and '.join(labels)}"
    for label in labels:
        if not index.acts_of(label):
            return not_made(index, label)._replace(outcome="unclear", wanted=wanted)
    acts = [act for label in labels for act in index.acts_of(label)]
    # Actions may overlap, so their order is open; the n-th of them still lies between the n-th begin and the n-th end.
    begins, ends = sorted(acts, key=lambda act: act.begin), sorted(acts, key=_done)
    most = given.max.ns(index.quantities) if given.max is not None else INF
    least = given.min.ns(index.quantities) if given.min is not None else -INF
    widest = 0
    for (earliest, following), (latest, last) in zip(pairwise(begins), pairwise(ends), strict=True):
        between = Interval(following.begin - _done(latest), _done(last) - earliest.begin)
        widest = max(widest, between.hi)
        where = f"between {_which(earliest)} and {_which(following)}, {clock(index, last.end)}"
        if between.hi > most:
            got = f"up to {milliseconds(between.hi)} {where}"
            return Judged("unclear", wanted, got, between.hi - most, last.end)
        if between.lo < least:
            got = f"down to {milliseconds(between.lo)} {where}"
            return Judged("unclear", wanted, got, between.lo - least, last.end)
    return Judged("pass", wanted, f"{milliseconds(widest)} at most")


def _done(act: Act) -> int:
    return act.begin if act.op in CALLS else act.end


def _which(act: Act) -> str:
    return f"{act.label}[{act.index}]"


def returns(index: Index, given: schema.ReturnsGiven) -> Judged:
    """What the actions of a label answered."""
    wanted = f"{given.returns} answers {' or '.join(given.is_)}"
    acts = index.acts_of(given.returns)
    if not acts:
        return not_made(index, given.returns)._replace(outcome="unclear", wanted=wanted)
    for act in acts:
        if not fits(act, given.is_):
            return Judged("unclear", wanted, f"{given.returns}[{act.index}] answered {told(act)}", at=act.begin)
    return Judged("pass", wanted, told(acts[0]))


def driven(index: Index, given: schema.DrivenGiven) -> Judged:
    """The longest time without anybody in drive_io of a session, between two moments.

    Without moments: from its first call to the end of the script.
    """
    most = given.max.ns(index.quantities)
    wanted = f"session {given.driven} driven at least every {given.max}{span(given.from_, given.until)}"
    spins = index.drives(given.driven).spins
    if not spins:
        return Judged("unclear", wanted, "it was never driven")
    opens = spins[0].begin if given.from_.text == "start" else resolve(index, given.from_).lo
    whole_play = given.until.text == "end" and not index.whole
    closes = spins[-1].sure if whole_play else resolve(index, given.until).hi
    before, worst, at = opens, 0, opens
    for spin in spins:
        if spin.end < opens:
            continue
        if spin.begin > closes:
            break
        for pause, when in ((spin.begin - before, spin.begin), (spin.gap, spin.end)):
            if pause > worst:
                worst, at = pause, when
        before = max(before, spin.sure)
    if closes - before > worst:
        worst, at = closes - before, closes
    if worst > most:
        return Judged(
            "unclear",
            wanted,
            f"nobody in drive_io for up to {milliseconds(worst)} {clock(index, at)}",
            worst - most,
            at,
        )
    return Judged("pass", wanted, f"{milliseconds(worst)} at most")
