"""When a moment of a suite was, as an interval.

An action took effect somewhere between its begin and its end; ``.begin`` and ``.end`` themselves are
known exactly. In a trace that is not whole, what may still have followed is unknown: the last of
several is then not the last one on record but at some time from there on.
"""

from __future__ import annotations

from nros_conformance.judge.index import CALLS, Index
from nros_conformance.judge.intervals import EVER, INF, Interval, instant
from nros_conformance.suite.moments import Moment
from nros_conformance.trace.records import Act


class NoSuchMoment(Exception):
    """A whole trace in which the anchor of a moment does not occur; the text says which."""


def resolve(index: Index, moment: Moment) -> Interval:
    """The interval of a moment. Raises `NoSuchMoment`; KeyError for a quantity that the header lacks."""
    found = anchor(index, moment)
    return found.shifted(moment.offset.ns(index.quantities)) if moment.offset.terms else found


def window_start(index: Index, moment: Moment) -> Interval:
    """As `resolve`; plain ``start`` is before everything."""
    return instant(-INF) if moment.label == "start" and not moment.offset.terms else resolve(index, moment)


def anchor(index: Index, moment: Moment) -> Interval:
    """The interval of a moment without its offset."""
    label = moment.label
    if moment.edge == "settled":
        return _settled(index, label)
    if label == "start":
        return instant(index.header.start)
    if label == "end":
        return index.script_end
    if moment.kind is not None:
        seen = [one for name in index.members(label) for one in index.events_of(name, moment.kind)]
        return _pick(index, moment, [one.when for one in sorted(seen)])
    if label in index.acts:
        acts = index.acts_of(label)
        found = [Interval(act.begin, act.end) for act in acts]
        return _pick(index, moment, found) if index.whole else _pick_unfinished(moment, found, acts)
    if label in index.faults:
        fault = index.faults[label]
        return _edge(moment, Interval(fault.begin, fault.end))
    states = [
        Interval(state.begin, state.end)
        for _, state in index.states
        if state.what == "created" and state.entity in index.members(label)
    ]
    return _pick(index, moment, states)


def call_of(index: Index, moment: Moment, session: str) -> int | None:
    """Position of the drive_io call of the script with whose end the moment coincides, if there is one."""
    if moment.offset.terms or moment.edge == "begin" or moment.label not in index.acts:
        return None
    placed = index.acts[moment.label]
    if not index.whole and (moment.index is None or moment.index < 0):
        return None
    if not -len(placed) <= (moment.index if moment.index is not None else -1) < len(placed):
        return None
    position, act = placed[-1 if moment.index is None else moment.index]
    return position if act.session == session and act.op in CALLS else None


def _settled(index: Index, label: str) -> Interval:
    ends = [
        one
        for one in index.matched
        if label == "start" or {one.publisher, one.subscription} & set(index.members(label))
    ]
    if not ends:
        return _missing(index, f"{label} was not matched with anything")
    last = max(ends, key=lambda one: one.end)
    return Interval(last.begin, last.end if index.whole else INF)


def _pick(index: Index, moment: Moment, found: list[Interval]) -> Interval:
    """One of several, or from the first one's begin to the last one's end."""
    if not found:
        return _missing(index, f"there is no {_name(moment)} in the trace")
    wanted = moment.index
    if wanted is None:
        last = INF if not index.whole and len(found) < len(index.members(moment.label)) else _latest(found)
        return _edge(moment, Interval(min(one.lo for one in found), last))
    if wanted < 0 and not index.whole:
        return Interval(_edge(moment, found[max(wanted, -len(found))]).lo, INF)
    if not -len(found) <= wanted < len(found):
        return _missing(index, f"there is no {_name(moment)} in the trace, only {len(found)} of them")
    return _edge(moment, found[wanted])


def _latest(found: list[Interval]) -> int:
    return max(one.hi for one in found)


def _pick_unfinished(moment: Moment, found: list[Interval], acts: list[Act]) -> Interval:
    """The same for actions that may not all be on record. None begins before it is due."""
    numbers = [act.index for act in acts]
    wanted = moment.index
    if wanted is not None and wanted >= 0:
        return _edge(moment, found[numbers.index(wanted)]) if wanted in numbers else EVER
    if wanted is not None:
        return Interval(max(act.due for act in acts), INF)
    begin = acts[0].due if numbers[0] == 0 else -INF
    return Interval(begin, min(one.lo for one in found) if moment.edge == "begin" else INF)


def _edge(moment: Moment, interval: Interval) -> Interval:
    if moment.edge == "begin":
        return instant(interval.lo)
    if moment.edge == "end":
        return instant(interval.hi)
    return interval


def _missing(index: Index, what: str) -> Interval:
    if index.whole:
        raise NoSuchMoment(what)
    return EVER


def _name(moment: Moment) -> str:
    name = f"{moment.label}.{moment.kind}" if moment.kind else moment.label
    if moment.index is not None:
        name += ".last" if moment.index == -1 else f"[{moment.index}]"
    elif moment.edge in ("created", "settled"):
        name += f".{moment.edge}"
    return name
