from __future__ import annotations

from typing import Any

import pytest
from msgspec.structs import replace

from nros_conformance.judge.drives import LAST, Drives
from nros_conformance.judge.findings import milliseconds, miss
from nros_conformance.judge.index import Index
from nros_conformance.judge.intervals import (
    EVER,
    INF,
    Interval,
    instant,
    maybe_between,
    surely_between,
    worst,
)
from nros_conformance.judge.moments import NoSuchMoment, resolve, window_start
from nros_conformance.judge.tolerances import smallest_T, tolerances
from nros_conformance.rmw.clock import MS
from nros_conformance.suite.loader import typed
from nros_conformance.suite.moments import Moment
from tests.judge.build import (
    ENTITIES,
    RDM,
    act,
    alive,
    counted,
    fault,
    matched,
    ms,
    publish,
    spin,
    spins,
    state,
    step,
    trace,
)

# --- tolerances -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("T_ms", "late", "early"), [(100, 30, 5), (130, 39, 6.5), (60, 30, 3), (30, 30, 2), (1000, 300, 50)]
)
def test_tolerances(T_ms: int, late: float, early: float) -> None:  # noqa: N803
    assert tolerances("real", T_ms * MS) == (late * MS, early * MS)
    assert tolerances("virtual", T_ms * MS) == (0, 0)


def test_smallest_scale() -> None:
    assert smallest_T("real", 20 * MS) == 100 * MS
    assert smallest_T("real", 250 * MS) == 250 * MS
    assert smallest_T("virtual", 20 * MS) == 20 * MS


# --- intervals ------------------------------------------------------------------------------------


def test_between_leaves_the_borders_out() -> None:
    window = instant(10), instant(20)
    assert surely_between(instant(11), *window)
    assert not maybe_between(instant(10), *window)
    assert not maybe_between(instant(20), *window)
    assert not surely_between(Interval(9, 11), *window)
    assert maybe_between(Interval(9, 11), *window)
    assert not surely_between(instant(15), EVER, instant(20))
    assert maybe_between(instant(15), EVER, EVER)


def test_the_worst_of_several() -> None:
    assert worst(["pass", "none", "unclear", "fail"]) == "fail"
    assert worst(["pass", "none", "unclear"]) == "unclear"
    assert worst(["none", "pass"]) == "pass"
    assert worst([]) == "none"


@pytest.mark.parametrize(
    ("ns", "text"),
    [(4_300_000, "4.3 ms"), (130 * MS, "130 ms"), (0, "0 ms"), (12_345, "0.0123 ms"), (99_999, "0.1 ms")],
)
def test_durations_for_people(ns: int, text: str) -> None:
    assert milliseconds(ns) == text


def test_by_how_much() -> None:
    assert miss(4_300_000) == "4.3 ms too late"
    assert miss(-2 * MS, perhaps=True) == "perhaps 2 ms too early"


# --- drives ---------------------------------------------------------------------------------------


def placed(*parts: Any) -> Drives:
    return Drives([(10 * number, one) for number, one in enumerate(parts)])


def test_the_last_call_before() -> None:
    drives = placed(spin(0, 10, wait=2), spin(10, 20, wait=3), spin(20, 30))
    assert drives.surely() == ms(30)
    assert drives.surely(position=20) == ms(17)
    assert drives.maybe(position=20) == ms(20)
    assert drives.surely(limit=ms(20)) == ms(8)
    assert drives.maybe(limit=ms(18)) == ms(18)
    assert drives.surely(position=0) == -INF
    assert drives.surely(position=20, after=10) == -INF
    assert drives.maybe(position=20, after=10) == -INF
    assert drives.surely(position=20, after=9) == ms(17)
    assert placed().surely() == placed().maybe() == -INF


def test_a_record_of_many_calls_that_goes_on_beyond_a_border() -> None:
    long = spin(0, 500, calls=50, gap=1, longest=10)
    assert placed(long).surely(limit=ms(300)) == ms(300 - 1 - 10)
    waited = replace(long, wait=5 * MS)
    assert placed(waited).surely(limit=ms(300)) == ms(300 - 1 - 10 - 5)
    assert placed(long).maybe(limit=ms(300)) == ms(300)
    assert placed(long).surely(limit=ms(15)) == ms(4)
    assert placed(long).surely(limit=ms(10.5)) == ms(0)
    assert placed(long).surely(limit=ms(9)) == -INF
    unknown = spin(0, 500, calls=50, gap=1)
    assert placed(unknown).surely(limit=ms(300)) == -INF
    assert placed(unknown).maybe(limit=ms(300)) == ms(300)
    one = spin(0, 500)
    assert placed(one).surely(limit=ms(300)) == placed(one).maybe(limit=ms(300)) == -INF


def test_a_record_of_many_calls_whose_last_one_had_a_callback() -> None:
    long = spin(0, 500, calls=50, gap=1, longest=10, callbacks=1)
    assert placed(long).surely(position=-1, when=ms(495)) == ms(495 - 11)
    assert placed(long).maybe(position=-1, when=ms(495)) == ms(495)


def test_spins_of_a_stretch() -> None:
    drives = placed(spin(0, 10), spin(10, 20), spin(20, 30))
    assert [one.begin for one in drives.between(0, 20)] == [ms(10)]
    held = drives.holding(15, LAST)
    assert held is not None
    assert held.begin == ms(20)
    assert drives.holding(15, 20) is None


# --- moments --------------------------------------------------------------------------------------

RECORDS = [
    state("created", 1, "listener", end=2),
    matched(3, 4),
    matched(4, 6),
    alive(7, 1, 1, wait=1),
    publish("data", 10, 20, 30, took=2),
    step("silence", 40, 90),
    fault("gone", 95, end=97),
    counted(98, 1),
    step("rest", 100, 200),
]


def index(outcome: str | None = "done", records: Any = RECORDS) -> Index:
    one = trace({"never": RDM, "of": "listener"}, records, outcome=outcome)
    return Index(one, typed(one.header.scenario))


@pytest.mark.parametrize(
    ("text", "lo", "hi"),
    [
        ("start", 0, 0),
        ("start + 1T", 100, 100),
        ("end", 200, 200),
        ("end - 50ms", 150, 150),
        ("data", 10, 32),
        ("data.begin", 10, 10),
        ("data.end", 32, 32),
        ("data.first", 10, 12),
        ("data.last", 30, 32),
        ("data.last.begin", 30, 30),
        ("data[1]", 20, 22),
        ("data[1].end + 0.5T", 72, 72),
        ("data[-2]", 20, 22),
        ("silence.end", 90, 90),
        ("gone", 95, 97),
        ("gone.end", 97, 97),
        ("listener.created", 1, 2),
        ("listener.created + 1T", 101, 102),
        ("listener.settled", 4, 6),
        ("start.settled", 4, 6),
        ("listener.LivelinessChanged[0]", 6, 7),
        ("listener.RequestedDeadlineMissed.last", 98, 98),
    ],
)
def test_moments_of_a_whole_trace(text: str, lo: float, hi: float) -> None:
    assert resolve(index(), Moment.parse(text)) == (ms(lo), ms(hi))


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("nothing", "there is no nothing in the trace"),
        ("data[3]", "there is no data[3] in the trace, only 3 of them"),
        ("talker.created", "there is no talker.created in the trace"),
        ("listener.MessageLost.last", "there is no listener.MessageLost.last in the trace"),
        ("other.settled", "other was not matched with anything"),
    ],
)
def test_moments_that_did_not_occur(text: str, what: str) -> None:
    with pytest.raises(NoSuchMoment) as caught:
        resolve(index(), Moment.parse(text))
    assert str(caught.value) == what


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("start", (ms(0), ms(0))),
        ("data[1]", (ms(20), ms(22))),
        ("data.first.begin", (ms(10), ms(10))),
        ("data.last", (ms(30), INF)),
        ("data", (ms(10), INF)),
        ("data.begin", (ms(10), ms(10))),
        ("data.end", (ms(10), INF)),
        ("data[3]", EVER),
        ("nothing", EVER),
        ("end", (ms(90), INF)),
        ("listener.created", (ms(1), ms(2))),
        ("listener.settled", (ms(4), INF)),
        ("listener.LivelinessChanged[0]", (ms(6), ms(7))),
        ("listener.LivelinessChanged.last", (ms(6), INF)),
        ("listener.MessageLost[0]", EVER),
    ],
)
def test_moments_of_a_trace_that_was_cut_short(text: str, expected: Any) -> None:
    assert resolve(index(None, RECORDS[:6]), Moment.parse(text)) == expected


def test_the_begin_of_a_window() -> None:
    assert window_start(index(), Moment.parse("start")) == instant(-INF)
    assert window_start(index(), Moment.parse("start + 1T")) == instant(ms(100))


def test_several_entities_and_sessions_as_one() -> None:
    crowd = {**ENTITIES, "talker": {"publisher": "sensor", "count": 2, "session": "far"}}
    states = [state("created", 1, "talker[0]", end=2), state("created", 3, "talker[1]", end=5)]
    parallel = [act("data", 10, 19, index=0), act("data", 10, 12, index=1)]
    one = trace({"never": RDM, "of": "listener"}, states, parallel, spins(0, 10), entities=crowd)
    found = Index(one, typed(one.header.scenario))
    assert found.members("talker") == ("talker[0]", "talker[1]")
    assert found.members(["listener", "talker[1]"]) == ("listener", "talker[1]")
    assert found.members("ALL") == ("talker[0]", "talker[1]", "listener")
    assert (found.session_of("talker[1]"), found.session_of("listener")) == ("far", "sub")
    assert resolve(found, Moment.parse("talker.created")) == (ms(1), ms(5))
    assert resolve(found, Moment.parse("talker[1].created")) == (ms(3), ms(5))
    assert resolve(found, Moment.parse("data")) == (ms(10), ms(19))


def test_by_when_something_was_read() -> None:
    assert placed(spin(0, 10), spin(10, 35), spin(40, 50)).read_by(ms(5)) == ms(35)
    assert placed(spin(0, 10), spin(10, 35), spin(40, 50)).read_by(ms(40)) == ms(50)
    assert placed(spin(0, 10)).read_by(ms(5)) == INF
    assert placed(spin(0, 500, calls=50, longest=10, gap=1)).read_by(ms(100)) == ms(121)
    assert placed(spin(200, 500, calls=50, longest=10, gap=1)).read_by(ms(100)) == ms(210)
    assert placed(spin(0, 110, calls=50, longest=10, gap=1), spin(110, 115)).read_by(ms(100)) == ms(115)


def test_calls_that_a_callback_makes_are_not_steps_of_the_script() -> None:
    inner = replace(act("inner", 250, 260), within="listener/RequestedDeadlineMissed")
    found = index(records=[*RECORDS, inner])
    assert found.script_end == instant(ms(200))


def test_a_call_that_a_callback_ended_by_raising_is_no_opportunity() -> None:
    broken = replace(spin(10, 20), raised="ValueError: no")
    assert index(records=[spin(0, 10), broken, step("rest", 0, 200)]).drives("sub").surely() == ms(10)
