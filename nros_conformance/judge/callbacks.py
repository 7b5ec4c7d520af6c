"""Expectations about callbacks: inside a call of drive_io, of a registration, how many in a call."""

from __future__ import annotations

from collections.abc import Sequence

from nros_conformance.judge.drives import LAST
from nros_conformance.judge.events import span
from nros_conformance.judge.findings import Judged, clock, shown, times, together, unless_blind
from nros_conformance.judge.index import Index, Seen
from nros_conformance.judge.intervals import INF, Interval, decide, maybe_between, surely_between
from nros_conformance.judge.moments import resolve, window_start
from nros_conformance.judge.standing import answered, excused
from nros_conformance.rmw.events import EventKind, kind_label
from nros_conformance.suite import schema
from nros_conformance.trace.records import Act


def not_made(index: Index, label: str) -> Judged:
    """The judgement about actions that are not in the trace."""
    return Judged("none" if index.whole else "unclear", got=f"there is no {label} in the trace")


# --- inside ---------------------------------------------------------------------------------------


def inside(index: Index, expected: schema.Inside) -> Judged:
    """An event within the call, with these fields; occurrences count, callbacks of LivelinessChanged."""
    return together(_inside(index, expected, entity) for entity in index.members(expected.of))


def _inside(index: Index, expected: schema.Inside, entity: str) -> Judged:
    fields = "".join(f", {name} {value}" for name, value in expected.status.items())
    count = f" {expected.at_least} times" if expected.at_least > 1 else ""
    wanted = f"{expected.event} on {entity} inside {expected.inside}{count}{fields}"
    excuse = excused(index, entity, expected.event, needs_event=True)
    if excuse is not None:
        return excuse._replace(wanted=wanted)
    placed = index.acts.get(expected.inside)
    if not placed:
        return not_made(index, expected.inside)._replace(wanted=wanted)
    all_of_kind = index.events_of(entity, expected.event)
    within = [
        seen
        for position, act in placed
        for seen in index.inside(position, act)[0]
        if seen.event.entity == entity and kind_label(seen.event.kind) == expected.event
    ]
    fitting = [seen for seen in within if expected.status.items() <= seen.event.status.items()]
    number = sum(_occurrences(seen) for seen in fitting)
    if number >= expected.at_least:
        return Judged("pass", wanted, shown(index, fitting[0]), at=fitting[0].when.hi)
    begin, end = placed[0][1].begin, placed[-1][1].end
    got, nearest = _instead(index, all_of_kind, within, begin, end)
    judged = Judged(decide(index.whole, True), wanted, got, nearest, end, missing=True)
    return unless_blind(index, index.session_of(entity), judged, begin, end)


def _occurrences(seen: Seen) -> int:
    return 1 if seen.event.kind == EventKind.LIVELINESS_CHANGED else seen.change


def _instead(
    index: Index, events: Sequence[Seen], within: Sequence[Seen], begin: int, end: int
) -> tuple[str, int | None]:
    """The event that comes closest to what was wanted, and by how much it missed the call."""
    if within:
        return shown(index, within[-1]), None
    apart = [(seen.when.hi - end if seen.when.hi >= end else seen.when.hi - begin, seen) for seen in events]
    if not apart:
        return "none came", None
    by, seen = min(apart, key=lambda one: abs(one[0]))
    return f"{shown(index, seen)}, outside of it", by


# --- callback -------------------------------------------------------------------------------------


def callback(index: Index, expected: schema.Callback) -> Judged:
    """Whether the callback of this registration ran in the window, and with what."""
    since, until = window_start(index, expected.from_), resolve(index, expected.until)
    with_ = (f" with {expected.kind}" if expected.kind else "") + (
        f" and context {expected.context!r}" if expected.context is not None else ""
    )
    does = "runs" if expected.is_ == "some" else "never runs"
    wanted = f"the callback of {expected.callback} {does}{with_}{span(expected.from_, expected.until)}"
    acts = index.acts_of(expected.callback)
    if not acts:
        return not_made(index, expected.callback)._replace(wanted=wanted)
    session = acts[0].session or index.session_of(acts[0].entity)
    events = [seen for seen in index.events if seen.event.registration == expected.callback]
    judge = _runs if expected.is_ == "some" else _silent
    judged = judge(index, expected, events, acts, session, since, until)
    return unless_blind(index, session, judged._replace(wanted=wanted), since.lo, until.hi)


def _silent(
    index: Index, expected: schema.Callback, events: list[Seen], acts: list[Act], session: str,
    since: Interval, until: Interval,
) -> Judged:  # fmt: skip
    ran = [seen for seen in events if _fits(expected, seen)]
    certain = [seen for seen in ran if surely_between(seen.when, since, until)]
    doubtful = certain or [seen for seen in ran if maybe_between(seen.when, since, until)]
    if doubtful:
        got = shown(index, doubtful[0]) + ("" if certain else ", perhaps outside")
        return Judged(decide(bool(certain), True), "", got, at=doubtful[0].when.hi)
    if index.drives(session).surely() < max(since.hi, acts[0].end):
        return Judged("unclear", got=f"session {session} was not driven afterwards")
    return Judged("pass", got="it never ran")


def _runs(
    index: Index, expected: schema.Callback, events: list[Seen], acts: list[Act], session: str,
    since: Interval, until: Interval,
) -> Judged:  # fmt: skip
    wrong = [seen for seen in events if not _fits(expected, seen) and maybe_between(seen.when, since, until)]
    if wrong:
        first = next((seen for seen in wrong if surely_between(seen.when, since, until)), None)
        got = f"{shown(index, first or wrong[0])}, context {(first or wrong[0]).event.context!r}"
        return Judged(decide(first is not None, True), "", got, at=(first or wrong[0]).when.hi)
    # What comes exactly on a border counts here, as it does not where nothing may come: a tie is no one's fault.
    within = [seen for seen in events if since.lo <= seen.when.hi and seen.when.lo <= until.hi]
    certain = [seen for seen in within if since.hi <= seen.when.lo and seen.when.hi <= until.lo]
    if certain:
        return Judged("pass", got=shown(index, certain[0]), at=certain[0].when.hi)
    if within:
        got = f"{shown(index, within[0])}, perhaps outside"
        return Judged("unclear", got=got, at=within[0].when.hi)
    refused = [act.result for act in acts if isinstance(act.result, int) and act.result != 0]
    if len(refused) == len(acts) and index.whole:
        return Judged("fail", got=answered("register", refused[-1]))
    drives = index.drives(session)
    following = next((seen for seen in events if seen.when.lo >= until.hi), None)
    position, when = (following.position, following.when.lo) if following else (LAST, INF)
    needed = until.hi - index.late if expected.until.text == "end" else until.hi
    ended = drives.surely(position, when)
    got = f"{shown(index, following)}" if following else "it never ran"
    if ended < needed:
        return Judged("unclear", got=f"{got}, and session {session} was not driven until the end of the window")
    return Judged("fail", got=got, at=min(until.hi, ended), missing=True)


def _fits(expected: schema.Callback, seen: Seen) -> bool:
    event = seen.event
    return (expected.kind is None or kind_label(event.kind) == expected.kind) and (
        expected.context is None or event.context == expected.context
    )


# --- callbacks ------------------------------------------------------------------------------------


def callbacks(index: Index, expected: schema.Callbacks) -> Judged:
    """How many ran inside the calls of a label. At least is judged on them together, or on each."""
    bounds = [f"at least {expected.at_least}"] if expected.at_least is not None else []
    bounds += [f"at most {expected.at_most}"] if expected.at_most is not None else []
    what = " and ".join(expected.counting)
    wanted = (
        f"{' and '.join(bounds)} callbacks ({what}) in {'each call of ' if expected.each else ''}{expected.callbacks}"
    )
    placed = index.acts.get(expected.callbacks)
    if not placed:
        return not_made(index, expected.callbacks)._replace(wanted=wanted)
    numbers = [(_count(index, position, act, expected.counting), act) for position, act in placed]
    if not expected.each:
        numbers = [(sum(number for number, _ in numbers), placed[-1][1])]
    for number, act in numbers:
        if expected.at_most is not None and number > expected.at_most:
            return Judged("fail", wanted, f"{times(number)} {_where(index, expected, act)}", at=act.begin)
    for number, act in numbers:
        if expected.at_least is not None and number < expected.at_least:
            judged = Judged(
                decide(index.whole or expected.each, True), wanted,
                f"{times(number)} {_where(index, expected, act)}", at=act.begin, missing=True,
            )  # fmt: skip
            return unless_blind(index, act.session, judged, act.begin, act.end)
    judged = Judged("pass", wanted, times(max(number for number, _ in numbers)))
    return unless_blind(index, placed[0][1].session, judged, placed[0][1].begin, placed[-1][1].end)


def _count(index: Index, position: int, act: Act, counting: Sequence[str]) -> int:
    events, messages, spins = index.inside(position, act)
    taken = sum(message.callback for _, message in messages)
    number = len(events) * ("events" in counting) + taken * ("messages" in counting)
    # The spin counts callbacks that took nothing, too.
    return max(number, sum(spin.callbacks for spin in spins)) if len(counting) == 2 else number


def _where(index: Index, expected: schema.Callbacks, act: Act) -> str:
    if expected.each:
        return f"in {expected.callbacks}[{act.index}] {clock(index, act.begin)}"
    return f"in {expected.callbacks}"
