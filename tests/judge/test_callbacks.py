from __future__ import annotations

from typing import Any

import pytest

from tests.judge.build import (
    RDM,
    alive,
    call,
    counted,
    finding,
    publish,
    register,
    spin,
    spins,
    step,
    taken,
)

INSIDE = {"inside": "long", "event": RDM, "of": "listener"}
BEFORE = [spins(0, 50), publish("one", 50), spins(50, 100)]
REST = [spins(1100, 1200), step("rest", 0, 1200)]


def test_inside() -> None:
    found = finding(INSIDE, BEFORE, counted(151, 1), spin(100, 1100, callbacks=1), call("long", 100, 1100), REST)
    assert found.name == "inside long RequestedDeadlineMissed of listener"
    assert found.wanted == "RequestedDeadlineMissed on listener inside long"
    assert (found.outcome, found.got) == ("pass", "RequestedDeadlineMissed on listener: total 1 (+1) at 151.0 ms")


def test_one_call_too_late() -> None:
    late = [counted(1104.3, 7, 7), spin(1101, 1105, callbacks=1), call("next", 1101, 1105)]
    found = finding(INSIDE, BEFORE, spin(100, 1100), call("long", 100, 1100), late, REST)
    assert (found.outcome, found.got, found.nearest_ns) == (
        "fail",
        "RequestedDeadlineMissed on listener: total 7 (+7) at 1104.3 ms, outside of it",
        4_300_000,
    )


def test_on_the_virtual_clock_the_background_may_have_called_it_just_before() -> None:
    before = [spins(0, 90), counted(100, 1), spin(90, 100, callbacks=1)]
    found = finding(INSIDE, before, spin(100, 1100), call("long", 100, 1100), REST)
    assert (found.outcome, found.got) == (
        "fail",
        "RequestedDeadlineMissed on listener: total 1 (+1) at 100.0 ms, outside of it",
    )


def test_inside_counts_occurrences() -> None:
    records = [BEFORE, counted(1100, 7, 7), spin(100, 1100, callbacks=1), call("long", 100, 1100), REST]
    found = finding(INSIDE | {"at_least": 7}, records)
    assert (found.outcome, found.wanted) == ("pass", "RequestedDeadlineMissed on listener inside long 7 times")
    assert finding(INSIDE | {"at_least": 8}, records).outcome == "fail"


def test_inside_by_its_fields() -> None:
    expect = {"inside": "long", "event": "LivelinessChanged", "of": "listener", "status": {"alive_count": 2}}
    two = [alive(200, 2, 2), spin(100, 1100, callbacks=1), call("long", 100, 1100), REST]
    found = finding(expect, BEFORE, two)
    assert (found.outcome, found.wanted) == ("pass", "LivelinessChanged on listener inside long, alive_count 2")
    one = [alive(200, 1, 1), spin(100, 1100, callbacks=1), call("long", 100, 1100), REST]
    found = finding(expect, BEFORE, one)
    assert (found.outcome, found.got) == (
        "fail",
        "LivelinessChanged on listener: alive_count 1 (+1), not_alive_count 0 (+0) at 200.0 ms",
    )


def test_inside_nothing() -> None:
    found = finding(INSIDE, BEFORE, spin(100, 1100), call("long", 100, 1100), REST)
    assert (found.outcome, found.got) == ("fail", "none came")
    found = finding(INSIDE, BEFORE, REST)
    assert (found.outcome, found.got) == ("none", "there is no long in the trace")


def three_calls_at_once(*inside: Any) -> list[Any]:
    """On the virtual clock: three calls that take no time, what came in each of them."""
    return [
        part
        for number, came in enumerate(inside)
        for part in (came, spin(500, 500, callbacks=len(came)), call("back", 500, 500, index=number))
    ]


@pytest.mark.parametrize(
    ("expect", "outcome", "got"),
    [
        ({"each": True, "at_most": 2}, "pass", "2 callbacks"),
        ({"each": True, "at_most": 1}, "fail", "2 callbacks in back[1] at 500.0 ms"),
        ({"each": True, "at_least": 1}, "fail", "0 callbacks in back[2] at 500.0 ms"),
        ({"at_most": 3}, "pass", "3 callbacks"),
        ({"at_most": 2}, "fail", "3 callbacks in back"),
        ({"at_least": 3}, "pass", "3 callbacks"),
        ({"at_least": 4}, "fail", "3 callbacks in back"),
        ({"at_least": 4, "counting": ["events"]}, "fail", "2 callbacks in back"),
        ({"at_most": 0, "counting": ["messages"]}, "fail", "1 callback in back"),
    ],
)
def test_callbacks(expect: dict[str, Any], outcome: str, got: str) -> None:
    calls = three_calls_at_once([counted(500, 1)], [counted(500, 2), *taken(500, 1, callback=True)], [])
    found = finding({"callbacks": "back", **expect}, BEFORE, calls, step("rest", 500, 600))
    assert (found.outcome, found.got) == (outcome, got)


def test_callbacks_in_words() -> None:
    found = finding({"callbacks": "back", "each": True, "at_least": 1, "at_most": 2}, BEFORE)
    assert found.name == "callbacks back"
    assert found.wanted == "at least 1 and at most 2 callbacks (events and messages) in each call of back"
    assert (found.outcome, found.got) == ("none", "there is no back in the trace")


def test_callbacks_that_took_nothing_count() -> None:
    calls = [spin(500, 501, callbacks=3), call("back", 500, 501), step("rest", 501, 600)]
    assert finding({"callbacks": "back", "at_most": 2}, BEFORE, calls).got == "3 callbacks in back"


def test_a_call_within_a_call_hides_nothing_of_the_outer_one() -> None:
    inner = call("inner", 150, 160)
    outer = [counted(120, 1), inner, spin(100, 200, callbacks=1), call("long", 100, 200)]
    assert finding({"callbacks": "long", "at_least": 1, "counting": ["events"]}, BEFORE, outer, REST).outcome == "pass"
    assert finding({"callbacks": "inner", "at_most": 0}, BEFORE, outer, REST).outcome == "pass"


# --- callback -------------------------------------------------------------------------------------

NEVER = {"callback": "reg", "is": "never"}
SOME = {"callback": "reg", "is": "some"}
REG = register("reg", 10)
HERE = [REG, spins(10, 300), step("rest", 10, 300)]


def ran(t: float, **more: Any) -> Any:
    return counted(t, 1, registration="reg", context=more.pop("context", "reg"), **more)


def test_a_callback_that_never_runs() -> None:
    found = finding(NEVER, HERE)
    assert (found.name, found.wanted) == ("callback reg never", "the callback of reg never runs")
    assert (found.outcome, found.got) == ("pass", "it never ran")
    found = finding(NEVER, HERE, ran(100))
    assert (found.outcome, found.got) == ("fail", "RequestedDeadlineMissed on listener: total 1 (+1) at 100.0 ms")


def test_a_refused_callback_that_never_runs_is_what_was_wanted() -> None:
    refused = [register("reg", 10, 255, result=-4), HERE[1:]]
    assert finding(NEVER, refused).outcome == "pass"
    found = finding(SOME, refused)
    assert (found.outcome, found.got) == ("fail", "register answered INVALID_ARGUMENT (-4)")


def test_a_callback_that_has_to_run() -> None:
    found = finding(SOME | {"kind": RDM, "context": "reg"}, HERE, ran(100))
    assert found.wanted == "the callback of reg runs with RequestedDeadlineMissed and context 'reg'"
    assert (found.outcome, found.got) == ("pass", "RequestedDeadlineMissed on listener: total 1 (+1) at 100.0 ms")
    found = finding(SOME, HERE)
    assert (found.outcome, found.got) == ("fail", "it never ran")


@pytest.mark.parametrize(
    ("expect", "event", "got"),
    [
        (
            {"kind": "MessageLost"},
            ran(100),
            "RequestedDeadlineMissed on listener: total 1 (+1) at 100.0 ms, context 'reg'",
        ),
        (
            {"context": "mine"},
            ran(100, context="yours"),
            "RequestedDeadlineMissed on listener: total 1 (+1) at 100.0 ms, context 'yours'",
        ),
    ],
)
def test_with_something_else(expect: dict[str, Any], event: Any, got: str) -> None:
    found = finding(SOME | expect, HERE, event)
    assert (found.outcome, found.got) == ("fail", got)
    assert finding(NEVER | expect, HERE, event).outcome == "pass"


def test_at_the_end_of_the_script_a_session_may_have_been_driven_a_little_less_long() -> None:
    nearly = [REG, spins(10, 290), step("rest", 10, 300)]
    assert finding(SOME, nearly).outcome == "fail"
    assert finding(SOME, [REG, spins(10, 260), step("rest", 10, 300)]).outcome == "unclear"
    assert finding(SOME | {"until": "rest.end"}, nearly).outcome == "unclear"


WINDOW = {"from": "one", "until": "two"}
WORLD = [REG, spins(10, 100), publish("one", 100), publish("two", 200), step("rest", 10, 300)]


@pytest.mark.parametrize(
    ("event", "never", "some"),
    [
        (ran(150), "fail", "pass"),
        (ran(101, wait=5), "unclear", "unclear"),
        (ran(99), "pass", "fail"),
        (ran(201), "pass", "fail"),
        (ran(100), "pass", "pass"),  # a tie speaks for the backend
        (ran(200), "pass", "pass"),
    ],
)
def test_in_a_window(event: Any, never: str, some: str) -> None:
    after = (
        [spins(100, 200), spins(200, 220)] if event.t < 50_150_000_000 else [spins(100, 200), event, spins(200, 220)]
    )
    before = [event] if event.t < 50_150_000_000 else []
    assert finding(NEVER | WINDOW, WORLD, before, after).outcome == never
    assert finding(SOME | WINDOW, WORLD, before, after).outcome == some


def test_without_calls_it_is_unclear() -> None:
    only = [REG, step("rest", 10, 300)]
    assert finding(NEVER, only).got == "session sub was not driven afterwards"
    found = finding(SOME, only)
    assert (found.outcome, found.got) == (
        "unclear",
        "it never ran, and session sub was not driven until the end of the window",
    )


def test_a_registration_that_was_never_tried() -> None:
    assert finding(SOME, HERE[1:]).got == "there is no reg in the trace"
