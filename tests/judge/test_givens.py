from __future__ import annotations

from typing import Any

import pytest
from msgspec.structs import replace

from nros_conformance.judge.results import Finding
from tests.judge.build import RDM, act, call, counted, fault, publish, spin, spins, step, take, taken, verdict

EXPECT = {"never": RDM, "of": "listener"}
REST = step("rest", 0, 400)


def condition(given: dict[str, Any], *records: Any) -> Finding:
    return verdict(EXPECT, *records, spins(0, 20, session="pub"), REST, given=[given]).findings[0]


@pytest.mark.parametrize(
    ("given", "outcome", "got", "nearest"),
    [
        ({"gap": "data", "max": "40ms"}, "pass", "36 ms at most", None),
        ({"gap": "data", "max": "35ms"}, "unclear", "up to 36 ms between data[1] and data[2], at 76.0 ms", 1),
        ({"gap": "data", "min": "15ms"}, "pass", "36 ms at most", None),
        (
            {"gap": "data", "min": "19ms", "max": "1T"},
            "unclear",
            "down to 18 ms between data[0] and data[1], at 41.0 ms",
            -1,
        ),
        ({"gap": "nothing", "max": "1T"}, "unclear", "there is no nothing in the trace", None),
    ],
)
def test_gap(given: dict[str, Any], outcome: str, got: str, nearest: int | None) -> None:
    data = [
        act("data", begin, end, index=n) for n, (begin, end) in enumerate([(20, 22), (40, 41), (70, 76), (100, 100)])
    ]
    found = condition(given, data)
    assert (found.outcome, found.got) == (outcome, got)
    assert found.nearest_ns == (None if nearest is None else nearest * 1_000_000)


def test_a_single_action_has_no_gap() -> None:
    assert condition({"gap": "data", "max": "1ns"}, publish("data", 10)).outcome == "pass"


def test_returns() -> None:
    given = {"returns": "data", "is": ["OK"]}
    found = condition(given, publish("data", 10, 20))
    assert (found.name, found.wanted, found.outcome) == ("given returns data", "data answers OK", "pass")
    found = condition(given, publish("data", 10), act("data", 20, index=1, result=-2))
    assert (found.outcome, found.got) == ("unclear", "data[1] answered TIMEOUT (-2)")
    assert condition(given).got == "there is no data in the trace"


def test_the_order_of_actions_that_overlap_is_open() -> None:
    overlapping = [act("data", 10, 60, index=0), act("data", 20, 30, index=1)]
    assert condition({"gap": "data", "max": "0.5T"}, overlapping).outcome == "pass"
    found = condition({"gap": "data", "max": "0.45T"}, overlapping)
    assert (found.outcome, found.got) == ("unclear", "up to 50 ms between data[0] and data[1], at 60.0 ms")


def test_received() -> None:
    given = {"received": "data", "of": "listener"}
    found = condition(given, publish("data", 10), taken(30, 1))
    assert (found.name, found.outcome) == ("given received data of listener", "pass")
    assert found.wanted == "all samples of data, in order and once, on listener"
    missing = [publish("data", 10), spins(0, 100), take("last", 100, -10)]
    found = condition(given, missing)
    assert (found.outcome, found.got) == ("unclear", "0 of 1, sample 1 of talker is missing")
    assert verdict(EXPECT, missing, REST, given=[given]).verdict == "inconclusive"


def test_several_labels_together() -> None:
    found = condition({"gap": ["data", "more"], "max": "0.3T"}, publish("data", 10, 60), publish("more", 35, 80))
    assert (found.name, found.outcome) == ("given gap data, more", "pass")
    found = condition({"gap": ["data", "more"], "max": "0.2T"}, publish("data", 10, 60), publish("more", 35, 80))
    assert found.wanted == "at most 0.2T between consecutive data and more"
    assert (found.outcome, found.got) == ("unclear", "up to 25 ms between data[0] and more[0], at 35.0 ms")


DRIVEN = {"driven": "sub", "max": "0.3T"}


@pytest.mark.parametrize(
    ("calls", "more", "outcome", "got"),
    [
        ([spins(0, 390)], {}, "pass", "10 ms at most"),
        ([spins(0, 100), spins(140, 400)], {}, "unclear", "nobody in drive_io for up to 40 ms at 140.0 ms"),
        ([spins(0, 100), spins(140, 400)], {"from": "rest.begin + 150ms"}, "pass", "0 ms at most"),
        ([spins(0, 100), spins(140, 400)], {"until": "rest.begin + 110ms"}, "pass", "10 ms at most"),
        ([spins(0, 340)], {}, "unclear", "nobody in drive_io for up to 60 ms at 400.0 ms"),
        ([spin(0, 400, calls=9, gap=31)], {}, "unclear", "nobody in drive_io for up to 31 ms at 400.0 ms"),
        (
            [spin(0, 100, wait=25), spins(110, 400)],
            {},
            "unclear",
            "nobody in drive_io for up to 35 ms at 110.0 ms",
        ),
        ([spin(0, 400)], {}, "pass", "0 ms at most"),
        ([], {}, "unclear", "it was never driven"),
    ],
)
def test_driven(calls: list[Any], more: dict[str, str], outcome: str, got: str) -> None:
    found = condition(DRIVEN | more, calls)
    assert (found.outcome, found.got) == (outcome, got)


def test_driven_in_words() -> None:
    found = condition(DRIVEN | {"from": "rest", "until": "rest.end"}, spins(0, 400))
    assert found.name == "given driven sub"
    assert found.wanted == "session sub driven at least every 0.3T from rest until rest.end"


def test_a_condition_that_is_not_met_leaves_the_scenario_inconclusive() -> None:
    given = [{"gap": "data", "max": "0.9T"}]
    data = publish("data", 10, 150)
    result = verdict(EXPECT, data, counted(120, 1), spins(0, 400), REST, given=given)
    assert (result.verdict, result.reason) == (
        "inconclusive",
        "given gap data: up to 140 ms between data[0] and data[1], at 150.0 ms; "
        "wanted at most 0.9T between consecutive data",
    )
    expected = next(one for one in result.findings if one.proves and not one.implied)
    assert (expected.outcome, expected.got) == (
        "unclear",
        "the condition is not met: up to 140 ms between data[0] and data[1], at 150.0 ms",
    )


def test_but_a_violated_invariant_fails_it() -> None:
    given = [{"gap": "data", "max": "0.9T"}]
    data = publish("data", 10, 150)
    result = verdict(EXPECT, data, counted(120, 1, inside=False), spins(0, 400), REST, given=given)
    assert (result.verdict, result.reason) == (
        "fail",
        "DSP-001: RequestedDeadlineMissed on listener: total 1 (+1) at 120.0 ms, outside of drive_io",
    )


def test_a_condition_with_an_unknown_moment_is_not_met() -> None:
    result = verdict(EXPECT, spins(0, 400), REST, given=[DRIVEN | {"from": "nowhere"}])
    assert (result.verdict, result.reason) == (
        "inconclusive",
        "given driven sub: there is no nowhere in the trace",
    )


def test_a_fault_that_was_not_injected_is_a_condition_that_is_not_met() -> None:
    refused = replace(fault("hole", 10, "lose", "talker"), detail={"code": -5})
    result = verdict(EXPECT, refused, spins(0, 400), REST)
    assert (result.verdict, result.reason) == (
        "inconclusive",
        "given fault lose: hole answered UNSUPPORTED (-5); wanted lose is injected",
    )
    assert verdict(EXPECT, fault("hole", 10, "lose", "talker"), spins(0, 400), REST).verdict == "pass"


def test_a_drive_is_where_it_begins() -> None:
    records = [act("one", 10), call("first", 90, 200)]
    assert condition({"gap": ["one", "first"], "max": "85ms"}, records).outcome == "pass"
    found = condition({"gap": ["one", "first"], "max": "75ms"}, records)
    assert (found.outcome, found.got) == ("unclear", "up to 80 ms between one[0] and first[0], at 200.0 ms")


@pytest.mark.parametrize(
    ("calls", "got"),
    [
        ([(50, 50), (99, 150)], ""),
        ([(50, 50), (120, 120)], "it was over 20 ms before call[1] began"),
        ([(50, 110), (120, 120)], ""),  # the backend took its time
        ([(160, 160)], ""),  # after all that belongs together
    ],
)
def test_what_happens_beside_an_idling_has_to_begin_before_it_is_over(calls: list[tuple[int, int]], got: str) -> None:
    records = [step("together", 0, 155, op="parallel"), step("asleep", 0, 100, op="idle")]
    records += [call("call", begin, end, index=n) for n, (begin, end) in enumerate(calls)]
    findings = verdict(EXPECT, records, spins(0, 20, session="pub"), REST).findings
    assert [(one.outcome, one.got) for one in findings if one.name == "given idle"] == [("unclear", got)] * bool(got)
