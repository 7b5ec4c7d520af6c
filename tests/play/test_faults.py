"""Faults and measures as the player injects and records them."""

from __future__ import annotations

from typing import Any

import pytest

from nros_backends.reference import ReferenceBackend
from nros_conformance.play.plan import Plan
from nros_conformance.play.player import play as play_on
from nros_conformance.rmw.backend import Session
from nros_conformance.rmw.clock import MS, MonotonicClock
from nros_conformance.trace.records import AnyRecord, Event, FaultRecord, Header, Measure, Message
from tests.play.scripts import PAIR, acts, of, play

LOSSES = [{"total": "MessageLost", "of": "listener", "at_least": 0, "proves": "MSL-001"}]


def test_lost_samples_are_published_under_the_label_of_the_fault_and_do_not_arrive() -> None:
    script = [
        "settle",
        {"do": "publish", "by": "talker", "as": "head"},
        {"fault": "lose", "of": "talker", "count": 3, "as": "hole"},
        {"do": "publish", "by": "talker", "as": "tail"},
        {"drive": "1T"},
        {"do": "take", "from": "listener"},
    ]
    records = play(script, expect=LOSSES)
    assert [(act.op, act.index, act.args["sequence"]) for act in acts(records, "hole")] == [
        ("publish", 0, 2), ("publish", 1, 3), ("publish", 2, 4),
    ]  # fmt: skip
    (fault,) = of(records, FaultRecord)
    assert (fault.label, fault.fault, fault.of, fault.detail) == ("hole", "lose", "talker", {"code": 0})
    assert fault.begin <= acts(records, "hole")[0].begin <= acts(records, "hole")[-1].end <= fault.end
    assert [message.label for message in of(records, Message)] == ["head", "tail"]
    assert [event.status for event in of(records, Event)] == [{"total_count": 3, "total_count_change": 3}]


def test_a_preset_total_is_counted_on_from() -> None:
    script = [
        "settle",
        {"fault": "preset", "of": "listener", "kind": "MessageLost", "count": 2**32 - 3},
        {"do": "publish", "by": "talker", "times": 12},
        {"drive": "1T"},
    ]
    entities = {"talker": PAIR["talker"], "listener": {"subscription": "t", "qos": {"depth": 4}}}
    statuses = [event.status for event in of(play(script, entities, expect=LOSSES), Event)]
    assert statuses[-1]["total_count"] == 2**32 - 1
    assert sum(status["total_count_change"] for status in statuses) == 8


class _Recorder(ReferenceBackend):
    """Writes down what it is asked to inject, and refuses."""

    asked: list[tuple[str, dict[str, Any]]]

    def inject(self, fault: str, **arguments: Any) -> int:
        type(self).asked.append((fault, arguments))
        return -5


@pytest.mark.parametrize(("step", "keys"), [
    ({"fault": "partition", "of": "pub"}, {"session"}),
    ({"fault": "block", "of": "pub", "direction": "in"}, {"session", "direction"}),
    ({"fault": "heal", "of": "pub"}, {"session"}),
    ({"fault": "stall", "of": "pub"}, {"session"}),
    ({"fault": "bus_off", "of": "pub"}, {"session"}),
    ({"fault": "delay", "of": "pub", "by": "3T"}, {"session", "by_ns"}),
    ({"fault": "inject", "of": "pub", "count": 5}, {"session", "count", "seed"}),
    ({"fault": "duplicate", "of": "talker", "count": 2}, {"entity", "count", "publish"}),
    ({"fault": "reorder", "of": "talker", "count": 2}, {"entity", "count", "publish"}),
    ({"fault": "preset", "of": "talker", "count": 7}, {"entity", "count", "kind"}),
])  # fmt: skip
def test_the_backend_is_told_whom_the_fault_hits_and_its_refusal_ends_the_play(
    step: dict[str, Any], keys: set[str]
) -> None:
    _Recorder.asked = []
    records = play([step], adapter=_Recorder, outcome="raised")
    (fault,) = of(records, FaultRecord)
    ((name, arguments),) = _Recorder.asked
    assert (name, set(arguments)) == (step["fault"], keys)
    assert "session" not in keys or isinstance(arguments["session"], Session)
    assert fault.detail == {"code": -5}
    assert records[-1].detail == f"inject({step['fault']}) answered UNSUPPORTED, though backend.toml declares the fault"


def test_a_fault_that_nobody_can_inject_ends_the_play() -> None:
    end = play([{"fault": "overflow", "of": "pub"}], outcome="error")[-1]
    assert end.detail == "the fault overflow cannot be injected yet"


def test_processor_time_grows_with_what_the_process_computes() -> None:
    scenario = {
        "id": "x.y", "title": "t", "entities": PAIR, "needs": {"process": "own", "clock": "real"},
        "script": [{"do": "measure", "what": "cpu", "as": "before"}, {"do": "measure", "what": "cpu", "as": "after"}],
        "expect": [{"measured": "cpu", "from": "before", "to": "after", "at_most": "1T", "proves": "DSP-006"}],
    }  # fmt: skip
    quantities = {"T": 100 * MS, "tolerance": 30 * MS, "early": 5 * MS, "discovery_bound": 10 * MS}
    header = Header(scenario=scenario, suite="x", backend="reference", clock="real", quantities=quantities, start=0)
    records: list[Header | AnyRecord] = []
    play_on(Plan(key="x.y", adapter="", header=header, trace=""), ReferenceBackend, MonotonicClock(), records.append)
    before, after = of(records, Measure)
    assert (before.label, before.what, after.label) == ("before", "cpu", "after")
    assert 0 < before.value <= after.value
    assert before.begin <= before.end <= after.begin
