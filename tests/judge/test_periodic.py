from __future__ import annotations

from typing import Any

import pytest

from nros_conformance.trace.records import Starved
from tests.judge.build import act, counted, finding, ms, publish, spin, spins, step, verdict

EVERY = {"periodic": "RequestedDeadlineMissed", "of": "listener", "every": "1T", "since": "one", "until": "rest.end"}
ONE = publish("one", 0)
REST = step("rest", 0, 350)


def quiet(begin: float, end: float, longest: float = 10) -> Any:
    """One record of many calls."""
    return spin(begin, end, calls=round((end - begin) / 10), longest=longest, gap=0.1)


def test_one_per_period_passes() -> None:
    found = finding(
        EVERY, ONE, quiet(0, 100), counted(100.5, 1), spin(100, 101, callbacks=1),
        quiet(101, 200), counted(201, 2), spin(200, 201, callbacks=1),
        quiet(201, 300), counted(303.2, 3), spin(300, 304, callbacks=1), quiet(304, 350), REST,
    )  # fmt: skip
    assert found.name == "periodic RequestedDeadlineMissed of listener"
    assert found.wanted == "RequestedDeadlineMissed on listener every 1T since one until rest.end"
    assert (found.outcome, found.got) == (
        "pass",
        "all 3 came, the last: RequestedDeadlineMissed on listener: total 3 (+1) at 303.2 ms",
    )


LATE: list[tuple[str, list[Any], str, str, float | None]] = [
    (
        "a call returned without it",
        [spins(0, 140), counted(145, 1), spin(140, 145, callbacks=1)],
        "fail",
        "RequestedDeadlineMissed on listener: total 1 (+1) at 145.0 ms, 15 ms too late",
        15,
    ),
    (
        "it never came",
        [spins(0, 350)],
        "fail",
        "RequestedDeadlineMissed number 1 on listener had not come when drive_io returned at 340.0 ms, 210 ms too late",
        210,
    ),
    (
        "the second is missing",
        [spins(0, 100), counted(100, 1), spins(100, 350)],
        "fail",
        "RequestedDeadlineMissed number 2 on listener had not come when drive_io returned at 340.0 ms, 110 ms too late",
        110,
    ),
    (
        "nobody drove",
        [spins(0, 90)],
        "unclear",
        "session sub was not driven after RequestedDeadlineMissed number 1 on listener was due",
        None,
    ),
    (
        "the call that returned without it may have ended in time",
        [spin(0, 140, wait=20), counted(145, 1), spin(140, 145, callbacks=1), spin(145, 205)],
        "unclear",
        "RequestedDeadlineMissed on listener: total 1 (+1) at 145.0 ms, perhaps 15 ms too late",
        15,
    ),
    (
        "it may have come in time",
        [spins(0, 140), counted(145, 1, wait=20), spin(140, 145, callbacks=1), spin(145, 205)],
        "unclear",
        "RequestedDeadlineMissed on listener: total 1 (+1) at 145.0 ms, perhaps 15 ms too late",
        15,
    ),
    (
        "many calls in one record that goes on beyond the window",
        [quiet(0, 900)],
        "fail",
        "RequestedDeadlineMissed number 1 on listener had not come when drive_io returned at 339.9 ms, "
        "209.9 ms too late",
        209.9,
    ),
    (
        "many calls in one record, of unknown length",
        [quiet(0, 900, longest=0)],
        "unclear",
        "RequestedDeadlineMissed number 1 on listener had perhaps not come when drive_io returned at 350.0 ms, "
        "220 ms too late",
        220,
    ),
]


@pytest.mark.parametrize(
    ("records", "outcome", "got", "nearest"), [case[1:] for case in LATE], ids=[c[0] for c in LATE]
)
def test_late(records: list[Any], outcome: str, got: str, nearest: float | None) -> None:
    found = finding(EVERY, ONE, *records, REST)
    assert (found.outcome, found.got) == (outcome, got)
    assert found.nearest_ns == (nearest if nearest is None else round(nearest * 1e6))


def test_a_long_call_may_deliver_until_it_returns() -> None:
    found = finding(EVERY, ONE, counted(345, 3, 3), spin(0, 346, callbacks=1), REST)
    assert found.outcome == "pass"
    assert verdict(EVERY, ONE, counted(345, 3, 3), spin(0, 346, callbacks=1), REST).verdict == "pass"


def test_absences_need_no_rule_of_their_own() -> None:
    found = finding(
        EVERY,
        ONE,
        spins(0, 30),
        counted(240, 2, 2),
        spin(240, 241, callbacks=1),
        counted(342, 3),
        spin(340, 343, callbacks=1),
        REST,
    )
    assert found.outcome == "pass"


def test_an_event_recorded_before_the_quiet_calls_that_preceded_it_is_late() -> None:
    found = finding(EVERY, ONE, counted(145, 1), quiet(0, 140), spin(140, 145, callbacks=1), REST)
    assert (found.outcome, found.nearest_ns) == ("fail", 15_000_000)


EARLY: list[tuple[str, list[Any], str, str, float]] = [
    (
        "before the first period is over",
        [counted(90, 1)],
        "fail",
        "RequestedDeadlineMissed on listener: total 1 (+1) at 90.0 ms, 5 ms too early",
        -5,
    ),
    (
        "one too many",
        [counted(100, 1), counted(150, 2)],
        "fail",
        "RequestedDeadlineMissed on listener: total 2 (+1) at 150.0 ms, 45 ms too early",
        -45,
    ),
    (
        "two in one callback",
        [counted(110, 2, 2)],
        "fail",
        "RequestedDeadlineMissed on listener: total 2 (+2) at 110.0 ms, 85 ms too early",
        -85,
    ),
    (
        "it may have come still earlier",
        [counted(97, 1, wait=4)],
        "unclear",
        "RequestedDeadlineMissed on listener: total 1 (+1) at 97.0 ms, perhaps 2 ms too early",
        -2,
    ),
]


@pytest.mark.parametrize(
    ("events", "outcome", "got", "nearest"), [case[1:] for case in EARLY], ids=[c[0] for c in EARLY]
)
def test_early(events: list[Any], outcome: str, got: str, nearest: float) -> None:
    rest = [counted(205, 2), counted(305, 3)] if outcome == "unclear" else []
    found = finding(EVERY, ONE, events, rest, spins(310, 350), REST)
    assert (found.outcome, found.got) == (outcome, got)
    assert found.nearest_ns == round(nearest * 1e6)


def test_what_was_waited_before_another_callback_of_the_call_may_make_late_but_not_early() -> None:
    def judged(earlier: float) -> str:
        second = counted(196, 2, wait=12, earlier=earlier)
        return finding(EVERY, ONE, counted(110, 1, wait=11), second, counted(295, 3), spins(310, 350), REST).outcome

    assert judged(0) == "unclear"
    assert judged(10.5) == "unclear"
    assert judged(11) == "pass"
    assert finding(EVERY, ONE, spins(0, 140), counted(145, 1, wait=20, earlier=20), REST).outcome == "unclear"


def test_up_to_early_before_its_time_is_allowed() -> None:
    found = finding(EVERY, ONE, counted(95, 1), counted(195, 2), counted(295, 3), spins(310, 350), REST)
    assert found.outcome == "pass"


def test_events_before_since_do_not_count() -> None:
    after = [counted(700, 6), counted(801, 7), counted(902, 8), spins(910, 950)]
    found = finding(EVERY, counted(100, 3, 3), counted(300, 5, 2), publish("one", 600), after, step("rest", 600, 950))
    assert found.outcome == "pass"


def test_an_event_while_the_anchor_happens_leaves_it_open() -> None:
    since = act("one", 595, 605)
    after = [counted(701, 7), counted(802, 8), counted(903, 9), spins(910, 950)]
    found = finding(EVERY, counted(600, 6, 6), since, after, step("rest", 600, 950))
    assert (found.outcome, found.got) == (
        "unclear",
        "RequestedDeadlineMissed on listener: total 6 (+6) at 600.0 ms, perhaps 600 ms too early",
    )


def test_what_comes_after_the_window_is_not_judged() -> None:
    calls = [spins(0, 100), counted(100, 1), spins(100, 150)]
    narrow = EVERY | {"until": "rest.begin"}
    found = finding(narrow, ONE, calls, step("rest", 150, 400), counted(170, 2), counted(180, 3), spins(180, 800))
    assert found.outcome == "pass"


def test_a_window_shorter_than_a_period_proves_nothing() -> None:
    found = finding(EVERY, ONE, spins(0, 90), step("rest", 0, 90))
    assert (found.outcome, found.got) == ("none", "no period is over before the end of the window")


def test_on_the_virtual_clock_an_event_at_the_moment_it_was_due_is_in_time() -> None:
    exact = {"T": 100_000_000, "tolerance": 0, "early": 0}
    calls = [spins(0, 100), counted(100, 1), spins(100, 200), counted(200, 2), spins(200, 250)]
    assert finding(EVERY, ONE, calls, step("rest", 0, 250), quantities=exact).outcome == "pass"
    late = [spins(0, 100), counted(101, 1), spins(100, 250)]
    assert finding(EVERY, ONE, late, step("rest", 0, 250), quantities=exact).outcome == "fail"


def test_the_clearing_up_is_not_judged() -> None:
    always = EVERY | {"until": "end"}
    found = finding(always, ONE, spins(0, 100), counted(100, 1), spins(100, 150), step("rest", 0, 150), spins(150, 900))
    assert found.outcome == "pass"
    assert found.wanted == "RequestedDeadlineMissed on listener every 1T since one"


def test_an_entity_with_a_count_is_judged_one_by_one() -> None:
    crowd = {"talker": {"publisher": "sensor"}, "listener": {"subscription": "sensor", "count": 2}}
    both = [counted(100, 1, entity=f"listener[{n}]") for n in (0, 1)]
    codes = [act(f"r{n}", 0, op="register", entity=f"listener[{n}]", session="sub", kind=1) for n in (0, 1)]
    window = [spins(100, 150), step("rest", 0, 150)]
    assert finding(EVERY, ONE, codes, both, window, entities=crowd).outcome == "pass"
    found = finding(EVERY, ONE, codes, both[:1], window, entities=crowd)
    assert (found.outcome, found.got) == (
        "fail",
        "RequestedDeadlineMissed number 1 on listener[1] had not come when drive_io returned at 140.0 ms, "
        "10 ms too late",
    )


def test_a_backend_that_reads_only_in_drive_io_times_samples_there() -> None:
    declares = {"receives_only_in_drive_io": True}
    absent = [spin(0, 60), spins(60, 145), counted(165, 1), spin(145, 166, callbacks=1), spins(166, 206), REST]
    assert finding(EVERY, ONE, absent).outcome == "fail"
    assert finding(EVERY, ONE, absent, declares=declares).outcome == "unclear"
    late = [spin(0, 20), spins(20, 160), counted(165, 1), spin(160, 166, callbacks=1), spins(166, 206), REST]
    assert finding(EVERY, ONE, late, declares=declares).outcome == "fail"
    seldom = spin(0, 900, calls=90, longest=10, gap=0.1)
    assert finding(EVERY, ONE, seldom, REST, declares=declares).outcome == "fail"


def test_a_window_that_closes_at_an_uncertain_time_leaves_its_last_calls_open() -> None:
    until = EVERY | {"until": "two"}
    late = [spins(0, 140), act("two", 125, 145), spins(140, 200)]
    found = finding(until, ONE, late, REST)
    assert (found.outcome, found.nearest_ns) == ("unclear", 10_000_000)
    assert finding(until, ONE, spins(0, 140), act("two", 141, 145), REST).outcome == "fail"
    due = [counted(100, 1), counted(200, 2), spins(200, 230), act("two", 225, 235)]
    assert finding(until, ONE, due, REST).outcome == "pass"
    owed = [counted(100, 1), spins(100, 120), act("two", 225, 235), REST]
    assert finding(until, ONE, owed).got == (
        "session sub was not driven after RequestedDeadlineMissed number 2 on listener was due"
    )
    short = [spins(0, 125), act("two", 125, 135), REST]
    assert finding(until, ONE, short).got == "perhaps no period is over before the end of the window"


@pytest.mark.parametrize(("second", "outcome"), [(230, "unclear"), (80, "fail")])
def test_misses_of_gaps_that_the_harness_left_before_the_anchor_are_not_held_against_the_backend(
    second: float, outcome: str
) -> None:
    records = [
        spin(0, 10), publish("one", 0, second), counted(second + 10, 2, change=2),
        spin(second + 2, second + 15, callbacks=1), quiet(second + 15, 350),
    ]  # fmt: skip
    assert finding({**EVERY, "since": "one.last"}, *records, REST).outcome == outcome


@pytest.mark.parametrize(("wait", "at", "outcome"), [(50, 100, "unclear"), (4, 100, "fail"), (50, 250, "fail")])
def test_what_came_late_while_threads_of_the_backend_had_no_core_is_unclear(
    wait: float, at: float, outcome: str
) -> None:
    records = [spins(0, 140), counted(145, 1), spin(140, 145, callbacks=1), spins(145, 205)]
    starved = Starved(begin=ms(at), end=ms(at + 30), wait=ms(wait) - ms(0))
    found = finding({**EVERY, "until": "one + 2T"}, ONE, *records, starved, REST)
    assert found.outcome == outcome
    words = "threads of the backend had to wait 50 ms for a core meanwhile"
    assert (words in found.got) == (outcome == "unclear")
