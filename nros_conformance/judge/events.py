"""Expectations about when events come and how many: never, periodic, total."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from nros_conformance.judge.drives import LAST, Drives
from nros_conformance.judge.findings import Judged, clock, miss, shown, together, unless_blind
from nros_conformance.judge.index import Index, Seen
from nros_conformance.judge.intervals import INF, Interval, decide, maybe_between, surely_between
from nros_conformance.judge.moments import call_of, resolve, window_start
from nros_conformance.judge.standing import excused, standing
from nros_conformance.rmw.events import EventKind, Side
from nros_conformance.suite import schema
from nros_conformance.suite.moments import Moment


def span(since: Moment, until: Moment) -> str:
    """A window in words; what is left out is the whole play."""
    return (f" from {since}" if since.text != "start" else "") + (f" until {until}" if until.text != "end" else "")


# --- never ----------------------------------------------------------------------------------------


def never(index: Index, expected: schema.Never) -> Judged:
    """No such event in the window; one exactly on a border is not in it."""
    since, until = window_start(index, expected.from_), resolve(index, expected.until)
    return together(_never(index, expected, entity, since, until) for entity in index.members(expected.of))


def _never(index: Index, expected: schema.Never, entity: str, since: Interval, until: Interval) -> Judged:
    kinds = _kinds(index, expected.never, entity)
    name = expected.never if isinstance(expected.never, str) else ", ".join(expected.never)
    wanted = f"no {'event' if name == 'ANY' else name} on {entity}{span(expected.from_, expected.until)}"
    claimed = [kind for kind in kinds if standing(index, entity, kind).state != "unclaimed"]
    events = sorted(seen for kind in claimed for seen in index.events_of(entity, kind))
    certain = [seen for seen in events if surely_between(seen.when, since, until)]
    doubtful = certain or [seen for seen in events if maybe_between(seen.when, since, until)]
    if doubtful:
        first, more = doubtful[0], len(doubtful) - 1
        got = shown(index, first) + (f", and {more} more" if more else "")
        if not certain:
            got += ", perhaps outside"
        # The way out of the window: it came too early for the end, or too late for the beginning.
        after, before = first.when.hi - since.lo, until.hi - first.when.lo
        nearest = after if after < before else -before
        return Judged(
            decide(bool(certain), True), wanted, got, nearest if abs(nearest) < INF // 2 else None, first.when.hi
        )
    excuses = [excused(index, entity, kind, needs_event=False) for kind in kinds]
    # ANY is about whatever is registered; kinds that are named have all to be.
    if any(excuses) if expected.never != "ANY" else all(excuses):
        excuse = next(one for one in excuses if one is not None)
        return excuse._replace(wanted=wanted)
    session = index.session_of(entity)
    judged = Judged("pass", wanted, "none came")
    if not _watched(index, session, since.hi):
        judged = Judged("unclear", wanted, f"session {session} was not driven afterwards")
    return unless_blind(index, session, judged, since.lo, until.hi)


def _kinds(index: Index, wanted: str | list[schema.KindName], entity: str) -> list[str]:
    if wanted != "ANY":
        return [wanted] if isinstance(wanted, str) else list(wanted)
    spec = index.scenario.entities.get(entity.partition("[")[0])
    side = Side.PUBLISHER if spec is not None and spec.publisher is not None else Side.SUBSCRIPTION
    return [kind.label for kind in EventKind if kind.side is side]


def _watched(index: Index, session: str, since: int) -> bool:
    """Whether silence from ``since`` on says anything: the session was driven, or had been destroyed."""
    if index.drives(session).surely() >= max(since, 1 - INF):
        return True
    return any(state.what == "destroyed" and not state.entity and state.session == session for _, state in index.states)


# --- periodic -------------------------------------------------------------------------------------


def periodic(index: Index, expected: schema.Periodic) -> Judged:
    """One more per period from ``since`` on: none early, none that calls of drive_io passed over."""
    since, until = resolve(index, expected.since), resolve(index, expected.until)
    return together(
        excused(index, entity, expected.periodic, needs_event=True)
        or _Periodic(index, expected, entity, since, until).judge()
        for entity in index.members(expected.of)
    )


class _Periodic:
    """The running total relative to ``since``, between what is sure and what is possible."""

    def __init__(self, index: Index, expected: schema.Periodic, entity: str, since: Interval, until: Interval) -> None:
        self.index = index
        self.kind = expected.periodic
        self.entity = entity
        self.since = since
        self.until = until
        self.period = expected.every.ns(index.quantities)
        self.session = index.session_of(entity)
        self.drives = index.drives(self.session)
        self.known_by = since.hi
        if self.kind == "RequestedDeadlineMissed" and index.header.declares.get("receives_only_in_drive_io"):
            # C31: such a backend times a sample when drive_io reads it.
            self.known_by = max(since.hi, self.drives.read_by(since.hi))
        self.wanted = f"{self.kind} on {entity} every {expected.every} since {expected.since}" + span(
            Moment.parse("start"), expected.until
        )
        self.pending = self._pending(expected.since)
        self.failure: Judged | None = None
        self.doubt: Judged | None = None

    def _pending(self, since: Moment) -> int:
        """How many at most may still have to be told that fell due before ``since``, the last of several publishes.

        A busy harness may have left gaps of a period and more between them: those misses are real.
        """
        if not any(act.op == "publish" for act in self.index.acts_of(since.label)):
            return 0
        born = [s.begin for _, s in self.index.states if s.entity == self.entity and s.what == "created"]
        first = max((begin for begin in born if begin <= self.since.hi), default=-INF)
        acts = [act for act in self.index.publishes_to(self.entity) if first <= act.end <= self.since.hi]
        gaps = (late.end - soon.begin + self.index.early for soon, late in itertools.pairwise(acts))
        events = self.index.events_of(self.entity, self.kind)
        told = sum(seen.change for seen in events if seen.when.hi < self.since.lo)
        # Told they were before the first period since was over, or together with the first miss that it brought.
        over = self.since.hi + self.period
        before = sum(seen.change for seen in events if self.since.lo <= seen.when.hi and seen.when.lo < over)
        with_first = next((seen.change - 1 for seen in events if seen.when.lo >= over), 0)
        return max(0, min(sum(gap // self.period for gap in gaps) - told, before + with_first))

    def judge(self) -> Judged:
        judged = self._judge()
        return unless_blind(self.index, self.session, judged, self.since.lo, self.until.hi)

    def _judge(self) -> Judged:
        index, since, until = self.index, self.since, self.until
        sure = possible = within = 0
        last: Seen | None = None
        for seen in index.events_of(self.entity, self.kind):
            if seen.when.hi < since.lo:
                continue
            if seen.when.lo >= until.hi:
                break
            self._late(seen, sure, possible)
            possible += max(seen.change, 0)
            if seen.when.lo > since.hi:
                sure += seen.change
                within = sure if seen.when.hi <= until.lo else within
            self._early(seen, sure, possible)
            last = seen
        self._late(None, sure, possible)
        if self.failure or self.doubt:
            return self.failure or self.doubt or Judged("none")
        owed = (until.hi - index.late - since.lo) // self.period
        if owed <= 0:
            return Judged("none", self.wanted, "no period is over before the end of the window")
        if (until.lo - index.late - since.hi) // self.period <= 0:
            return Judged("unclear", self.wanted, "perhaps no period is over before the end of the window")
        if within < owed:
            got = f"session {self.session} was not driven after {self._number(within + 1)} was due"
            return Judged("unclear", self.wanted, got)
        return Judged("pass", self.wanted, f"all {owed} came, the last: {shown(index, last)}" if last else "")

    def _late(self, seen: Seen | None, sure: int, possible: int) -> None:
        """Whether the next one is late: it was still missing at the end of a call, and came too late or never."""
        if self.failure:
            return
        position, when = (LAST, Interval(INF, INF)) if seen is None else (seen.position, seen.when)
        due = self.known_by + (possible + 1) * self.period + self.index.late
        if when.lo > due and (ended := self.drives.surely(position, when.lo, self.until.lo)) >= due:
            self.failure = self._missed(seen, possible + 1, due, ended, "fail")
        elif not self.doubt:
            due = self.since.lo + (max(0, sure - self.pending) + 1) * self.period + self.index.late
            if when.hi > due and (ended := self.drives.maybe(position, when.hi, self.until.hi)) >= due:
                self.doubt = self._missed(seen, sure + 1, due, ended, "unclear")

    def _missed(self, seen: Seen | None, number: int, due: int, ended: int, outcome: str) -> Judged:
        perhaps = outcome == "unclear"
        if seen is not None:
            late = seen.when.hi - due
            got = f"{shown(self.index, seen)}, {miss(late, perhaps=perhaps)}"
            return Judged(decide(not perhaps, True), self.wanted, got, late, seen.when.hi, missing=True)
        came = "had perhaps not come" if perhaps else "had not come"
        got = f"{self._number(number)} {came} when drive_io returned {clock(self.index, ended)}, {miss(ended - due)}"
        return Judged(decide(not perhaps, True), self.wanted, got, ended - due, due, missing=True)

    def _early(self, seen: Seen, sure: int, possible: int) -> None:
        """Whether the total is higher than the periods that are over allow."""
        when = seen.when
        sure -= self.pending
        earliest = self.since.lo + sure * self.period - self.index.early
        if surely_between(when, self.since, self.until) and sure > 0 and when.hi < earliest:
            if not self.failure:
                self.failure = self._hasty(seen, earliest - when.hi, "fail")
            return
        latest = self.since.hi + possible * self.period - self.index.early
        if not self.doubt and maybe_between(when, self.since, self.until) and possible > 0 and seen.soonest < latest:
            self.doubt = self._hasty(seen, latest - seen.soonest, "unclear")

    def _hasty(self, seen: Seen, by: int, outcome: str) -> Judged:
        got = f"{shown(self.index, seen)}, {miss(-by, perhaps=outcome == 'unclear')}"
        return Judged(decide(outcome == "fail", True), self.wanted, got, -by, seen.when.hi)

    def _number(self, number: int) -> str:
        return f"{self.kind} number {number} on {self.entity}"


# --- total ----------------------------------------------------------------------------------------


def total(index: Index, expected: schema.Total) -> Judged:
    """The sum of changes at a moment; what comes exactly then is included."""
    at = resolve(index, expected.at)
    least = expected.is_ if expected.is_ is not None else expected.at_least
    most = expected.is_ if expected.is_ is not None else expected.at_most
    return together(_total(index, expected, entity, at, least or 0, most) for entity in index.members(expected.of))


def _total(index: Index, expected: schema.Total, entity: str, at: Interval, least: int, most: int | None) -> Judged:
    bounds = [f"{least}"] if least == most else []
    if not bounds:
        bounds += [f"at least {least}"] if least else []
        bounds += [f"at most {most}"] if most is not None else []
    wanted = f"{expected.total} on {entity}: total {' and '.join(bounds)} at {expected.at}"
    excuse = excused(index, entity, expected.total, needs_event=least > 0)
    if excuse is not None:
        return excuse._replace(wanted=wanted)
    events = index.events_of(entity, expected.total)
    sure = sum(seen.change for seen in events if seen.when.hi <= at.lo)
    possible = sum(seen.change for seen in events if seen.when.lo <= at.hi)
    session = index.session_of(entity)
    judged = Judged("pass", wanted, _sum(sure, events), at=at.lo)
    if most is not None and possible > most:
        culprit = _reaching(events, most + 1)
        got = _sum(sure, events) if sure > most else f"total {sure} to {possible}"
        judged = Judged(
            decide(sure > most, True), wanted, f"{got}; {shown(index, culprit)}" if culprit else got,
            at=culprit.when.hi if culprit else None, surplus=(sure if sure > most else possible) - most,
        )  # fmt: skip
    elif sure < least:
        judged = _too_few(index, expected, events, session, least, (sure, possible), at)._replace(wanted=wanted)
    elif index.drives(session).surely() == -INF:
        judged = Judged("unclear", wanted, f"session {session} was never driven")
    return unless_blind(index, session, judged, until=at.hi)


def _too_few(
    index: Index, expected: schema.Total, events: Sequence[Seen], session: str, least: int,
    counted: tuple[int, int], at: Interval,
) -> Judged:  # fmt: skip
    """A fail needs a call of drive_io that ended at or after the moment and still did not bring it."""
    sure, possible = counted
    drives: Drives = index.drives(session)
    filling = _reaching(events, least)
    position, when = (filling.position, filling.when.lo) if filling else (LAST, INF)
    # At the end of the script the sessions stop being driven, sometimes just before it.
    needed = at.hi - index.late if expected.at.text == "end" else at.hi
    call = call_of(index, expected.at, session)
    missed = drives.surely(position, when) >= needed or (call is not None and call < position)
    certain = possible < least and missed
    got = _sum(possible, events) if possible == sure else f"total {sure} to {possible}"
    late = filling.when.hi - at.hi if filling else None
    if filling is not None and late is not None:
        got += f"; {shown(index, filling)}, {miss(late, perhaps=not certain)}"
    elif not certain:
        got += f", and session {session} was not driven afterwards"
    return Judged(decide(certain, True), "", got, late, at.hi, surplus=possible - least or sure - least, missing=True)


def _reaching(events: Sequence[Seen], number: int) -> Seen | None:
    """The event with which the total reaches a number."""
    reached = 0
    for seen in events:
        reached += seen.change
        if reached >= number:
            return seen
    return None


def _sum(number: int, events: Sequence[Seen]) -> str:
    """The total. Changes whose sum is another number than the total that came with them are no total."""
    reached = 0
    for seen in events:
        reached += seen.change
        if reached == number:
            told = seen.event.status.get("total_count", number)
            return f"total {number}" if told == number else f"changes that add up to {number}"
    return f"total {number}"
