"""What holds in every trace, whatever the scenario expects. Without evidence a finding is ``none``."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from nros_conformance.judge import presence
from nros_conformance.judge.findings import Judged, clock, shown, times
from nros_conformance.judge.index import CALLS, Index, Seen
from nros_conformance.judge.standing import answered, number
from nros_conformance.rmw.codes import PUBLISHED_CODES
from nros_conformance.rmw.events import EventKind, kind_label
from nros_conformance.trace.records import Act


class Invariant(NamedTuple):
    """A law, the requirement that it proves, and its judge."""

    name: str
    proves: str
    judge: Callable[[Index], Judged]


_NO_EVENT = Judged("none", got="no callback came")
_COUNTS = ("alive_count", "not_alive_count")


def _series(index: Index, *, liveliness: bool) -> Iterator[Sequence[Seen]]:
    """The events of one kind on one entity, from its creation to its destruction.

    Left out: entities whose counters the harness preset, and those with events that went unseen.
    """
    for (entity, kind), events in index.by_kind.items():
        if (kind == EventKind.LIVELINESS_CHANGED) is not liveliness or kind not in tuple(EventKind):
            continue
        if index.is_preset(entity) or index.blind(index.session_of(entity)):
            continue
        rest = list(events)
        for reborn in [place for place, state in index.states if state.entity == entity and state.what == "created"]:
            yield [seen for seen in rest if seen.position < reborn]
            rest = [seen for seen in rest if seen.position > reborn]
        yield rest


def _law(index: Index, *, liveliness: bool, wanted: str, broken: Callable[[Seen, Seen | None], str]) -> Judged:
    """Every event against the one before it; ``broken`` says what is wrong."""
    held = 0
    for series in _series(index, liveliness=liveliness):
        before: Seen | None = None
        for seen in series:
            wrong = broken(seen, before)
            if wrong:
                return Judged("fail", wanted, f"{shown(index, seen)}: {wrong}", at=seen.event.t)
            before = seen
            held += 1
    return Judged("pass", wanted, times(held)) if held else _NO_EVENT._replace(wanted=wanted)


def _monotonic(index: Index) -> Judged:
    def broken(seen: Seen, before: Seen | None) -> str:
        total = seen.event.status.get("total_count")
        if total is None:
            return "the payload has no total_count"
        if before is None:
            return "" if total == seen.change else "the first total is not its change"
        earlier = before.event.status.get("total_count", 0)
        return f"it was {earlier} before" if total < earlier else ""

    return _law(index, liveliness=False, wanted="totals start from zero and only grow", broken=broken)


def _sums(index: Index) -> Judged:
    def broken(seen: Seen, before: Seen | None) -> str:
        earlier = before.event.status.get("total_count", 0) if before else 0
        difference = seen.event.status.get("total_count", 0) - earlier
        return f"the total changed by {difference:+d}" if difference != seen.change else ""

    return _law(index, liveliness=False, wanted="each change is the difference of the totals", broken=broken)


def _changing(index: Index) -> Judged:
    wanted = "no callback in which every change is zero"
    for seen in index.events:
        changes = [value for name, value in seen.event.status.items() if name.endswith("_change")]
        if changes and not any(changes):
            return Judged("fail", wanted, shown(index, seen), at=seen.event.t)
    return Judged("pass", wanted, times(len(index.events))) if index.events else _NO_EVENT._replace(wanted=wanted)


def _differences(index: Index) -> Judged:
    def broken(seen: Seen, before: Seen | None) -> str:
        for name in _COUNTS:
            earlier = before.event.status.get(name, 0) if before else 0
            difference = seen.event.status.get(name, 0) - earlier
            if difference != seen.event.status.get(f"{name}_change", 0):
                return f"{name} changed by {difference:+d}"
        return ""

    return _law(index, liveliness=True, wanted="liveliness changes are differences of the counts", broken=broken)


def _inside_drive(index: Index) -> Judged:
    wanted = "callbacks only inside drive_io"
    judged = 0
    for seen in index.events:
        event = seen.event
        if index.header.declares.get(f"{kind_label(event.kind)}.dispatch") == "own_call":
            continue
        judged += 1
        if not event.inside_drive:
            during = _call_at(index, seen)
            got = shown(index, seen) + (f", inside {during}" if during else ", outside of drive_io")
            return Judged("fail", wanted, got, at=event.t)
    return Judged("pass", wanted, times(judged)) if judged else _NO_EVENT._replace(wanted=wanted)


def _call_at(index: Index, seen: Seen) -> str:
    """The call of the script that was in progress on that session."""
    for position, act in index.all_acts:
        if position > seen.position and act.session == seen.event.session and act.op not in CALLS:
            return f"{act.op} ({act.label})" if act.begin <= seen.event.t <= act.end else ""
    return ""


def _on_driver(index: Index) -> Judged:
    wanted = "callbacks on the thread that drives the session"
    for seen in index.events:
        if seen.event.thread != seen.event.driver:
            got = f"{shown(index, seen)}, on another thread"
            return Judged("fail", wanted, got, at=seen.event.t)
    return Judged("pass", wanted, times(len(index.events))) if index.events else _NO_EVENT._replace(wanted=wanted)


def _alone(index: Index) -> Judged:
    wanted = "callbacks of a session one after the other"
    for seen in index.events:
        if seen.event.nested:
            return Judged("fail", wanted, f"{shown(index, seen)}, inside another callback", at=seen.event.t)
    return Judged("pass", wanted, times(len(index.events))) if index.events else _NO_EVENT._replace(wanted=wanted)


def _silent_after_destroy(index: Index) -> Judged:
    wanted = "no callback after destroy has returned"
    doubt: Judged | None = None
    evidence = 0
    for place, state in index.states:
        if state.what != "destroyed" or state.code < 0:
            continue
        what = state.entity or f"session {state.session}"
        reborn = next(
            (at for at, other in index.states if at > place and other.what == "created"
             and (other.entity, other.session) == (state.entity, state.session)), index.length,
        )  # fmt: skip
        # Something has to happen afterwards that could have brought one. Clearing up is no test.
        watched = (state.session,) if state.entity else index.sessions()
        if state.end <= index.script_end.hi:
            evidence += any(spin.begin >= state.end for name in watched for spin in index.drives(name).spins[-1:])
        for seen in index.events:
            its_own = seen.event.entity == state.entity if state.entity else seen.event.session == state.session
            if not its_own or not place < seen.position < reborn or seen.when.hi < state.end:
                continue
            late = seen.event.t - state.end
            got = f"{shown(index, seen)}, after {what} was destroyed {clock(index, state.end)}"
            # What drive_io calls on the thread that destroyed it before comes later for certain.
            if seen.when.lo > state.end or seen.event.inside_drive:
                return Judged("fail", wanted, got, late, seen.event.t)
            doubt = doubt or Judged("unclear", wanted, got, late, seen.event.t)
    none = "none came" if evidence else "nothing was destroyed before the end"
    return doubt or Judged("pass" if evidence else "none", wanted, none)


class _Registration(NamedTuple):
    place: int
    kind: int | None
    begin: int
    accepted: bool
    context: str | None


def _registrations(index: Index) -> dict[tuple[str, str], _Registration]:
    """By label and entity; several under one label count from the first, and as accepted if one is."""
    known: dict[tuple[str, str], _Registration] = {}
    entries = [
        ((one.registration, one.entity), _Registration(place, one.kind, one.begin, one.code == 0, one.registration))
        for place, one in index.registered
    ]
    for place, act in index.all_acts:
        if act.op == "register":
            kind, context = number(act.args.get("kind")), act.args.get("context")
            entries.append(((act.label, act.entity), _Registration(place, kind, act.begin, act.result == 0, context)))
    for key, entry in entries:
        before = known.get(key)
        known[key] = before._replace(accepted=entry.accepted or before.accepted) if before else entry
    return known


def _as_registered(index: Index) -> Judged:
    wanted = "callbacks, kinds and contexts as they were registered"
    known = _registrations(index)
    doubt: Judged | None = None
    judged = 0
    for seen in index.events:
        event = seen.event
        entry = known.get((event.registration, event.entity))
        if entry is None:
            continue
        judged += 1
        wrong = ""
        if entry.kind is not None and event.kind != entry.kind:
            wrong = f"registered as {kind_label(entry.kind)}"
        elif not entry.accepted and index.whole:
            wrong = "registering it was refused"
        elif entry.context is not None and event.context not in ("", entry.context):
            wrong = f"context {event.context!r} instead of {entry.context!r}"
        elif seen.position < entry.place and seen.when.hi < entry.begin:
            wrong = f"before {event.registration} was registered {clock(index, entry.begin)}"
        elif seen.position < entry.place:
            # While the call was in progress, on the thread that made it.
            got = f"{shown(index, seen)}, perhaps before it was registered"
            doubt = doubt or Judged("unclear", wanted, got, at=event.t)
        if wrong:
            return Judged("fail", wanted, f"{shown(index, seen)}: {wrong}", at=event.t)
    if doubt is not None:
        return doubt
    return Judged("pass", wanted, times(judged)) if judged else _NO_EVENT._replace(wanted=wanted)


_ANSWER_ONLY = frozenset({"publish", "assert", "register", "create", "destroy", "ping", *CALLS})
"""Calls that answer 0 or a negative code, and never a positive number."""


def _codes(index: Index) -> Judged:
    wanted = "return codes from the published set"
    for _, act in index.all_acts:
        wrong = _wrong_answer(act)
        if wrong:
            which = f"{act.op} ({act.label}[{act.index}]) on {act.entity or act.session}"
            return Judged("fail", wanted, f"{which} {wrong}", at=act.begin)
    answers = len(index.all_acts)
    for call, code, at in _other_codes(index):
        answers += 1
        if code not in PUBLISHED_CODES:
            return Judged("fail", wanted, answered(call, code), at=at)
    return Judged("pass", wanted, f"{answers} answers") if answers else Judged("none", wanted, "no call was made")


def _wrong_answer(act: Act) -> str:
    if act.raised:
        return f"raised: {act.raised}"
    result = act.result
    if not isinstance(result, int) or isinstance(result, bool) or result in PUBLISHED_CODES:
        return ""
    if result < 0 or act.op in _ANSWER_ONLY:
        return answered("", result).strip()
    return ""


def _other_codes(index: Index) -> Iterator[tuple[str, int, int]]:
    for _, state in index.states:
        yield (
            f"{state.what.replace('destroyed', 'destroying')} {state.entity or state.session}",
            state.code,
            state.begin,
        )
    for _, one in index.registered:
        yield f"register {one.registration}", one.code, one.begin
    for session in index.sessions():
        for spin in index.drives(session).spins:
            yield f"drive_io of session {session}", spin.code, spin.begin


INVARIANTS = (
    Invariant("totals only grow, from zero", "CNT-001", _monotonic),
    Invariant("changes sum to totals", "CNT-002", _sums),
    Invariant("no callback without a change", "CNT-003", _changing),
    Invariant("liveliness changes are differences", "CNT-004", _differences),
    Invariant("liveliness counts are possible", "CNT-005", presence.possible),
    Invariant("callbacks only inside drive_io", "DSP-001", _inside_drive),
    Invariant("callbacks on the driving thread", "DSP-002", _on_driver),
    Invariant("no callback within another", "DSP-003", _alone),
    Invariant("silence after destroy", "DSP-004", _silent_after_destroy),
    Invariant("callbacks as registered", "REG-006", _as_registered),
    Invariant("published return codes", "ROB-003", _codes),
)
"""In the order of the requirements."""
