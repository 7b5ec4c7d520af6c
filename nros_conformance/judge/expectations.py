"""One expectation or condition of a scenario, named and judged."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from nros_conformance.judge import callbacks, calls, cycles, data, events, givens, levels
from nros_conformance.judge.findings import Judged, no_core
from nros_conformance.judge.index import Index
from nros_conformance.judge.intervals import worst
from nros_conformance.judge.moments import NoSuchMoment
from nros_conformance.judge.results import Outcome
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.suite import schema
from nros_conformance.trace.records import Act, Cycles

_Of: TypeAlias = str | list[str]
_Entry: TypeAlias = tuple[Callable[[Any], str], Callable[[Index, Any], Judged]]


def _names(of: _Of) -> str:
    return of if isinstance(of, str) else ", ".join(of)


JUDGES: dict[type[schema.Base], _Entry] = {
    schema.Never: (lambda one: f"never {_names(one.never)} of {_names(one.of)}", events.never),
    schema.Periodic: (lambda one: f"periodic {one.periodic} of {one.of}", events.periodic),
    schema.Total: (lambda one: f"total {one.total} of {one.of}", events.total),
    schema.Level: (lambda one: f"level {one.level} of {_names(one.of)}", levels.level),
    schema.Returns: (lambda one: f"returns {one.returns}", calls.returns),
    schema.Agrees: (lambda one: f"agrees {one.agrees} with {one.with_}", calls.agrees),
    schema.Received: (lambda one: f"received {one.received} of {one.of}", data.received),
    schema.Conserved: (lambda one: f"conserved {one.conserved}", data.conserved),
    schema.Inside: (lambda one: f"inside {one.inside} {one.event} of {one.of}", callbacks.inside),
    schema.Callback: (lambda one: f"callback {one.callback} {one.is_}", callbacks.callback),
    schema.Callbacks: (lambda one: f"callbacks {one.callbacks}", callbacks.callbacks),
    schema.Takes: (lambda one: f"takes {one.takes}", calls.takes),
    schema.AnyOf: (lambda one: f"any of {len(one.any_of)} groups", lambda index, one: _any_of(index, one)),
    schema.Admitted: (lambda one: f"admitted {one.admitted}", calls.admitted),
    schema.Measured: (lambda one: f"measured {one.measured} from {one.from_} to {one.to}", calls.measured),
    schema.Counted: (lambda one: f"counted {one.counted}", calls.counted),
    schema.Cycles: (
        lambda one: f"each cycle of {one.cycles}: {one.step or one.sampled or f'{one.event} of {one.of}'}",
        cycles.cycles,
    ),
    schema.GapGiven: (lambda one: f"given gap {_names(one.gap)}", givens.gap),
    schema.ReceivedGiven: (lambda one: f"given received {one.received} of {one.of}", data.received),
    schema.ReturnsGiven: (lambda one: f"given returns {one.returns}", givens.returns),
    schema.DrivenGiven: (lambda one: f"given driven {one.driven}", givens.driven),
}
"""How each of them is named, and who judges it."""


def name_of(part: schema.Base) -> str:
    """How the suite states it: ``periodic RequestedDeadlineMissed of listener``."""
    return JUDGES[type(part)][0](part)


TIMED = (
    schema.Never, schema.Periodic, schema.Total, schema.Level, schema.Inside, schema.Callback, schema.Callbacks,
    schema.Takes, schema.Received,
)  # fmt: skip
"""What a host that runs the backend's own threads late can violate."""

OF_THE_PEER = frozenset({"listed", "checks", "probes"})
"""Quantities that depend on what has come to the peer by then, unlike those of the process."""

ARRIVAL = frozenset({"take", "has_data", "ping", "until"})
"""Steps whose answer says whether something has come by then, unless it is an error."""


def judge_part(index: Index, part: schema.Base) -> Judged:
    """An expectation or condition; ``none`` when one of its moments did not occur in a whole trace."""
    try:
        judged = JUDGES[type(part)][1](index, part)
    except NoSuchMoment as missing:
        return Judged("none", got=str(missing))
    if isinstance(part, schema.Cycles) and (played := _now_and_then(index, part)) is not None:
        return _unless_starved(index, judged, played.begin, played.end)
    return _unless_starved(index, judged) if isinstance(part, TIMED) or _arrival(index, part) else judged


def _now_and_then(index: Index, part: schema.Cycles) -> Cycles | None:
    """The cycles, when enough came within some of them, as a backend does that was only late in the others."""
    played = index.cycles.get(part.cycles)
    if played is None or part.step is not None:
        return None
    return played if cycles.amount(played, part)[1] >= part.at_least else None


def _arrival(index: Index, part: schema.Base) -> bool:
    """Whether the part expects an answer or a number that depends on what has come by then."""
    if isinstance(part, schema.Counted):
        return any(one.label == part.counted and one.what in OF_THE_PEER for one in index.measures)
    if isinstance(part, schema.Returns):
        acts = index.acts_of(part.returns)
    elif isinstance(part, schema.Cycles) and part.step is not None and part.cycles in index.cycles:
        acts = index.cycles[part.cycles].calls.get(part.step, [])
    else:
        return False
    wrong = [act for act in acts if not calls.fits(act, part.is_)]
    return bool(wrong) and all(_tells_arrival(act) for act in wrong)


def _tells_arrival(act: Act) -> bool:
    if act.op in ("create", "destroy"):
        return bool(act.result == ReturnCode.TIMEOUT)  # the peer's answer has not come
    came = isinstance(act.result, int) and (act.result >= 0 or act.result in (ReturnCode.NO_DATA, ReturnCode.TIMEOUT))
    return act.op in ARRIVAL and came


def _unless_starved(index: Index, judged: Judged, since: int | None = None, until: int | None = None) -> Judged:
    """Unclear instead of failed, when threads of the backend had no core for longer than what is judged exactly.

    Within the T before the failure, or from ``since`` to ``until``.
    """
    if judged.outcome != "fail" or judged.at is None:
        return judged
    until = judged.at if until is None else until
    waited = index.starvation(until - index.quantities["T"] - index.late if since is None else since, until)
    if waited <= index.early:
        return judged
    return judged._replace(outcome="unclear", got=f"{judged.got}; {no_core(waited)}")


def _any_of(index: Index, expected: schema.AnyOf) -> Judged:
    """One group has to hold as a whole; expectations without evidence leave it to the others of their group."""
    groups: list[tuple[Outcome, str, str]] = []
    for group in expected.any_of:
        judged = [(one, judge_part(index, one)) for one in group]
        outcome = worst(found.outcome for _, found in judged)
        deciding = next((pair for pair in judged if pair[1].outcome == outcome), None)
        wanted = " and ".join(found.wanted or name_of(one) for one, found in judged)
        groups.append((outcome, wanted, deciding[1].got if deciding else ""))
    outcomes = [outcome for outcome, _, _ in groups]
    wanted = ", or ".join(wanted for _, wanted, _ in groups)
    for best in ("pass", "unclear", "fail"):
        if best in outcomes:
            chosen = [got for outcome, _, got in groups if outcome == best]
            return Judged(outcomes[outcomes.index(best)], wanted, "; ".join(chosen))
    return Judged("none", wanted, "; ".join(got for _, _, got in groups))
