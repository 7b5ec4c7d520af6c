"""Plays scripts on the reference in virtual time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nros_backends.reference import ReferenceBackend
from nros_conformance.play.plan import Plan
from nros_conformance.play.player import play_virtually
from nros_conformance.rmw.backend import Backend
from nros_conformance.rmw.clock import MS
from nros_conformance.trace.records import Act, End, Header

T = 100 * MS
PAIR = {"talker": {"publisher": "t"}, "listener": {"subscription": "t", "registration_deadline": "1T"}}
MISSED = {"never": "RequestedDeadlineMissed", "of": "listener", "proves": "RDM-001"}
"""An expectation that has the deadline registered."""


def play(
    script: Sequence[Any], entities: dict[str, Any] | None = None, *, adapter: type[Backend] = ReferenceBackend,
    outcome: str = "done", **fields: Any,
) -> list[Any]:  # fmt: skip
    """The records without the header; the play has to end like this."""
    scenario = {
        "id": "x.y", "title": "t", "entities": entities or PAIR, "script": list(script),
        "expect": fields.pop("expect", [MISSED]), **fields,
    }  # fmt: skip
    quantities = {"T": T, "tolerance": 0, "early": 0, "discovery_bound": 10 * MS}
    header = Header(scenario=scenario, suite="x", backend="reference", clock="virtual", quantities=quantities, start=0)
    plan = Plan(key="x.y", adapter="", header=header, trace="")
    records: list[Any] = play_virtually(plan, adapter)[1:]
    end = records[-1]
    assert isinstance(end, End)
    assert end.outcome == outcome, end
    return records


def acts(records: Sequence[Any], label: str) -> list[Act]:
    """The actions of a label."""
    return [record for record in records if isinstance(record, Act) and record.label == label]


def of(records: Sequence[Any], kind: type[Any]) -> list[Any]:
    """The records of a type."""
    return [record for record in records if isinstance(record, kind)]
