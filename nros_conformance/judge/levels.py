"""Expectations about alive_count and not_alive_count, which LivelinessChanged reports in steps from 0.

A subscription that is destroyed and created again begins at 0 again; until then what it reported last counts.
"""

from __future__ import annotations

from typing import NamedTuple

from nros_conformance.judge.drives import LAST
from nros_conformance.judge.events import span
from nros_conformance.judge.findings import Judged, clock, miss, shown, together, unless_blind
from nros_conformance.judge.index import Index, Seen
from nros_conformance.judge.intervals import INF, Interval, decide, maybe_between, surely_between
from nros_conformance.judge.moments import anchor, resolve, window_start
from nros_conformance.judge.standing import excused
from nros_conformance.suite import schema
from nros_conformance.suite.moments import Moment

KIND = "LivelinessChanged"
_FOREVER = Interval(INF, INF)


class _Step(NamedTuple):
    """A value and for how long it was the last one reported. Without an event: what a life begins with."""

    value: int
    seen: Seen | None
    since: Interval
    until: Interval
    position: int
    next_position: int

    @property
    def reborn(self) -> bool:
        """Whether a later life than the first begins with it."""
        return self.seen is None and self.position >= 0


def level(index: Index, expected: schema.Level) -> Judged:
    """``by``: reached between the anchor and the moment; else throughout the window."""
    return together(_level(index, expected, entity) for entity in index.members(expected.of))


def _level(index: Index, expected: schema.Level, entity: str) -> Judged:
    when = f" by {expected.by}" if expected.by is not None else span(*_window(expected))
    wanted = f"{expected.level} {expected.is_} on {entity}{when}"
    # The count is 0 as long as nothing is reported, so silence proves nothing about 0.
    excuse = excused(index, entity, KIND, needs_event=expected.is_ != 0)
    if excuse is not None:
        return excuse._replace(wanted=wanted)
    steps = _steps(index, entity, expected.level)
    judged = (_throughout if expected.by is None else _by)(index, expected, entity, steps)
    return judged._replace(wanted=wanted)


def _steps(index: Index, entity: str, name: str) -> list[_Step]:
    steps: list[_Step] = []
    value, seen, since, position = 0, None, Interval(-INF, -INF), -1
    born = [
        (place, Interval(state.begin, state.end), None)
        for place, state in index.states
        if state.entity == entity and state.what == "created"
    ]
    events = [(one.position, one.when, one) for one in index.events_of(entity, KIND)]
    for place, when, following in sorted([*born, *events], key=lambda change: change[0]):
        if following is None and seen is None:
            continue  # nothing to forget
        steps.append(_Step(value, seen, since, when, position, place))
        value = following.event.status.get(name, 0) if following else 0
        seen, since, position = following, when, place
    steps.append(_Step(value, seen, since, _FOREVER, position, LAST))
    return steps


def _window(expected: schema.Level) -> tuple[Moment, Moment]:
    return expected.from_ or Moment.parse("start"), expected.until or Moment.parse("end")


def _by(index: Index, expected: schema.Level, entity: str, steps: list[_Step]) -> Judged:
    """Reached at some time from the anchor of the moment on, and not later than calls of drive_io allow.

    What comes after the script's end does not count: there the harness itself destroys entities.
    """
    assert expected.by is not None
    by, first = resolve(index, expected.by), anchor(index, expected.by)
    if by.lo < first.lo:
        first = by
    drives, session = index.drives_of(entity), index.session_of(entity)
    reached = [step for step in steps if step.value == expected.is_]
    certain = next((step for step in reached if step.until.lo >= first.hi and _within_script(index, step)), None)
    due = by.lo + index.late
    if certain is not None:
        at = certain.since.hi
        in_time = at <= due or drives.maybe(certain.position, at) < due
        if certain.seen is None and drives.surely() < min(first.hi, index.script_end.lo - index.late):
            return Judged("unclear", got=f"session {session} was not driven afterwards", at=first.hi)
        if in_time:
            judged = Judged("pass", got=_told(index, certain), at=max(at, index.header.start))
            return unless_blind(index, session, judged, first.lo, by.hi)
    possible = next((step for step in reached if step.until.hi >= first.lo), None)
    due = by.hi + index.late
    if possible is None:
        ended = drives.surely()
        late = due <= index.script_end.lo and ended >= due
        got = _told(index, steps[-1])
        got += f", and drive_io returned {clock(index, ended)}" if late else ", but the script ended before it was late"
        judged = Judged(decide(late, True), "", got, ended - due if late else None, by.hi, missing=True)
        return unless_blind(index, session, judged, first.lo)
    if possible.seen is None and not possible.reborn:
        judged = Judged("unclear", got=f"{_told(index, possible)} at first, perhaps only before {expected.by.label}")
        return unless_blind(index, session, judged, first.lo)
    late = possible.since.lo > due and drives.surely(possible.position, possible.since.lo) >= due
    late = late and due <= index.script_end.lo
    nearest = possible.since.hi - due
    over = nearest <= 0
    missed = "but the script was over by then" if over else miss(nearest, perhaps=not late)
    got = f"{_told(index, possible)}, {missed}"
    judged = Judged(decide(late, True), "", got, None if over else nearest, possible.since.hi, missing=True)
    return unless_blind(index, session, judged, first.lo)


def _within_script(index: Index, step: _Step) -> bool:
    return step.seen is None or step.position < index.script_place or step.since.hi < index.script_end.lo


def _throughout(index: Index, expected: schema.Level, entity: str, steps: list[_Step]) -> Judged:
    """No departure in the window, and what was wrong at its beginning put right in time."""
    opens, closes = _window(expected)
    since, until = window_start(index, opens), resolve(index, closes)
    drives, session = index.drives_of(entity), index.session_of(entity)
    failure: Judged | None = None
    doubt: Judged | None = None
    previous: _Step | None = None
    for step in steps:
        if step.value != expected.is_:
            departed = previous is not None and previous.value == expected.is_ and not step.reborn
            certain = departed and surely_between(step.since, since, until)
            certain = certain or _shown_at_return(index, expected, entity, step, since, until, certainly=True)
            if certain:
                # What was wrong before the window is a failure from its beginning on.
                at = max(step.since.hi, since.hi)
                failure = Judged("fail", got=_told(index, step), at=at, missing=not departed)
                break
            possible = departed and maybe_between(step.since, since, until)
            possible = possible or _shown_at_return(index, expected, entity, step, since, until, certainly=False)
            if possible and doubt is None:
                doubt = Judged("unclear", got=f"{_told(index, step)}, perhaps within the window", at=step.since.hi)
        previous = step
    if failure is None and doubt is None and drives.surely() < min(since.hi, index.script_end.lo - index.late):
        doubt = Judged("unclear", got=f"session {session} was not driven afterwards")
    judged = failure or doubt or Judged("pass", got=_told(index, steps[-1]) if len(steps) == 1 else "as wanted")
    return unless_blind(index, session, judged, since.lo, until.hi)


def _shown_at_return(
    index: Index, expected: schema.Level, entity: str, step: _Step, since: Interval, until: Interval, *, certainly: bool
) -> bool:
    """Whether a call of drive_io in the window returned with this value although another one was due."""
    drives = index.drives_of(entity)
    if step.reborn:
        since = Interval(max(since.lo, step.since.lo), max(since.hi, step.since.hi))
    if certainly:
        due = max(since.hi + index.late, 1 - INF)  # -INF is no call at all
        return step.until.lo > due and drives.surely(step.next_position, step.until.lo, until.lo, step.position) >= due
    due = max(since.lo + index.late, 1 - INF)
    return step.until.hi > due and drives.maybe(step.next_position, step.until.hi, until.hi, step.position) >= due


def _told(index: Index, step: _Step) -> str:
    if step.seen is not None:
        return shown(index, step.seen)
    after = f" after it was created anew {clock(index, step.since.hi)}" if step.reborn else ""
    return f"no LivelinessChanged came{after}"
