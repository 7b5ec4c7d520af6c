from __future__ import annotations

from typing import Any

import pytest

from nros_conformance.trace.records import Blind
from tests.judge.build import (
    RDM,
    alive,
    call,
    counted,
    finding,
    ms,
    publish,
    registered,
    spin,
    spins,
    state,
    step,
    verdict,
)

NEVER = {"never": RDM, "of": "listener", "from": "one", "until": "two"}
ONE, TWO = publish("one", 100), publish("two", 200)
DRIVEN = spins(0, 300)


def test_never_passes_on_silence() -> None:
    found = finding(NEVER, ONE, TWO, DRIVEN)
    assert found.name == "never RequestedDeadlineMissed of listener"
    assert found.wanted == "no RequestedDeadlineMissed on listener from one until two"
    assert (found.outcome, found.got) == ("pass", "none came")


@pytest.mark.parametrize(
    ("t", "wait", "outcome", "nearest"),
    [
        (149.0, 0.0, "fail", 49.0),
        (101.0, 0.9, "fail", 1.0),
        (199.0, 10.0, "fail", -11.0),
        (101.0, 5.0, "unclear", 1.0),
        (204.0, 5.0, "unclear", -1.0),
        (100.0, 0.0, "pass", None),
        (200.0, 0.0, "pass", None),
        (200.0, 1.0, "unclear", -1.0),
        (99.0, 5.0, "pass", None),
        (210.0, 5.0, "pass", None),
    ],
)
def test_never_by_the_interval_of_the_event(t: float, wait: float, outcome: str, nearest: float | None) -> None:
    found = finding(NEVER, ONE, TWO, DRIVEN, counted(t, 1, wait=wait))
    assert found.outcome == outcome
    assert found.nearest_ns == (None if nearest is None else round(nearest * 1e6))


def test_never_tells_what_came() -> None:
    two = [counted(150, 1), counted(160, 3, 2)]
    assert finding(NEVER, ONE, TWO, DRIVEN, two).got == (
        "RequestedDeadlineMissed on listener: total 1 (+1) at 150.0 ms, and 1 more"
    )
    assert finding(NEVER, ONE, TWO, DRIVEN, counted(101, 1, wait=5)).got == (
        "RequestedDeadlineMissed on listener: total 1 (+1) at 101.0 ms, perhaps outside"
    )


def test_never_is_about_its_kind_and_entity() -> None:
    others = [alive(150, 1, 1), counted(150, 1, kind="OfferedDeadlineMissed", entity="talker", session="pub")]
    assert finding(NEVER, ONE, TWO, DRIVEN, others).outcome == "pass"
    found = finding({"never": ["MessageLost", "LivelinessChanged"], "of": "listener"}, DRIVEN, others)
    assert found.wanted == "no MessageLost, LivelinessChanged on listener"
    assert found.got == ("LivelinessChanged on listener: alive_count 1 (+1), not_alive_count 0 (+0) at 150.0 ms")


def test_never_any_of_all() -> None:
    always = {"never": "ANY", "of": "ALL"}
    rest = step("rest", 0, 300)
    assert finding(always, DRIVEN, spins(0, 300, session="pub"), rest).outcome == "pass"
    offered = counted(150, 1, kind="OfferedDeadlineMissed", entity="talker", session="pub")
    found = finding(always, DRIVEN, spins(0, 300, session="pub"), offered, rest)
    assert (found.outcome, found.wanted) == ("fail", "no event on talker")


def test_never_without_a_call_afterwards_is_unclear() -> None:
    found = finding(NEVER, ONE, TWO, spins(0, 90))
    assert (found.outcome, found.got) == ("unclear", "session sub was not driven afterwards")


def test_never_after_its_session_is_gone_needs_no_calls() -> None:
    gone = state("destroyed", 90, session="sub")
    assert finding(NEVER, spins(0, 90), gone, ONE, TWO).outcome == "pass"


@pytest.mark.parametrize(
    ("setup", "claims", "outcome", "got"),
    [
        ([registered(RDM, code=-5)], {}, "none", "register answered UNSUPPORTED (-5)"),
        ([], {}, "none", "RequestedDeadlineMissed is not registered on listener"),
        ([registered(RDM, code=-5)], {RDM: "no"}, "none", "RequestedDeadlineMissed is not claimed"),
        ([registered(RDM)], {RDM: "limited"}, "pass", "none came"),
        (
            [state("refused", 0, "listener", code=-6)],
            {},
            "none",
            "creating listener answered INCOMPATIBLE_QOS (-6)",
        ),
    ],
)
def test_silence_proves_nothing_without_a_registration(
    setup: list[Any], claims: dict[str, str], outcome: str, got: str
) -> None:
    found = finding(NEVER, ONE, TWO, DRIVEN, setup=setup, claims=claims)
    assert (found.outcome, found.got) == (outcome, got)


@pytest.mark.parametrize(
    "expect",
    [
        {"periodic": RDM, "of": "listener", "every": "1T", "since": "one"},
        {"total": RDM, "of": "listener", "at_least": 1},
        {"total": RDM, "of": "listener", "is": 1},
        {"inside": "call", "event": RDM, "of": "listener"},
    ],
    ids=["periodic", "total", "total is", "inside"],
)
def test_a_claimed_event_that_is_refused_fails_what_needs_it(expect: dict[str, Any]) -> None:
    found = finding(expect, ONE, DRIVEN, setup=[registered(RDM, code=-5)], claims={RDM: "yes"})
    assert (found.outcome, found.got) == ("fail", "register answered UNSUPPORTED (-5)")
    assert finding(expect, ONE, DRIVEN, setup=[registered(RDM, code=-5)], claims={RDM: "no"}).outcome == "none"


def test_a_refusal_on_record_may_be_followed_by_a_success() -> None:
    expect = {"total": RDM, "of": "listener", "at_least": 1}
    found = finding(expect, ONE, DRIVEN, setup=[registered(RDM, code=-4)], outcome=None)
    assert (found.outcome, found.got) == ("unclear", "RequestedDeadlineMissed is not yet registered on listener")
    both = [registered(RDM, code=-4), registered(RDM)]
    assert finding(expect, DRIVEN, counted(10, 1), setup=both).outcome == "pass"


def test_in_the_scenario_that_proves_absence_the_event_is_judged_all_the_same() -> None:
    more: dict[str, Any] = {"setup": [registered(RDM, code=-5)], "claims": {RDM: "no"}, "refusal": RDM}
    assert finding(NEVER, ONE, TWO, DRIVEN, **more).outcome == "pass"
    assert finding(NEVER, ONE, TWO, DRIVEN, counted(150, 1), **more).outcome == "fail"


def test_an_anchor_that_is_not_in_a_whole_trace_gives_no_evidence() -> None:
    found = finding(NEVER | {"until": "listener.MessageLost[1]"}, ONE, counted(9, 1, kind="MessageLost"), DRIVEN)
    assert (found.outcome, found.got) == ("none", "there is no listener.MessageLost[1] in the trace, only 1 of them")
    found = finding(NEVER, ONE, DRIVEN)
    assert (found.outcome, found.got) == ("none", "there is no two in the trace")


def test_what_nobody_could_see_is_unclear() -> None:
    blind = Blind(begin=ms(120), end=ms(130), session="sub")
    found = finding(NEVER, ONE, TWO, DRIVEN, blind)
    assert (found.outcome, found.got) == ("unclear", "nothing could be observed for a while; none came")
    assert finding(NEVER, ONE, TWO, DRIVEN, blind, counted(150, 1)).outcome == "fail"
    assert finding(NEVER, ONE, TWO, DRIVEN, Blind(begin=ms(250), end=ms(260))).outcome == "pass"
    assert finding(NEVER, ONE, TWO, DRIVEN, Blind(begin=ms(120), end=ms(130), session="pub")).outcome == "pass"


# --- total ----------------------------------------------------------------------------------------

TOTAL = {"total": RDM, "of": "listener", "at": "two"}
COME = [spins(0, 50), counted(50, 1), spin(50, 51, callbacks=1), counted(150, 3, 2), spin(60, 151, callbacks=1)]


@pytest.mark.parametrize(
    ("bounds", "wanted", "outcome", "got"),
    [
        ({"is": 3}, "total 3", "pass", "total 3"),
        ({"at_least": 3}, "total at least 3", "pass", "total 3"),
        ({"at_most": 3}, "total at most 3", "pass", "total 3"),
        ({"at_least": 1, "at_most": 5}, "total at least 1 and at most 5", "pass", "total 3"),
        ({"is": 2}, "total 2", "fail", "total 3; RequestedDeadlineMissed on listener: total 3 (+2) at 150.0 ms"),
        (
            {"at_most": 0},
            "total 0",
            "fail",
            "total 3; RequestedDeadlineMissed on listener: total 1 (+1) at 50.0 ms",
        ),
        ({"is": 4}, "total 4", "fail", "total 3"),
        ({"at_least": 4}, "total at least 4", "fail", "total 3"),
    ],
)
def test_total(bounds: dict[str, int], wanted: str, outcome: str, got: str) -> None:
    found = finding(TOTAL | bounds, COME, TWO, spins(190, 210))
    assert found.name == "total RequestedDeadlineMissed of listener"
    assert found.wanted == f"RequestedDeadlineMissed on listener: {wanted} at two"
    assert (found.outcome, found.got) == (outcome, got)


def test_total_too_small_needs_a_call_that_returned_after_the_moment() -> None:
    found = finding(TOTAL | {"is": 4}, COME, TWO)
    assert (found.outcome, found.got) == ("unclear", "total 3, and session sub was not driven afterwards")
    late = [counted(205, 4), spin(151, 206, callbacks=1)]
    found = finding(TOTAL | {"is": 4}, COME, TWO, late)
    assert (found.outcome, found.got, found.nearest_ns) == (
        "unclear",
        "total 3; RequestedDeadlineMissed on listener: total 4 (+1) at 205.0 ms, perhaps 5 ms too late",
        5_000_000,
    )
    found = finding(TOTAL | {"is": 4}, COME, TWO, spin(151, 201), late[:1], spin(201, 206, callbacks=1))
    assert (found.outcome, found.got) == (
        "fail",
        "total 3; RequestedDeadlineMissed on listener: total 4 (+1) at 205.0 ms, 5 ms too late",
    )


def test_total_at_the_end_of_a_call_that_the_script_made() -> None:
    expect = {"total": RDM, "of": "listener", "at": "back.end", "is": 4}
    later = [counted(205, 4), spin(201, 206, callbacks=1)]
    found = finding(expect, COME, spin(199, 200), call("back", 199, 200), later, step("rest", 200, 300))
    assert (found.outcome, found.nearest_ns) == ("fail", 5_000_000)


def test_the_last_of_calls_that_are_not_all_on_record_is_not_known() -> None:
    expect = {"total": RDM, "of": "listener", "at": "back.end", "is": 4}
    first = [COME, spin(199, 200), call("back", 199, 200)]
    assert finding(expect, first, outcome=None).outcome == "unclear"
    assert finding(expect, first, step("rest", 200, 300)).outcome == "fail"
    assert finding(expect | {"at": "back.first"}, first, outcome=None).outcome == "fail"


def test_changes_that_add_up_to_another_number_are_no_total() -> None:
    found = finding(TOTAL | {"is": 3}, spins(0, 50), counted(50, 1), counted(150, 3, 3), spins(150, 210), TWO)
    assert (found.outcome, found.got) == (
        "fail",
        "changes that add up to 4; RequestedDeadlineMissed on listener: total 3 (+3) at 150.0 ms",
    )


def test_total_at_the_end_of_the_script() -> None:
    expect = {"total": RDM, "of": "listener", "is": 4}
    rest = step("rest", 0, 200)
    assert finding(expect, COME, rest, spins(160, 190)).outcome == "fail"
    assert finding(expect, COME, rest).outcome == "unclear"
    assert finding(expect | {"is": 3}, COME, rest, counted(210, 4)).outcome == "pass"
    assert finding(expect, COME, rest).wanted == "RequestedDeadlineMissed on listener: total 4 at end"


def test_total_includes_what_comes_exactly_then() -> None:
    assert finding(TOTAL | {"is": 4}, COME, counted(200, 4), TWO).outcome == "pass"
    assert finding(TOTAL | {"is": 4}, COME, counted(200.5, 4, wait=1), TWO).outcome == "unclear"
    found = finding(TOTAL | {"is": 3}, COME, counted(200.5, 4, wait=1), TWO)
    assert (found.outcome, found.got) == (
        "unclear",
        "total 3 to 4; RequestedDeadlineMissed on listener: total 4 (+1) at 200.5 ms",
    )


def test_no_total_of_a_session_that_nobody_drove() -> None:
    found = finding(TOTAL | {"is": 0}, TWO)
    assert (found.outcome, found.got) == ("unclear", "session sub was never driven")


def test_the_verdict_tells_the_first_failure() -> None:
    result = verdict(NEVER | {"proves": ["RDM-002", "RDM-005"]}, ONE, TWO, DRIVEN, counted(150, 1))
    assert (result.verdict, result.reason) == (
        "fail",
        "RDM-002, RDM-005: RequestedDeadlineMissed on listener: total 1 (+1) at 150.0 ms",
    )
