from __future__ import annotations

from typing import Any

import pytest

from nros_conformance.trace.records import Blind
from tests.judge.build import act, alive, finding, ms, registered, spin, spins, state, step

BY = {"level": "alive_count", "of": "listener", "is": 0, "by": "gone + 200ms"}
GONE = act("gone", 100, 101, op="destroy")
REST = step("rest", 101, 400)
HERE = [spins(0, 50), alive(50, 1, 1), spin(50, 51, callbacks=1), spins(60, 100)]


def left(at: float, wait: float = 0) -> list[Any]:
    return [alive(at, 0, -1, wait=wait), spin(at - 1, at + 1, callbacks=1)]


LEFT = "LivelinessChanged on listener: alive_count 0 (-1), not_alive_count 0 (+0)"
CAME = "LivelinessChanged on listener: alive_count 1 (+1), not_alive_count 0 (+0)"


def test_reached_in_time() -> None:
    found = finding(BY, HERE, GONE, spins(100, 200), left(205), spins(210, 400), REST)
    assert found.name == "level alive_count of listener"
    assert found.wanted == "alive_count 0 on listener by gone + 200ms"
    assert (found.outcome, found.got) == ("pass", f"{LEFT} at 205.0 ms")


CASES: list[tuple[str, list[Any], str, str, float | None]] = [
    (
        "calls returned without it",
        [spins(100, 340), left(350), spins(360, 400)],
        "fail",
        f"{LEFT} at 350.0 ms, 19 ms too late",
        19,
    ),
    ("within late", [spins(100, 320), left(330), spins(340, 400)], "pass", f"{LEFT} at 330.0 ms", None),
    ("nobody drove before", [spins(100, 300), left(390)], "pass", f"{LEFT} at 390.0 ms", None),
    ("never", [spins(100, 400)], "fail", f"{CAME} at 50.0 ms, and drive_io returned at 400.0 ms", 69),
    (
        "never, but calls did not return late enough",
        [spins(100, 330)],
        "unclear",
        f"{CAME} at 50.0 ms, but the script ended before it was late",
        None,
    ),
    (
        "perhaps in time",
        [spins(100, 340), left(350, wait=40), spins(360, 400)],
        "unclear",
        f"{LEFT} at 350.0 ms, perhaps 19 ms too late",
        19,
    ),
    (
        "the call before it may have ended early",
        [spins(100, 300), spin(300, 340, wait=20), left(350), spins(360, 400)],
        "unclear",
        f"{LEFT} at 350.0 ms, perhaps 19 ms too late",
        19,
    ),
]


@pytest.mark.parametrize(("records", "outcome", "got", "nearest"), [c[1:] for c in CASES], ids=[c[0] for c in CASES])
def test_by(records: list[Any], outcome: str, got: str, nearest: float | None) -> None:
    found = finding(BY, HERE, GONE, records, REST)
    assert (found.outcome, found.got) == (outcome, got)
    assert found.nearest_ns == (None if nearest is None else round(nearest * 1e6))


def test_what_was_so_before_the_anchor_does_not_count() -> None:
    found = finding(BY, spins(0, 50), alive(50, 1, 1), spins(50, 400), GONE, REST)
    assert found.outcome == "fail"


def test_what_was_so_until_the_anchor_happened_may_count() -> None:
    during = [spins(0, 100), alive(100.5, 1, 1), spin(100, 101, callbacks=1), spins(110, 400)]
    found = finding(BY, during, GONE, REST)
    assert (found.outcome, found.got) == ("unclear", "no LivelinessChanged came at first, perhaps only before gone")


def test_a_script_that_is_over_before_it_is_late_leaves_it_open() -> None:
    over = [spins(100, 320), step("rest", 101, 320)]
    never = finding(BY, HERE, GONE, over, spins(320, 400))
    assert (never.outcome, never.got) == ("unclear", f"{CAME} at 50.0 ms, but the script ended before it was late")
    later = finding(BY, HERE, GONE, over, spins(320, 350), left(360))
    assert (later.outcome, later.got) == ("unclear", f"{LEFT} at 360.0 ms, perhaps 29 ms too late")


def test_a_level_that_was_reached_and_left_again_was_reached() -> None:
    back = [alive(250, 1, 1), spin(249, 251, callbacks=1)]
    assert finding(BY, HERE, GONE, left(205), back, spins(260, 400), REST).outcome == "pass"


def test_what_the_clearing_up_does_is_not_what_was_wanted() -> None:
    found = finding(BY, HERE, GONE, spins(100, 300), step("rest", 101, 302), left(305))
    assert (found.outcome, found.got) == ("unclear", f"{LEFT} at 305.0 ms, but the script was over by then")


def test_nor_on_the_virtual_clock_where_it_happens_at_the_same_moment() -> None:
    exact = {"T": 100_000_000, "tolerance": 0, "early": 0}
    ended = [spins(100, 300), step("rest", 101, 300), alive(300, 0, -1)]
    expect = BY | {"by": "gone.begin + 200ms"}
    assert finding(expect, HERE, GONE, ended, quantities=exact).outcome == "unclear"
    assert finding(expect, HERE, GONE, spins(100, 300), left(300), ended[1:2], quantities=exact).outcome == "pass"


def test_a_level_that_it_always_had() -> None:
    found = finding(BY, GONE, spins(0, 400), REST)
    assert (found.outcome, found.got) == ("pass", "no LivelinessChanged came")
    assert finding(BY, GONE, spins(0, 90), REST).got == "session sub was not driven afterwards"


def test_the_other_count() -> None:
    expect = {"level": "not_alive_count", "of": "listener", "is": 1, "by": "gone + 200ms"}
    lost = [alive(205, 0, -1, 1, 1), spin(204, 206, callbacks=1)]
    assert finding(expect, HERE, GONE, lost, spins(210, 400), REST).outcome == "pass"
    assert finding(expect, HERE, GONE, left(205), spins(210, 400), REST).outcome == "fail"


@pytest.mark.parametrize(("is_", "outcome"), [(0, "none"), (1, "fail")])
def test_without_a_registration(is_: int, outcome: str) -> None:
    setup = [registered("LivelinessChanged", code=-5)]
    found = finding(BY | {"is": is_}, GONE, spins(0, 400), REST, setup=setup)
    assert (found.outcome, found.got) == (outcome, "register answered UNSUPPORTED (-5)")


# --- throughout -----------------------------------------------------------------------------------

THROUGH = {"level": "alive_count", "of": "listener", "is": 1, "from": "settled", "until": "gone"}
SETTLED = step("settled", 50, 60, op="settle")


def test_throughout() -> None:
    found = finding(THROUGH, HERE, SETTLED, spins(60, 100), GONE, left(102), REST)
    assert found.wanted == "alive_count 1 on listener from settled until gone"
    assert (found.outcome, found.got) == ("pass", "as wanted")


@pytest.mark.parametrize(
    ("at", "wait", "outcome", "got"),
    [
        (80.0, 0.0, "fail", f"{LEFT} at 80.0 ms"),
        (101.0, 5.0, "unclear", f"{LEFT} at 101.0 ms, perhaps within the window"),
        (102.0, 0.5, "pass", "as wanted"),
    ],
)
def test_a_departure(at: float, wait: float, outcome: str, got: str) -> None:
    found = finding(THROUGH, HERE, SETTLED, left(at, wait), [alive(at + 1, 1, 1)], spins(60, 100), GONE, REST)
    assert (found.outcome, found.got) == (outcome, got)


def test_what_is_wrong_at_the_beginning_may_be_put_right_until_calls_return() -> None:
    late = [spins(0, 80), alive(85, 1, 1), spin(80, 90, callbacks=1), spins(90, 100)]
    assert finding(THROUGH | {"from": "settled.end"}, SETTLED, late, GONE, REST).outcome == "pass"
    found = finding(THROUGH, SETTLED, late, GONE, REST)
    assert (found.outcome, found.got) == ("unclear", "no LivelinessChanged came, perhaps within the window")
    found = finding(THROUGH, SETTLED, spins(0, 99, every=3), GONE, spins(102, 400), REST)
    assert (found.outcome, found.got) == ("fail", "no LivelinessChanged came")


def test_on_the_virtual_clock_a_level_reached_at_the_very_moment_is_in_time() -> None:
    exact = {"T": 100_000_000, "tolerance": 0, "early": 0}
    window = [act("settled", 60), act("gone", 100), REST]
    calls = [spins(0, 60), alive(60, 1, 1), spins(60, 100)]
    assert finding(THROUGH, calls, window, quantities=exact).outcome == "pass"
    calls = [spins(0, 60), alive(61, 1, 1), spins(60, 100)]
    assert finding(THROUGH, calls, window, quantities=exact).outcome == "fail"


def test_throughout_needs_calls() -> None:
    found = finding(THROUGH, spins(0, 40), alive(40, 1, 1), SETTLED, GONE, REST)
    assert (found.outcome, found.got) == ("unclear", "session sub was not driven afterwards")


def test_throughout_the_whole_play() -> None:
    expect = {"level": "alive_count", "of": "listener", "is": 0}
    assert finding(expect, spins(0, 400), REST).outcome == "pass"
    found = finding(expect, spins(0, 50), alive(50, 1, 1), spins(50, 400), REST)
    assert (found.outcome, found.wanted, found.got) == ("fail", "alive_count 0 on listener", f"{CAME} at 50.0 ms")


def test_two_at_once_on_the_way() -> None:
    expect = {"level": "alive_count", "of": "listener", "is": 0, "from": "gone + 200ms", "until": "rest.end"}
    two = [alive(50, 2, 2), spin(49, 51, callbacks=1)]
    steps = [alive(305, 1, -1), alive(306, 0, -1), spin(300, 307, callbacks=1)]
    assert finding(expect, two, GONE, spins(110, 300), steps, spins(310, 400), REST).outcome == "pass"


def test_blind() -> None:
    blind = Blind(begin=ms(70), end=ms(75))
    assert finding(THROUGH, HERE, SETTLED, blind, spins(60, 100), GONE, REST).outcome == "unclear"
    assert finding(THROUGH, HERE, SETTLED, blind, left(80), spins(60, 100), GONE, REST).outcome == "fail"


def test_anchored_at_a_creation() -> None:
    expect = {"level": "alive_count", "of": "listener", "is": 1, "by": "talker.created + 100ms"}
    created = state("created", 30, "talker", end=40)
    assert finding(expect, created, HERE, GONE, REST).outcome == "pass"


# --- several lives --------------------------------------------------------------------------------

ANEW = [state("destroyed", 110, "listener"), state("created", 150, "listener")]
BORN = "no LivelinessChanged came after it was created anew at 150.0 ms"


def test_a_new_life_begins_at_0() -> None:
    found = finding(BY, HERE, GONE, spins(101, 110, every=3), ANEW, spins(150, 400), REST)
    assert (found.outcome, found.got) == ("pass", BORN)
    found = finding(BY | {"is": 1}, HERE, ANEW, act("gone", 155, op="destroy"), spins(150, 400), REST)
    assert (found.outcome, found.got) == ("fail", f"{BORN}, and drive_io returned at 400.0 ms")


def test_what_a_new_life_begins_with_is_not_reached_in_time_if_it_begins_too_late() -> None:
    late = [state("destroyed", 345, "listener"), state("created", 350, "listener")]
    found = finding(BY, HERE, GONE, spins(100, 340), late, spins(350, 400), REST)
    assert (found.outcome, found.nearest_ns) == ("fail", 19_000_000)


def test_the_events_of_the_new_life_count() -> None:
    again = [ANEW, alive(160, 2, 2), spin(159, 161, callbacks=1), spins(170, 400), REST]
    assert finding(BY | {"is": 2}, HERE, GONE, again).outcome == "pass"
    assert finding(BY, HERE, GONE, again).outcome == "pass"
    late = act("gone", 155, op="destroy")
    assert finding(BY | {"is": 1}, HERE, ANEW, late, again[1:]).outcome == "fail"


def test_what_a_new_life_begins_with_has_until_calls_return_to_change() -> None:
    through = THROUGH | {"until": "rest.end"}
    before = [HERE, SETTLED, GONE, spins(100, 110), ANEW]
    soon = [spins(150, 160), alive(170, 1, 1), spin(160, 171, callbacks=1), spins(171, 401), REST]
    assert finding(through, before, soon).outcome == "pass"
    found = finding(through, before, spins(150, 400), REST)
    assert (found.outcome, found.got) == ("fail", BORN)


@pytest.mark.parametrize("count", [0, 1, 3])
@pytest.mark.parametrize("lives", [1, 2, 5])
def test_only_the_last_life_counts_after_it_has_begun(count: int, lives: int) -> None:
    before = [
        [state("created", 10 * n, "listener"), alive(10 * n + 1, 7, 7), spin(10 * n, 10 * n + 2, callbacks=1),
         state("destroyed", 10 * n + 5, "listener")]
        for n in range(lives)
    ]  # fmt: skip
    last = [state("created", 95, "listener"), [alive(97, count, count), spin(96, 98, callbacks=1)] if count else []]
    records = [before, last, GONE, spins(101, 401), REST]
    assert finding(BY | {"is": count}, records).outcome == "pass"
    assert finding(BY | {"is": 7}, records).outcome == "fail"
