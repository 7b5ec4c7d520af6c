"""A trace as lines: every kind of record, in order of time, with the remark where the judge saw it."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from nros_conformance.report.timeline import Row, render, timeline
from nros_conformance.rmw.clock import MS
from nros_conformance.trace.records import (
    Act,
    AnyRecord,
    Blind,
    Changed,
    Cycles,
    End,
    Event,
    FaultRecord,
    Header,
    Matched,
    Measure,
    Message,
    Registered,
    Spin,
    Starved,
    State,
    Trace,
)
from tests.report.build import LVC, MSL, RDM, finding

HEADER = Header(scenario={}, suite="demo", backend="demo", clock="real", quantities={"T": 130 * MS}, start=1_000 * MS)


def shown(*records: AnyRecord) -> list[tuple[str, str]]:
    return [(row.who, row.what) for row in timeline(Trace(header=HEADER, records=records))]


def act(op: str, result: object = 0, at: int = 0, end: int = 0, session: str = "", entity: str = "", raised: str = "",
        **args: object) -> Act:  # fmt: skip
    return Act(
        label="#1", op=op, session=session, entity=entity, args=args, due=at, begin=at, end=end or at, result=result,
        raised=raised,
    )  # fmt: skip


def event(kind: int, *, inside: bool = True, **status: int) -> Event:
    return Event(
        registration="r", kind=kind, entity="listener", session="s", thread=1, driver=1, inside_drive=inside, t=5,
        status=status,
    )  # fmt: skip


@pytest.mark.parametrize(("record", "who", "what"), [
    (act("publish", entity="talker", sequence=3), "talker", "publish_raw #3: OK"),
    (act("take", 2, entity="listener"), "listener", "try_recv_raw: 2 samples"),
    (act("take", -2, entity="listener"), "listener", "try_recv_raw: TIMEOUT"),
    (act("supports", True, entity="listener", kind=int(MSL)), "listener", "supports_event MessageLost: true"),
    (act("register", -5, entity="listener", kind=int(RDM)), "listener",
     "register RequestedDeadlineMissed: UNSUPPORTED"),
    (act("destroy", None, session="main"), "main", "destroy: done"),
    (act("destroy", None), "#1", "destroy: done"),
    (act("publish", entity="talker", raised="OSError: no route"), "talker", "OSError: no route"),
    (act("drive", end=3 * MS), "#1", "driven, nothing else is called, until 3.0 ms later"),
    (act("idle", end=3 * MS), "#1", "nobody calls drive_io, until 3.0 ms later"),
    (event(int(RDM), total_count=7, total_count_change=7), "listener", "RequestedDeadlineMissed total 7 (+7)"),
    (
        event(int(LVC), inside=False, alive_count=1, alive_count_change=-1, not_alive_count=1,
              not_alive_count_change=1),
        "listener", "LivelinessChanged alive 1 (-1), not alive 1 (+1), outside of drive_io",
    ),
    (Message(session="s", entity="listener", t=5, publisher="talker", sequence=2, size=8), "listener",
     "takes talker #2, 8 bytes"),
    (Message(session="s", entity="listener", t=5, publisher="", sequence=0, size=8), "listener",
     "takes a foreign sample, 8 bytes"),
    (Registered(registration="r", entity="listener", session="s", kind=int(MSL), supports=False, code=-5, begin=1,
                end=2), "listener", "register MessageLost: UNSUPPORTED (not supported)"),
    (State(entity="talker", session="s", what="refused", code=-5, detail="no lease", begin=1, end=2), "talker",
     "refused UNSUPPORTED: no lease"),
    (State(entity="", session="s", what="created", begin=1, end=2), "session s", "created"),
    (Matched(publisher="p", subscription="q", begin=0, end=2 * MS, how="adapter"), "p, q", "matched after 2.0 ms"),
    (Matched(publisher="p", subscription="q", begin=0, end=2, how="timeout"), "p, q",
     "not matched within the discovery bound"),
    (Matched(publisher="p", subscription="q", begin=0, end=2, how="bound"), "p, q",
     "given the discovery bound to match"),
    (FaultRecord(label="f", fault="freeze", of="child", begin=1, end=2), "child", "fault freeze"),
    (FaultRecord(label="f", fault="stop", begin=1, end=2), "peer", "fault stop"),
    (Changed(session="s", before="AGENT_CONNECTED", state="WAITING_AGENT", reason="gone", t=5), "session s",
     "WAITING_AGENT: gone"),
    (Blind(session="s", begin=0, end=4 * MS), "s", "nothing could be observed for 4.0 ms"),
    (Starved(begin=0, end=9, wait=40 * MS), "host", "a thread has waited for a core, 40.0 ms"),
    (Starved(begin=0, end=9, wait=40 * MS, session="far"), "far", "a thread has waited for a core, 40.0 ms"),
    (Cycles(label="#3", times=40, begin=0, end=9 * MS), "#3", "40 cycles, until 9.0 ms later"),
    (Measure(label="m", what="cpu", value=2.5e6, begin=0, end=1), "m", "measured cpu: 2.5 ms"),
    (Measure(label="m", what="threads", value=3, begin=0, end=1), "m", "measured threads: 3"),
    (End(t=5, outcome="done", detail=""), "end", "done"),
    (Spin(session="s", begin=0, end=9, sure=9, calls=4, code=-18), "s", "drive_io answers CONNECTION_FAILED, 4 times"),
])  # fmt: skip
def test_a_record_is_one_line(record: AnyRecord, who: str, what: str) -> None:
    assert shown(record) == [(who, what)]


@pytest.mark.parametrize(("op", "args", "call"), [
    ("drive", {"timeout_ms": 20}, "drive_io(20)"), ("spin", {"timeout_ms": 20, "cap": 2}, "spin(20, 2)"),
])  # fmt: skip
def test_a_call_that_waits_has_a_begin_and_an_end(op: str, args: dict[str, Any], call: str) -> None:
    assert timeline(Trace(header=HEADER, records=(act(op, at=1, end=9, session="s", **args),))) == [
        Row(1, "s", f"{call} begins"), Row(9, "s", f"{call} returns OK"),
    ]  # fmt: skip


def test_quiet_calls_are_left_out_and_the_spin_of_an_explicit_call_is_not_told_twice() -> None:
    call = act("drive", -2, at=1, end=9, session="s", timeout_ms=20)
    own = Spin(session="s", begin=1, end=9, sure=9, code=-2)
    quiet = Spin(session="s", begin=10, end=90, sure=90, calls=40)
    assert [what for _, what in shown(call, own, quiet)] == ["drive_io(20) begins", "drive_io(20) returns TIMEOUT"]


def test_rows_are_in_order_of_time_and_a_finding_marks_the_nearest() -> None:
    trace = Trace(header=HEADER, records=(End(t=90, outcome="done"), event(int(MSL), total_count=1)))
    late = msgspec.structs.replace(finding("MSL-001", outcome="fail"), at=7)
    unclear = msgspec.structs.replace(finding("MSL-001", outcome="unclear"), at=1_000)
    held = finding("MSL-002")
    assert [(row.t, row.remark) for row in timeline(trace, [late, unclear, held])] == [
        (5, "<- fails here"), (90, "<- unclear here"),
    ]  # fmt: skip
    assert timeline(Trace(header=HEADER, records=()), [late]) == []


def test_columns_are_as_wide_as_their_contents() -> None:
    rows = [Row(1_000 * MS, "a", "x"), Row(1_130 * MS, "listener", "takes talker #2, 8 bytes", "<- fails here")]
    assert render(rows, 1_000 * MS) == [
        "        0.0  a         x",
        "      130.0  listener  takes talker #2, 8 bytes  <- fails here",
    ]
    assert render([], 0) == []


def test_waits_for_a_core_stand_together_and_carry_no_remark() -> None:
    waits = [Starved(begin=at * MS, end=(at + 1) * MS, wait=at * MS) for at in (10, 30, 20)]
    publish = act("publish", entity="talker", at=5 * MS, sequence=1)
    rows = timeline(
        Trace(header=HEADER, records=(publish, *waits, End(outcome="done", t=90 * MS))),
        [msgspec.structs.replace(finding("RDM-001", outcome="fail"), at=31 * MS)],
    )
    assert [(row.who, row.what, row.remark) for row in rows] == [
        ("talker", "publish_raw #1: OK", "<- fails here"),
        ("host", "threads have waited for a core, 30.0 ms at the longest, until 20.0 ms later", ""),
        ("end", "done", ""),
    ]
