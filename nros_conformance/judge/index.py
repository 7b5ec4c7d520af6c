"""A trace, arranged by what expectations ask for."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple, TypeAlias, TypeVar

from nros_conformance.judge.drives import Drives
from nros_conformance.judge.intervals import EVER, INF, Interval, instant
from nros_conformance.rmw.events import KIND_BY_LABEL
from nros_conformance.suite.schema import Scenario
from nros_conformance.trace.records import (
    Act,
    Blind,
    Cycles,
    Event,
    FaultRecord,
    Matched,
    Measure,
    Message,
    Registered,
    Spin,
    Starved,
    State,
    Trace,
)

_R = TypeVar("_R")
Placed: TypeAlias = list[tuple[int, _R]]
"""Records with their positions in the trace."""

CALLS = ("drive", "spin")
"""Operations that call drive_io, when they name a session; a ``drive`` step without one only lets time pass."""


class MissingQuantity(Exception):
    """A scenario uses a quantity that the header of its trace does not give."""


class _Quantities(dict[str, int]):
    def __missing__(self, name: str) -> int:
        raise MissingQuantity(f"the header has no quantity {name!r}")


class Seen(NamedTuple):
    """An event: where it stands in the trace, when it happened, and by how much it changed its total."""

    position: int
    when: Interval
    change: int
    event: Event

    @property
    def soonest(self) -> int:
        """Not before then it was called; it may have been due since ``when.lo``."""
        return min(self.when.lo + self.event.earlier, self.when.hi)


class Index:
    """One trace of one scenario. ``whole``: the script was played to its end."""

    def __init__(self, trace: Trace, scenario: Scenario) -> None:
        self.header = trace.header
        self.scenario = scenario
        self.quantities = _Quantities(trace.header.quantities)
        self.late = self.quantities["tolerance"]
        self.early = self.quantities["early"]
        self.length = 2 * len(trace.records)
        end = trace.end
        self.whole = end is not None and end.outcome == "done"
        self.acts: dict[str, Placed[Act]] = {}
        self.faults: dict[str, FaultRecord] = {}
        self.all_faults: Placed[FaultRecord] = []
        self.all_acts: Placed[Act] = []
        self.events: list[Seen] = []
        self.messages: dict[str, Placed[Message]] = {}
        self.registered: Placed[Registered] = []
        self.states: Placed[State] = []
        self.matched: list[Matched] = []
        self.blinds: list[Blind] = []
        self.measures: list[Measure] = []
        self.starved: list[Starved] = []
        self.cycles: dict[str, Cycles] = {}
        self.calls: dict[str, Placed[Act]] = {}
        self.by_kind: dict[tuple[str, int], list[Seen]] = {}
        self._spins: dict[str, Placed[Spin]] = {}
        self._drives: dict[str, Drives] = {}
        self._arrange(trace)
        self.script_end = self._script_end(trace)
        self.script_place = max((place for place, act in self.all_acts if not act.within), default=-1)
        """Position of the last action: what stands before it belongs to the script."""
        names: dict[str, tuple[str, ...]] = {}
        for name, entity in scenario.entities.items():
            names[name] = (name,) if entity.count == 1 else tuple(f"{name}[{i}]" for i in range(entity.count))
        self._members = names

    def _arrange(self, trace: Trace) -> None:
        """Sort the records out. Positions are even, so that a spin can be put in between."""
        news: dict[str, list[tuple[int, int]]] = {}
        """By session: position and time of the callbacks and takes since its last spin or call."""
        for position, record in enumerate(trace.records):
            place = 2 * position
            match record:
                case Event():
                    change = record.status.get("total_count_change", 0)
                    seen = Seen(place, Interval(record.t - record.wait, record.t), change, record)
                    self.events.append(seen)
                    self.by_kind.setdefault((record.entity, record.kind), []).append(seen)
                    news.setdefault(record.session, []).append((place, record.t))
                case Spin() if record.raised:
                    # An exception of a callback ended it: nothing had to be delivered by its end.
                    news.pop(record.session, None)
                case Spin():
                    since = news.pop(record.session, [])
                    if not record.callbacks:
                        # Calls without callbacks may be written down only when the next one has had some.
                        place = next((other - 1 for other, t in since if t >= record.end), place)
                    self._spins.setdefault(record.session, []).append((place, record))
                case Act():
                    self.all_acts.append((place, record))
                    self.acts.setdefault(record.label, []).append((place, record))
                    if record.session and not record.within:
                        news.pop(record.session, None)
                        if record.op in CALLS:
                            self.calls.setdefault(record.session, []).append((place, record))
                case Message():
                    self.messages.setdefault(record.entity, []).append((place, record))
                    news.setdefault(record.session, []).append((place, record.t))
                case Registered():
                    self.registered.append((place, record))
                case State():
                    self.states.append((place, record))
                case Matched():
                    self.matched.append(record)
                case FaultRecord():
                    self.faults.setdefault(record.label, record)
                    self.all_faults.append((place, record))
                case Blind():
                    self.blinds.append(record)
                case Cycles():
                    self.cycles[record.label] = record
                case Measure():
                    self.measures.append(record)
                case Starved():
                    self.starved.append(record)
        for acts in self.acts.values():
            if len(acts) > 1:
                acts.sort(key=lambda placed: placed[1].index)

    def _script_end(self, trace: Trace) -> Interval:
        """When the script was through; what follows is the clearing up."""
        ends = [act.end for _, act in self.all_acts if not act.within] + [fault.end for _, fault in self.all_faults]
        last = max(ends, default=None)
        if not self.whole:
            return EVER if last is None else Interval(last, INF)
        assert trace.end is not None
        return instant(trace.end.t if last is None else last)

    # Who.

    def members(self, names: str | Iterable[str]) -> tuple[str, ...]:
        """The entities that a name stands for: itself, or all of ``count``; ``ALL`` stands for every one."""
        if names == "ALL":
            return tuple(one for group in self._members.values() for one in group)
        if isinstance(names, str):
            return self._members.get(names, (names,))
        return tuple(one for name in names for one in self.members(name))

    def session_of(self, entity: str) -> str:
        """The session that an entity lives in."""
        spec = self.scenario.entities.get(entity.partition("[")[0])
        if spec is None:
            return ""
        return spec.session or ("pub" if spec.publisher is not None else "sub")

    def is_preset(self, entity: str) -> bool:
        """Whether the harness has preset counters of an entity, so that they do not start from zero."""
        names = {entity, entity.partition("[")[0], self.session_of(entity)}
        return any(fault.fault == "preset" and fault.of in names for _, fault in self.all_faults)

    def drives(self, session: str) -> Drives:
        """The delivery opportunities of a session."""
        found = self._drives.get(session)
        if found is None:
            found = self._drives[session] = Drives(self._spins.get(session, ()))
        return found

    def drives_of(self, entity: str) -> Drives:
        """The delivery opportunities of an entity."""
        return self.drives(self.session_of(entity))

    def sessions(self) -> Iterable[str]:
        """The sessions that were driven."""
        return self._spins

    # What.

    def events_of(self, entity: str, kind: str | int) -> Sequence[Seen]:
        """The events of a kind on an entity, in order."""
        number = KIND_BY_LABEL[kind] if isinstance(kind, str) else kind
        return self.by_kind.get((entity, number), ())

    def acts_of(self, label: str) -> list[Act]:
        """The actions of a label, in the order of their numbers."""
        return [act for _, act in self.acts.get(label, ())]

    def publishes_to(self, entity: str) -> list[Act]:
        """What the script published on the topic of an entity, by whomever; of a publisher, by itself."""
        spec = self.scenario.entities.get(entity.partition("[")[0])
        senders = {
            name
            for name, one in self.scenario.entities.items()
            if spec is not None and spec.subscription is not None and one.publisher == spec.subscription
        } or {entity}
        acts = [act for _, act in self.all_acts if act.op == "publish"]
        return sorted(
            (act for act in acts if {act.entity, act.entity.partition("[")[0]} & senders), key=lambda a: a.begin
        )

    def inside(self, position: int, act: Act) -> tuple[list[Seen], Placed[Message], list[Spin]]:
        """What happened within a call of drive_io that the script made: events, samples taken, spins.

        On a virtual clock many calls share one instant, so the positions decide first.
        """
        calls = self.calls.get(act.session, [])
        after = max((other for other, one in calls if other < position and one.end <= act.begin), default=-1)
        drives = self.drives(act.session)

        def belongs(place: int, session: str, t: int) -> bool:
            if session != act.session or not after < place < position or not act.begin <= t <= act.end:
                return False
            holder = drives.holding(place, position)
            return holder is None or holder.begin >= act.begin

        events = [seen for seen in self.events if belongs(seen.position, seen.event.session, seen.event.t)]
        messages = [
            (place, message)
            for placed in self.messages.values()
            for place, message in placed
            if belongs(place, message.session, message.t)
        ]
        spins = [
            spin
            for spin in drives.between(after, position)
            if act.begin <= spin.end <= act.end and (spin.begin >= act.begin or spin.end > act.begin)
        ]
        return events, messages, spins

    def starvation(self, since: int, until: int) -> int:
        """How long threads of the backend waited for a core at most, in the intervals that touch this window, ns."""
        return sum(one.wait for one in self.starved if one.begin <= until and one.end >= since)

    def blind(self, session: str, since: int = -INF, until: int = INF) -> bool:
        """Whether something on a session may have gone unseen between two moments."""
        return any(b.session in ("", session) and b.begin < until and since < b.end for b in self.blinds)
