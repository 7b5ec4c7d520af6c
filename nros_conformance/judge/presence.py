"""How many publishers there can have been, against alive_count (CNT-005)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from nros_conformance.judge.findings import Judged, shown, times
from nros_conformance.judge.index import Index
from nros_conformance.judge.intervals import INF, decide
from nros_conformance.rmw.events import EventKind

_WANTED = "counts are not negative, and alive_count is at most the number of publishers"


class _Life(NamedTuple):
    """A publisher, from the begin of its creation, when others may already see it, to the end of its destruction."""

    topic: str
    begin: int
    end: int


def possible(index: Index) -> Judged:
    """No count below zero, none above the publishers of the topic within the last lease or discovery bound."""
    events = [
        seen
        for seen in index.events
        if seen.event.kind == EventKind.LIVELINESS_CHANGED and not index.is_preset(seen.event.entity)
    ]
    if not events:
        return Judged("none", _WANTED, "no callback came")
    lives = list(_lives(index))
    memory = _memory(index)
    doubt: Judged | None = None
    for seen in events:
        event, when = seen.event, seen.when
        low = min(event.status.get("alive_count", 0), event.status.get("not_alive_count", 0))
        alive = event.status.get("alive_count", 0)
        topic = _topic(index, event.entity)
        own = [life for life in lives if life.topic == topic]
        most = sum(life.begin <= when.hi and life.end + memory >= when.lo for life in own)
        # An effect comes after its cause: what overlaps the begin of a creation lies after it.
        least = sum(life.begin <= when.hi and life.end + memory >= when.hi for life in own)
        if index.header.declares.get("LivelinessChanged.presence_only"):
            most, least = min(most, 1), min(least, 1)
        if low < 0:
            return Judged("fail", _WANTED, shown(index, seen), at=event.t)
        if alive > least:
            number = f"{most} publisher{'' if most == 1 else 's'} of {topic!r}"
            # In a trace that is cut short a creation in progress is not on record yet.
            certain = alive > most and index.whole
            judged = Judged(decide(certain, True), _WANTED, f"{shown(index, seen)}, with {number}", at=event.t)
            if judged.outcome == "fail":
                return judged
            doubt = doubt or judged
    return doubt or Judged("pass", _WANTED, times(len(events)))


def _topic(index: Index, entity: str) -> str:
    spec = index.scenario.entities.get(entity.partition("[")[0])
    return "" if spec is None else spec.subscription or spec.publisher or ""


def _lives(index: Index) -> Iterator[_Life]:
    """Publishers by topic only: one of another type or domain makes the bound wider, never too narrow."""
    for place, state in index.states:
        spec = index.scenario.entities.get(state.entity.partition("[")[0])
        if state.what != "created" or spec is None or spec.publisher is None:
            continue
        ends = [
            other.end
            for at, other in index.states
            if at > place and other.what == "destroyed" and other.code >= 0
            and other.entity in (state.entity, "") and other.session == state.session
        ]  # fmt: skip
        ends += [
            fault.end
            for at, fault in index.all_faults
            if at > place and fault.fault == "crash" and fault.of in (state.entity, state.session)
        ]
        yield _Life(spec.publisher, state.begin, min(ends, default=INF))


def _memory(index: Index) -> int:
    """For how long one that is gone may still be counted, ns."""
    quantities = index.quantities
    leases = [
        entity.qos.lease.ns(quantities)
        for entity in index.scenario.entities.values()
        if entity.qos.lease is not None and not entity.qos.lease.is_infinite
    ]
    hard = quantities.get("hard_liveliness_timeout", 0) + quantities.get("hard_liveliness_grace", 0)
    bounds = (quantities.get("discovery_bound", 0), quantities.get("connection_lease", 0), hard)
    return max(*bounds, *leases) + index.late
