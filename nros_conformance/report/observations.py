"""What calls answered and what fired, taken from a trace."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, Literal

from nros_conformance.report.results import Case, Observation
from nros_conformance.rmw.events import KIND_BY_LABEL, EventKind
from nros_conformance.rmw.qos import is_finite
from nros_conformance.trace.records import WAITING_PING, Act, Event, FaultRecord, Registered, State, Trace

_SILENCING = {"stop": "start", "partition": "heal", "block": "heal", "delay": "heal", "freeze": "thaw", "crash": ""}
"""Faults after which the peer does not answer the session that they hit (``stop``: anybody), and what ends them."""


def observe(trace: Trace, *, pings: bool = True) -> list[Observation]:
    """The answers of register, supports, create, destroy and ping, in order of `tally`.

    Automatic registrations at creation count. A call that raised, or was not answered with a code, is
    no observation, nor is a ping that had no time to be answered in, or by which an ``until`` step asks again and
    again. ``pings``: False where the host did not do its part, so that a TIMEOUT may be its own.
    """
    entities = _entities(trace.header.scenario)
    gone: set[str] = set()
    silencing = {("stop", "")} if trace.header.scenario.get("peer") == "absent" else set()
    checked = {name for name, one in trace.header.scenario.get("sessions", {}).items() if "hard_liveliness" in one}
    living: set[str] = set()
    forgotten: set[str] = set()
    """Sessions that the peer may not know any more: neither answered nor silent."""
    seen: list[Observation] = []
    for record in trace.records:
        if isinstance(record, Registered):
            side = _side(entities, record.entity)
            case: Case = "right side" if _right(side, record.kind) else "wrong side"
            seen.append(Observation(call="supports", side=side, kind=record.kind, case=case, code=int(record.supports)))
            seen.append(Observation(call="register", side=side, kind=record.kind, case=case, code=record.code))
        elif isinstance(record, State):
            side = _side(entities, record.entity)
            call = "destroy" if record.what == "destroyed" else "create"
            seen.append(Observation(call=call, side=side, code=record.code))
            if record.what == "destroyed":
                gone.add(record.entity or record.session)
            if not record.entity:
                (living.add if record.what == "created" else living.discard)(record.session)
                forgotten.discard(record.session)
        elif isinstance(record, FaultRecord):
            if record.fault in _SILENCING:
                silencing.add((record.fault, record.of))
                forgotten |= living if record.fault == "stop" else checked & {record.of}
            silencing -= {one for one in silencing if _SILENCING[one[0]] == record.fault and one[1] == record.of}
        elif isinstance(record, Act) and not record.raised and isinstance(record.result, int):
            if record.op in ("register", "supports"):
                side, kind = _side(entities, record.entity), _kind(record.args.get("kind"))
                if kind is None:
                    continue
                destroyed = record.entity in gone or record.session in gone
                case = "destroyed" if destroyed else _case(record, side, kind, entities)
                seen.append(Observation(call=record.op, side=side, kind=kind, case=case, code=int(record.result)))
            elif record.op == "ping" and pings and _once(record):
                silent = any(of in ("", record.session) for _, of in silencing)
                if silent or record.session not in forgotten:
                    case = "silent" if silent else "reachable"
                    seen.append(Observation(call="ping", side="session", case=case, code=int(record.result)))
    return list(tally(seen))


def tally(observations: Iterable[Observation]) -> tuple[Observation, ...]:
    """Equal observations added up, in a fixed order."""
    counts: Counter[tuple[str, Literal["publisher", "subscription", "session"], int | None, Case, int]] = Counter()
    for one in observations:
        counts[(one.call, one.side, one.kind, one.case, one.code)] += one.count
    ordered = sorted(counts.items(), key=lambda item: (*item[0][:2], str(item[0][2]), *item[0][3:]))
    return tuple(
        Observation(call=call, side=side, kind=kind, case=case, code=code, count=count)
        for (call, side, kind, case, code), count in ordered
    )


def fired(trace: Trace) -> dict[int, int]:
    """Number of callbacks by the kind argument that they came with."""
    counts = Counter(record.kind for record in trace.records if isinstance(record, Event))
    return dict(sorted(counts.items()))


def _entities(scenario: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    found: dict[str, Mapping[str, Any]] = dict(scenario.get("entities", {}))
    return found


def _section(entities: Mapping[str, Mapping[str, Any]], entity: str) -> Mapping[str, Any]:
    """``name[2]`` is one of the entities of the section ``name``."""
    return entities.get(entity.partition("[")[0], {})


def _side(
    entities: Mapping[str, Mapping[str, Any]], entity: str
) -> Literal["publisher", "subscription", "session"]:  # fmt: skip
    section = _section(entities, entity)
    if "publisher" in section:
        return "publisher"
    return "subscription" if "subscription" in section else "session"


def _kind(kind: Any) -> int | None:
    if isinstance(kind, str):
        return int(KIND_BY_LABEL[kind]) if kind in KIND_BY_LABEL else None
    return int(kind) if isinstance(kind, int) else None


def _right(side: str, kind: int) -> bool:
    return kind in tuple(EventKind) and EventKind(kind).side.value == side


def _once(ping: Act) -> bool:
    """Whether it was asked for its answer, and had time to be answered in."""
    return ping.args.get("timeout_ms") != 0 and not ping.label.endswith(WAITING_PING)


def _case(act: Act, side: str, kind: int, entities: Mapping[str, Mapping[str, Any]]) -> Case:
    if kind not in tuple(EventKind):
        return "unknown kind"
    if not _right(side, kind):
        return "wrong side"
    if act.op == "register" and act.args.get("callback", "given") in ("none", None, False):
        return "no callback"
    deadline_ms = act.args.get("deadline_ms")
    if (
        act.op == "register"
        and EventKind(kind).is_deadline
        and isinstance(deadline_ms, int)
        and not is_finite(deadline_ms)
    ):
        stated = _section(entities, act.entity).get("qos", {}).get("deadline")
        if stated in (None, 0, "0", "infinite"):
            return "no deadline"
    return "right side"
