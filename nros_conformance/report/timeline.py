"""A trace as rows of a vertical timeline: the few milliseconds that matter vanish in horizontal bars."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Iterator, Mapping

from nros_conformance.judge.results import Finding
from nros_conformance.rmw.codes import code_name
from nros_conformance.rmw.events import kind_label
from nros_conformance.trace.records import (
    Act,
    AnyRecord,
    Blind,
    Changed,
    Cycles,
    End,
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

_WAITED = "waited for a core"


@dataclasses.dataclass(frozen=True, slots=True)
class Row:
    """One line: when (ns of the trace's clock), who, what happened, and a remark."""

    t: int
    who: str
    what: str
    remark: str = ""


def timeline(trace: Trace, findings: Iterable[Finding] = ()) -> list[Row]:
    """The rows of a trace in order of time; findings with a moment leave their remark on the nearest row.

    Calls that waited in quiet drive_io loops are summed up: a row per stretch between other rows.
    """
    told = ((row, record) for record in _condensed(trace.records) for row in _rows(record))
    rows = list(_waits_together(sorted(told, key=lambda one: one[0].t)))
    for finding in findings:
        if finding.at is None or not rows:
            continue
        at = finding.at
        nearest = min(range(len(rows)), key=lambda index: (_WAITED in rows[index].what, abs(rows[index].t - at)))
        remark = {"fail": "<- fails here", "unclear": "<- unclear here"}.get(finding.outcome, "")
        rows[nearest] = dataclasses.replace(rows[nearest], remark=remark)
    return rows


def render(rows: Iterable[Row], origin: int, indent: str = "  ") -> list[str]:
    """Lines of text: milliseconds after ``origin``, who, what, remark."""
    rows = list(rows)
    width = max((len(row.who) for row in rows), default=0)
    what = min(max((len(row.what) for row in rows), default=0), 64)
    return [
        f"{indent}{(row.t - origin) / 1e6:9.1f}  {row.who:<{width}}  {row.what:<{what}}  {row.remark}".rstrip()
        for row in rows
    ]


def _condensed(records: Iterable[AnyRecord]) -> Iterator[AnyRecord]:
    """Without the explicit calls' own spins, and with runs of equal publishes left as they are."""
    calls = {record.end for record in records if isinstance(record, Act) and record.op in ("drive", "spin")}
    for record in records:
        if isinstance(record, Spin) and (record.callbacks or record.calls == 1) and record.end in calls:
            continue
        yield record


def _waits_together(told: Iterable[tuple[Row, AnyRecord]]) -> Iterator[Row]:
    """Waits for a core, one after the other, as one row: on a busy host there are ten a second."""
    for waits, group in itertools.groupby(told, key=lambda one: isinstance(one[1], Starved)):
        pairs = list(group)
        if not waits or len(pairs) == 1:
            yield from (row for row, _ in pairs)
            continue
        longest = max(record.wait for _, record in pairs if isinstance(record, Starved))
        first, last = pairs[0][0], pairs[-1][0]
        who = first.who if len({row.who for row, _ in pairs}) == 1 else "host"
        text = f"threads have {_WAITED}, {_ms(longest)} at the longest, until {_ms(last.t - first.t)} later"
        yield Row(first.t, who, text)


def _rows(record: AnyRecord) -> Iterator[Row]:
    match record:
        case Act(raised=raised) if raised:
            yield Row(record.begin, record.entity or record.session, raised)
        case Act(op="drive" | "idle" | "parallel", session=""):
            words = {"drive": "driven, nothing else is called", "idle": "nobody calls drive_io", "parallel": "branches"}
            yield Row(record.begin, record.label, f"{words[record.op]}, until {_ms(record.end - record.begin)} later")
        case Act(op="drive" | "spin"):
            yield Row(record.begin, record.session, f"{_call(record)} begins")
            yield Row(record.end, record.session, f"{_call(record)} returns {_answer(record)}")
        case Act():
            yield Row(
                record.begin, record.entity or record.session or record.label, f"{_call(record)}: {_answer(record)}"
            )
        case Event():
            place = "" if record.inside_drive else ", outside of drive_io"
            yield Row(record.t, record.entity, f"{kind_label(record.kind)} {_status(record.status)}{place}")
        case Message():
            sender = f"{record.publisher} #{record.sequence}" if record.publisher else "a foreign sample"
            yield Row(record.t, record.entity, f"takes {sender}, {record.size} bytes")
        case Registered():
            supports = "supported" if record.supports else "not supported"
            what = f"register {kind_label(record.kind)}: {code_name(record.code)} ({supports})"
            yield Row(record.begin, record.entity, what)
        case State():
            code = f" {code_name(record.code)}" if record.code else ""
            detail = f": {record.detail}" if record.detail else ""
            yield Row(record.begin, record.entity or f"session {record.session}", f"{record.what}{code}{detail}")
        case Matched():
            words = {"timeout": "not matched within the discovery bound", "bound": "given the discovery bound to match"}
            what = words.get(record.how, f"matched after {_ms(record.end - record.begin)}")
            yield Row(record.end, f"{record.publisher}, {record.subscription}", what)
        case FaultRecord():
            yield Row(record.begin, record.of or "peer", f"fault {record.fault}")
        case Changed():
            yield Row(record.t, f"session {record.session}", f"{record.state}: {record.reason}")
        case Blind():
            yield Row(record.begin, record.session, f"nothing could be observed for {_ms(record.end - record.begin)}")
        case Starved():
            yield Row(record.end, record.session or "host", f"a thread has {_WAITED}, {_ms(record.wait)}")
        case Cycles():
            yield Row(
                record.begin, record.label, f"{record.times} cycles, until {_ms(record.end - record.begin)} later"
            )
        case Measure():
            value = _ms(int(record.value)) if record.what == "cpu" else f"{record.value:g}"
            yield Row(record.end, record.label, f"measured {record.what}: {value}")
        case End():
            yield Row(record.t, "end", record.detail or record.outcome)
        case Spin(calls=calls) if record.code:
            yield Row(record.begin, record.session, f"drive_io answers {code_name(record.code)}, {calls} times")


def _call(act: Act) -> str:
    names = {"publish": "publish_raw", "take": "try_recv_raw", "register": "register", "supports": "supports_event"}
    name = names.get(act.op, act.op)
    if act.op in ("drive", "spin"):
        cap = "" if act.args.get("cap") is None else f", {act.args['cap']}"
        return f"{'drive_io' if act.op == 'drive' else 'spin'}({act.args.get('timeout_ms', 0)}{cap})"
    if "kind" in act.args:
        return f"{name} {kind_label(int(act.args['kind']))}"
    return f"{name} #{act.args['sequence']}" if "sequence" in act.args else name


def _answer(act: Act) -> str:
    result = act.result
    if isinstance(result, bool):
        return str(result).lower()
    if isinstance(result, int):
        return f"{result} sample{'' if result == 1 else 's'}" if act.op == "take" and result >= 0 else code_name(result)
    return "done"


def _status(status: Mapping[str, int]) -> str:
    if "total_count" in status:
        return f"total {status['total_count']} ({status.get('total_count_change', 0):+d})"
    alive = f"alive {status.get('alive_count', 0)} ({status.get('alive_count_change', 0):+d})"
    return f"{alive}, not alive {status.get('not_alive_count', 0)} ({status.get('not_alive_count_change', 0):+d})"


def _ms(ns: int) -> str:
    return f"{ns / 1e6:.1f} ms"
