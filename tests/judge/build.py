"""Traces for tests, in milliseconds since the start of the play; T is 100 ms, late 30 ms, early 5 ms."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from nros_conformance.judge.judge import judge
from nros_conformance.judge.results import Finding, Verdict
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.events import KIND_BY_LABEL, EventKind
from nros_conformance.trace.records import (
    Act,
    AnyRecord,
    End,
    Event,
    FaultRecord,
    Header,
    Matched,
    Message,
    Registered,
    Spin,
    State,
    Trace,
)

START = 50_000 * MS
QUANTITIES = {"T": 100 * MS, "tolerance": 30 * MS, "early": 5 * MS, "discovery_bound": 200 * MS}
TALKER: Mapping[str, Any] = {"publisher": "sensor"}
LISTENER: Mapping[str, Any] = {"subscription": "sensor"}
ENTITIES = {"talker": TALKER, "listener": LISTENER}
RDM = "RequestedDeadlineMissed"


def ms(when: float) -> int:
    """Nanoseconds on the clock of the trace."""
    return START + round(when * MS)


def act(
    label: str, begin: float, end: float | None = None, *, op: str = "publish", entity: str = "talker",
    session: str = "pub", index: int = 0, result: Any = 0, raised: str = "", wait: float = 0, **args: Any,
) -> Act:  # fmt: skip
    end = begin if end is None else end
    return Act(
        label=label, index=index, op=op, session=session, entity=entity, args=args, due=ms(begin), begin=ms(begin),
        end=ms(end), result=result, raised=raised, wait=round(wait * MS),
    )  # fmt: skip


def step(label: str, begin: float, end: float, op: str = "drive") -> Act:
    """A step that lets time pass."""
    return act(label, begin, end, op=op, entity="", session="", result=None)


def call(label: str, begin: float, end: float, *, index: int = 0, op: str = "drive", session: str = "sub") -> Act:
    """A drive_io that the script makes."""
    return act(label, begin, end, op=op, entity="", session=session, index=index)


def publish(label: str, *times: float, entity: str = "talker", first: int = 1, took: float = 0) -> list[Act]:
    return [
        act(label, at, at + took, entity=entity, index=index, sequence=first + index) for index, at in enumerate(times)
    ]


def register(label: str, at: float, kind: str | int = RDM, *, result: int = 0, entity: str = "listener") -> Act:
    number = int(KIND_BY_LABEL[kind]) if isinstance(kind, str) else kind
    session = "sub" if entity == "listener" else "pub"
    return act(label, at, op="register", entity=entity, session=session, result=result, kind=number, context=label)


def spin(
    begin: float, end: float, *, wait: float = 0, calls: int = 1, callbacks: int = 0, gap: float = 0,
    longest: float = 0, session: str = "sub", code: int = 0,
) -> Spin:  # fmt: skip
    return Spin(
        session=session, begin=ms(begin), end=ms(end), sure=ms(end - wait), calls=calls, callbacks=callbacks, code=code,
        gap=round(gap * MS), longest=round(longest * MS),
    )  # fmt: skip


def spins(begin: float, end: float, every: float = 10, session: str = "sub") -> list[Spin]:
    """Quiet calls one after the other."""
    count = round((end - begin) / every)
    return [spin(begin + every * n, begin + every * (n + 1), session=session) for n in range(count)]


def event(
    kind: str | int, t: float, status: dict[str, int], *, wait: float = 0, earlier: float = 0,
    entity: str = "listener", session: str = "sub", registration: str = "", context: str = "", inside: bool = True,
    thread: int = 1,
) -> Event:  # fmt: skip
    number = int(KIND_BY_LABEL[kind]) if isinstance(kind, str) else kind
    return Event(
        registration=registration or f"{entity}/{EventKind(number).label}", kind=number, entity=entity, session=session,
        context=context, thread=thread, driver=1, spin=1 if inside else -1, inside_drive=inside, t=ms(t),
        wait=round(wait * MS), earlier=round(earlier * MS), status=status,
    )  # fmt: skip


def counted(t: float, total: int, change: int = 1, *, kind: str = RDM, **more: Any) -> Event:
    return event(kind, t, {"total_count": total, "total_count_change": change}, **more)


def alive(t: float, count: int, change: int, lost: int = 0, lost_change: int = 0, **more: Any) -> Event:
    status = {
        "alive_count": count, "not_alive_count": lost,
        "alive_count_change": change, "not_alive_count_change": lost_change,
    }  # fmt: skip
    return event("LivelinessChanged", t, status, **more)


def taken(
    t: float, *sequences: int, label: str = "data", publisher: str = "talker", callback: bool = False
) -> list[Message]:
    return [
        Message(
            session="sub", entity="listener", t=ms(t), publisher=publisher, sequence=sequence, label=label, size=20,
            callback=callback,
        )
        for sequence in sequences
    ]  # fmt: skip


def take(label: str, at: float, result: int, *, limit: int | None = None) -> Act:
    return act(label, at, op="take", entity="listener", session="sub", result=result, max=limit)


def state(
    what: str, at: float, entity: str = "", *, session: str = "", code: int = 0, end: float | None = None
) -> State:
    session = session or ("sub" if entity == "listener" else "pub")
    return State(
        entity=entity, session=session, what=what, code=code, begin=ms(at), end=ms(at if end is None else end)
    )  # fmt: skip


def fault(label: str, at: float, what: str = "crash", of: str = "pub", end: float | None = None) -> FaultRecord:
    return FaultRecord(label=label, fault=what, of=of, begin=ms(at), end=ms(at if end is None else end))


def matched(begin: float, end: float, how: str = "adapter") -> Matched:
    return Matched(publisher="talker", subscription="listener", begin=ms(begin), end=ms(end), how=how)


def registered(kind: str, *, entity: str = "listener", code: int = 0) -> Registered:
    session = "sub" if entity == "listener" else "pub"
    return Registered(
        registration=f"{entity}/{kind}", entity=entity, session=session, kind=int(KIND_BY_LABEL[kind]),
        supports=code == 0, code=code, begin=ms(0), end=ms(0),
    )  # fmt: skip


ALL = [registered(kind) for kind in (RDM, "LivelinessChanged", "MessageLost")] + [
    registered(kind, entity="talker") for kind in ("LivelinessLost", "OfferedDeadlineMissed")
]
"""Every kind is registered, on the talker or the listener."""


def flat(records: Sequence[Any]) -> Iterator[AnyRecord]:
    """Lists of lists of records as one."""
    for part in records:
        if isinstance(part, Sequence):
            yield from flat(part)
        else:
            yield part


def trace(
    expect: Sequence[Mapping[str, Any]] | Mapping[str, Any], *records: AnyRecord | Sequence[Any],
    given: Sequence[Mapping[str, Any]] = (), entities: Mapping[str, Any] = ENTITIES, outcome: str | None = "done",
    detail: str = "", setup: Sequence[AnyRecord] = tuple(ALL), claims: Mapping[str, str] | None = None,
    levels: Mapping[str, str] | None = None, declares: Mapping[str, Any] | None = None,
    quantities: Mapping[str, int] = QUANTITIES, end: float = 5000, **scenario: Any,
) -> Trace:  # fmt: skip
    """``outcome`` None: without an end."""
    expected = [expect] if isinstance(expect, Mapping) else list(expect)
    raw = {
        "id": "test.one", "title": "One", "entities": dict(entities), "script": [], "given": list(given),
        "expect": [{"proves": "RDM-001", **one} for one in expected], **scenario,
    }  # fmt: skip
    header = Header(
        scenario=raw, suite="test", backend="test", clock="real", quantities=dict(quantities), start=START,
        claims=dict(claims or {}), levels=dict(levels or {}), declares=dict(declares or {}),
    )  # fmt: skip
    last = [] if outcome is None else [End(outcome=outcome, t=ms(end), detail=detail)]
    return Trace(header, (*setup, *flat(records), *last))


def verdict(*parts: Any, **more: Any) -> Verdict:
    return judge(trace(*parts, **more))


def finding(*parts: Any, **more: Any) -> Finding:
    """The one for the expectation."""
    return next(one for one in verdict(*parts, **more).findings if not one.implied and one.proves)


def implied(proves: str, *records: Any, **more: Any) -> Finding:
    """The one for an invariant."""
    expect = {"never": "ANY", "of": "ALL"}
    return next(one for one in verdict(expect, *records, **more).findings if one.implied and one.proves == (proves,))
