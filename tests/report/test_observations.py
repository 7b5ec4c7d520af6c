from __future__ import annotations

from typing import Any

import pytest

from nros_conformance.report.observations import fired, observe, tally
from nros_conformance.report.results import Observation
from nros_conformance.trace.records import Act, AnyRecord, Event, FaultRecord, Header, Registered, State, Trace
from tests.report.build import registered

SCENARIO = {
    "id": "reg.demo",
    "entities": {
        "talker": {"publisher": "sensor"},
        "listener": {"subscription": "sensor", "qos": {"deadline": "1T"}},
        "plain": {"subscription": "sensor"},
        "crowd": {"publisher": "sensor", "count": 3},
    },
}


def trace(*records: AnyRecord) -> Trace:
    header = Header(scenario=SCENARIO, suite="registration", backend="demo", clock="real", quantities={}, start=0)
    return Trace(header, records)


def act(
    op: str, entity: str, result: Any, session: str = "sub", raised: str = "", label: str = "a", **args: Any
) -> Act:
    return Act(label=label, op=op, session=session, entity=entity, args=args, due=0, begin=0, end=1, result=result,
               raised=raised)  # fmt: skip


def destroyed(entity: str, session: str = "sub") -> State:
    return State(entity=entity, session=session, what="destroyed", begin=0, end=1)


def cases(*records: AnyRecord) -> list[tuple[str, str, int | None, str, int]]:
    return [(one.call, one.side, one.kind, one.case, one.code) for one in observe(trace(*records))]


@pytest.mark.parametrize(
    ("record", "expected"),
    [
        (act("register", "listener", 0, kind="LivelinessChanged"), ("register", "subscription", 0, "right side", 0)),
        (act("register", "crowd[2]", -5, kind=4), ("register", "publisher", 4, "right side", -5)),
        (act("register", "talker", -5, kind=0), ("register", "publisher", 0, "wrong side", -5)),
        (act("register", "listener", -5, kind=-1), ("register", "subscription", -1, "unknown kind", -5)),
        (act("register", "talker", -4, kind=255), ("register", "publisher", 255, "unknown kind", -4)),
        (
            act("register", "listener", -4, kind=1, callback="none"),
            ("register", "subscription", 1, "no callback", -4),
        ),
        (
            act("register", "plain", -6, kind=1, deadline_ms=0),
            ("register", "subscription", 1, "no deadline", -6),
        ),
        (
            act("register", "plain", 0, kind=1, deadline_ms=20),
            ("register", "subscription", 1, "right side", 0),
        ),
        (
            act("register", "listener", 0, kind=1, deadline_ms=0),
            ("register", "subscription", 1, "right side", 0),
        ),
        (act("supports", "listener", True, kind=2), ("supports", "subscription", 2, "right side", 1)),
        (act("supports", "talker", False, kind=3), ("supports", "publisher", 3, "right side", 0)),
    ],
)
def test_a_call_is_filed_under_its_case(record: Act, expected: tuple[object, ...]) -> None:
    assert cases(record) == [expected]


def test_a_registration_at_creation_is_an_answer_and_a_promise() -> None:
    record = Registered(
        registration="talker/LivelinessLost", entity="talker", session="pub", kind=3, supports=True, code=-5, begin=0,
        end=1,
    )  # fmt: skip
    assert cases(record) == [
        ("register", "publisher", 3, "right side", -5),
        ("supports", "publisher", 3, "right side", 1),
    ]


@pytest.mark.parametrize("gone", [destroyed("listener"), destroyed("", "sub")])
def test_a_destroyed_entity_is_a_case_of_its_own(gone: State) -> None:
    found = cases(gone, act("register", "listener", -4, kind=0))
    assert ("register", "subscription", 0, "destroyed", -4) in found


def test_creation_and_destruction_are_observed_per_side() -> None:
    refused = State(entity="talker", session="pub", what="refused", code=-6, begin=0, end=1)
    session = State(entity="", session="pub", what="created", begin=0, end=1)
    assert cases(refused, session, destroyed("listener")) == [
        ("create", "publisher", None, "", -6),
        ("create", "session", None, "", 0),
        ("destroy", "subscription", None, "", 0),
    ]


def test_a_ping_is_silent_while_a_fault_silences_the_peer() -> None:
    stop = FaultRecord(label="s", fault="stop", begin=0, end=1)
    start = FaultRecord(label="s", fault="start", begin=2, end=3)
    found = cases(act("ping", "", 0), stop, act("ping", "", -2), start, act("ping", "", 0))
    assert found == [("ping", "session", None, "reachable", 0), ("ping", "session", None, "silent", -2)]


def created(session: str) -> State:
    return State(entity="", session=session, what="created", begin=0, end=1)


def test_a_session_that_a_restarted_peer_has_forgotten_is_neither_answered_nor_silent() -> None:
    stop = FaultRecord(label="s", fault="stop", begin=0, end=1)
    start = FaultRecord(label="s", fault="start", begin=2, end=3)
    found = cases(created("sub"), stop, start, act("ping", "", -2), created("sub"), act("ping", "", 0))
    assert [one for one in found if one[0] == "ping"] == [("ping", "session", None, "reachable", 0)]


def test_a_broken_link_silences_the_peer_for_its_own_session() -> None:
    cut = FaultRecord(label="s", fault="partition", of="sub", begin=0, end=1)
    found = cases(cut, act("ping", "", -2), act("ping", "", 0, session="pub"))
    assert found == [("ping", "session", None, "reachable", 0), ("ping", "session", None, "silent", -2)]


def test_a_ping_without_time_is_no_observation() -> None:
    stop = FaultRecord(label="s", fault="stop", begin=0, end=1)
    found = cases(
        act("ping", "", -2, timeout_ms=0), act("ping", "", 0, timeout_ms=130), stop, act("ping", "", -2, timeout_ms=0)
    )
    assert found == [("ping", "session", None, "reachable", 0)]


def test_a_ping_of_who_waits_for_an_answer_is_no_observation() -> None:
    found = cases(act("ping", "", -2, label="back/ping"), act("ping", "", 0, label="back/ping"), act("ping", "", 0))
    assert found == [("ping", "session", None, "reachable", 0)]


def test_pings_of_a_play_that_the_host_disturbed_are_left_out_and_nothing_else_is() -> None:
    disturbed = trace(act("ping", "", -2, timeout_ms=130), act("register", "listener", -4, kind=1))
    assert [one.call for one in observe(disturbed)] == ["ping", "register"]
    assert [one.call for one in observe(disturbed, pings=False)] == ["register"]


def test_what_raised_or_answered_no_code_is_no_observation() -> None:
    raised = act("register", "listener", 0, kind=0, raised="KeyError")
    odd = act("register", "listener", "odd", kind=0)
    assert cases(raised, odd, act("register", "listener", 0), act("publish", "talker", 0)) == []


def test_equal_observations_add_up_in_any_order() -> None:
    ones = [registered(1, -5), registered(0), registered(1, -5)]
    assert tally(ones) == tally(reversed(ones))
    assert {(one.kind, one.code): one.count for one in tally(ones)} == {(0, 0): 1, (1, -5): 2}
    assert tally([*tally(ones), *tally(ones)])[1] == Observation(
        call="register", side="subscription", kind=1, case="right side", code=-5, count=4
    )


def test_callbacks_are_counted_by_the_kind_they_came_with() -> None:
    def event(kind: int) -> Event:
        return Event(registration="r", kind=kind, entity="listener", session="sub", thread=1, driver=1,
                     inside_drive=True, t=1, status={"total_count": 3, "total_count_change": 3})  # fmt: skip

    assert fired(trace(event(1), event(7), event(1))) == {1: 2, 7: 1}
