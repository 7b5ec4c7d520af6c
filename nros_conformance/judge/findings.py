"""What judging one expectation gives, and the words it is told in."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from nros_conformance.formats.counts import many
from nros_conformance.judge.index import Index, Seen
from nros_conformance.judge.intervals import INF, worst
from nros_conformance.judge.results import Outcome
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import PUBLISHED_CODES, code_name
from nros_conformance.rmw.events import EventKind, kind_label


class Judged(NamedTuple):
    """An outcome with what was wanted and what came instead; `results.Finding` explains the fields."""

    outcome: Outcome
    wanted: str = ""
    got: str = ""
    nearest_ns: int | None = None
    at: int | None = None
    surplus: int | None = None
    missing: bool = False
    """It fails because something was not seen; where nothing could be seen it is unclear instead."""


def together(judged: Iterable[Judged]) -> Judged:
    """Of several entities: all have to hold, the worst one speaks."""
    found = list(judged)
    outcome = worst(one.outcome for one in found)
    return next((one for one in found if one.outcome == outcome), Judged("none", got="there is nothing to judge"))


def unless_blind(index: Index, session: str, judged: Judged, since: int = -INF, until: int = INF) -> Judged:
    """The same, but unclear when what decides it may have gone unseen."""
    decided_by_absence = judged.outcome == "pass" or (judged.outcome == "fail" and judged.missing)
    if decided_by_absence and index.blind(session, since, until):
        return judged._replace(outcome="unclear", got=f"nothing could be observed for a while; {judged.got}")
    return judged


def milliseconds(ns: int) -> str:
    """A duration for people: ``4.3 ms``, ``130 ms``."""
    text = f"{ns / MS:.1f}"
    if text in ("0.0", "-0.0") and ns:
        text = f"{ns / MS:.4f}".rstrip("0")
    return f"{text.removesuffix('.0')} ms"


def clock(index: Index, t: int) -> str:
    """A moment for people: since the start of the play, ``at 1004.7 ms``."""
    return f"at {(t - index.header.start) / MS:.1f} ms"


def miss(ns: int, *, perhaps: bool = False) -> str:
    """By how much something missed its time: ``4.3 ms too late``, ``perhaps 2 ms too early``."""
    word = "late" if ns >= 0 else "early"
    return f"{'perhaps ' if perhaps else ''}{milliseconds(abs(ns))} too {word}"


def code_words(code: int) -> str:
    """A return code for people: ``UNSUPPORTED (-5)``, ``unpublished code -77``."""
    return f"{code_name(code)} ({code})" if code in PUBLISHED_CODES else code_name(code)


def no_core(ns: int) -> str:
    """Why a verdict is left open: how long threads of the backend were kept waiting by the host."""
    return f"threads of the backend had to wait {milliseconds(ns)} for a core meanwhile"


def times(number: int) -> str:
    """``1 callback``, ``2 callbacks``."""
    return many(number, "callback")


def shown(index: Index, seen: Seen) -> str:
    """An event for people: ``RequestedDeadlineMissed on listener: total 7 (+7) at 1004.7 ms``."""
    event = seen.event
    status = event.status
    if event.kind == EventKind.LIVELINESS_CHANGED:
        parts = ", ".join(
            f"{name} {status.get(name)} ({status.get(f'{name}_change', 0):+d})"
            for name in ("alive_count", "not_alive_count")
        )
    else:
        parts = f"total {status.get('total_count')} ({status.get('total_count_change', 0):+d})"
    return f"{kind_label(event.kind)} on {event.entity}: {parts} {clock(index, event.t)}"
