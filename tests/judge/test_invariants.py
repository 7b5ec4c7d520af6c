from __future__ import annotations

from typing import Any

import pytest
from msgspec.structs import replace

from nros_conformance.trace.records import Blind
from tests.judge.build import (
    ALL,
    RDM,
    act,
    alive,
    call,
    counted,
    event,
    fault,
    implied,
    ms,
    register,
    registered,
    spin,
    spins,
    state,
    verdict,
)

LIVELINESS = "LivelinessChanged on listener"
MISSED = "RequestedDeadlineMissed on listener"
TALKER = [state("created", 5, "talker")]


@pytest.mark.parametrize(
    ("proves", "name", "records", "outcome", "got"),
    [
        ("CNT-001", "totals only grow, from zero", [counted(10, 2, 2), counted(20, 3)], "pass", "2 callbacks"),
        (
            "CNT-001",
            "totals only grow, from zero",
            [counted(10, 2, 2), counted(20, 1, -1)],
            "fail",
            f"{MISSED}: total 1 (-1) at 20.0 ms: it was 2 before",
        ),
        (
            "CNT-001",
            "totals only grow, from zero",
            [counted(10, 5, 1)],
            "fail",
            f"{MISSED}: total 5 (+1) at 10.0 ms: the first total is not its change",
        ),
        (
            "CNT-001",
            "totals only grow, from zero",
            [event(RDM, 10, {})],
            "fail",
            f"{MISSED}: total None (+0) at 10.0 ms: the payload has no total_count",
        ),
        ("CNT-001", "totals only grow, from zero", [alive(10, 1, 1)], "none", "no callback came"),
        (
            "CNT-002",
            "changes sum to totals",
            [counted(10, 2, 2), counted(20, 5, 1)],
            "fail",
            f"{MISSED}: total 5 (+1) at 20.0 ms: the total changed by +3",
        ),
        (
            "CNT-003",
            "no callback without a change",
            [counted(10, 1), counted(20, 1, 0)],
            "fail",
            f"{MISSED}: total 1 (+0) at 20.0 ms",
        ),
        (
            "CNT-003",
            "no callback without a change",
            [alive(10, 0, 0)],
            "fail",
            f"{LIVELINESS}: alive_count 0 (+0), not_alive_count 0 (+0) at 10.0 ms",
        ),
        ("CNT-003", "no callback without a change", [alive(10, 1, 1), alive(20, 0, -1)], "pass", "2 callbacks"),
        (
            "CNT-004",
            "liveliness changes are differences",
            [alive(10, 1, 1), alive(20, 0, -1, 1, 1), alive(30, 1, 1, 0, -1)],
            "pass",
            "3 callbacks",
        ),
        (
            "CNT-004",
            "liveliness changes are differences",
            [alive(10, 1, 1), alive(20, 0, -1, 0, 1)],
            "fail",
            f"{LIVELINESS}: alive_count 0 (-1), not_alive_count 0 (+1) at 20.0 ms: not_alive_count changed by +0",
        ),
        (
            "CNT-004",
            "liveliness changes are differences",
            [alive(10, 2, 1)],
            "fail",
            f"{LIVELINESS}: alive_count 2 (+1), not_alive_count 0 (+0) at 10.0 ms: alive_count changed by +2",
        ),
        ("CNT-005", "liveliness counts are possible", [*TALKER, alive(10, 1, 1)], "pass", "1 callback"),
        (
            "CNT-005",
            "liveliness counts are possible",
            [*TALKER, alive(10, 2, 2)],
            "fail",
            f"{LIVELINESS}: alive_count 2 (+2), not_alive_count 0 (+0) at 10.0 ms, with 1 publisher of 'sensor'",
        ),
        (
            "CNT-005",
            "liveliness counts are possible",
            [*TALKER, alive(10, 1, 1), alive(20, 1, 0, -1, -1)],
            "fail",
            f"{LIVELINESS}: alive_count 1 (+0), not_alive_count -1 (-1) at 20.0 ms",
        ),
        (
            "DSP-001",
            "callbacks only inside drive_io",
            [counted(10, 1, inside=False)],
            "fail",
            f"{MISSED}: total 1 (+1) at 10.0 ms, outside of drive_io",
        ),
        (
            "DSP-001",
            "callbacks only inside drive_io",
            [
                counted(10, 1, inside=False),
                act("ask", 9, 11, op="has_data", session="sub", entity="listener", result=False),
            ],
            "fail",
            f"{MISSED}: total 1 (+1) at 10.0 ms, inside has_data (ask)",
        ),
        ("DSP-001", "callbacks only inside drive_io", [counted(10, 1)], "pass", "1 callback"),
        (
            "DSP-002",
            "callbacks on the driving thread",
            [counted(10, 1, thread=2)],
            "fail",
            f"{MISSED}: total 1 (+1) at 10.0 ms, on another thread",
        ),
        (
            "REG-006",
            "callbacks as registered",
            [counted(10, 1, kind="MessageLost", registration="listener/RequestedDeadlineMissed")],
            "fail",
            "MessageLost on listener: total 1 (+1) at 10.0 ms: registered as RequestedDeadlineMissed",
        ),
        (
            "REG-006",
            "callbacks as registered",
            [counted(40, 1, registration="reg"), register("reg", 50)],
            "fail",
            f"{MISSED}: total 1 (+1) at 40.0 ms: before reg was registered at 50.0 ms",
        ),
        (
            "REG-006",
            "callbacks as registered",
            [counted(51, 1, registration="reg", wait=2), register("reg", 50)],
            "unclear",
            f"{MISSED}: total 1 (+1) at 51.0 ms, perhaps before it was registered",
        ),
        (
            "REG-006",
            "callbacks as registered",
            [register("reg", 50), counted(51, 1, registration="reg", wait=2)],
            "pass",
            "1 callback",
        ),
        (
            "REG-006",
            "callbacks as registered",
            [register("reg", 5, result=-4), counted(40, 1, registration="reg")],
            "fail",
            f"{MISSED}: total 1 (+1) at 40.0 ms: registering it was refused",
        ),
        (
            "REG-006",
            "callbacks as registered",
            [
                act("reg", 5, op="register", entity="listener", session="sub", kind=1, context="mine"),
                counted(40, 1, registration="reg", context="yours"),
            ],
            "fail",
            f"{MISSED}: total 1 (+1) at 40.0 ms: context 'yours' instead of 'mine'",
        ),
        (
            "REG-006",
            "callbacks as registered",
            [register("reg", 5, result=-4), register("reg", 6), counted(40, 1, registration="reg")],
            "pass",
            "1 callback",
        ),
    ],
)  # fmt: skip
def test_invariant(proves: str, name: str, records: list[Any], outcome: str, got: str) -> None:
    found = implied(proves, records)
    assert (found.name, found.outcome, found.got) == (name, outcome, got)


def test_without_callbacks_they_prove_nothing() -> None:
    result = verdict({"never": RDM, "of": "listener"}, spins(0, 100))
    laws = {one.proves[0]: one.outcome for one in result.findings if one.implied}
    assert laws == {
        "CNT-001": "none", "CNT-002": "none", "CNT-003": "none", "CNT-004": "none", "CNT-005": "none",
        "DSP-001": "none", "DSP-002": "none", "DSP-003": "none", "DSP-004": "none", "REG-006": "none",
        "ROB-003": "pass",
    }  # fmt: skip
    assert result.verdict == "pass"


def test_callbacks_of_a_session_come_one_after_the_other() -> None:
    assert implied("DSP-003", counted(10, 1)).outcome == "pass"
    found = implied("DSP-003", counted(10, 1), replace(counted(20, 2), nested=True))
    assert (found.outcome, found.got) == ("fail", f"{MISSED}: total 2 (+1) at 20.0 ms, inside another callback")


def test_counters_begin_anew_with_each_creation() -> None:
    again = [state("created", 1, "listener"), counted(10, 3, 3), state("destroyed", 20, "listener")]
    assert implied("CNT-001", again, state("created", 30, "listener"), counted(40, 1)).outcome == "pass"
    assert implied("CNT-001", again, counted(40, 1)).outcome == "fail"


def test_preset_counters_are_not_judged() -> None:
    preset = fault("limit", 5, "preset", "listener")
    assert implied("CNT-001", preset, counted(10, 2**32 - 1, 1)).outcome == "none"


def test_counters_that_were_not_all_seen_are_not_judged() -> None:
    blind = Blind(begin=ms(5), end=ms(8), session="sub")
    assert implied("CNT-002", blind, counted(10, 3, 1)).outcome == "none"


def test_a_dispatch_that_is_declared_is_allowed() -> None:
    declares = {"RequestedDeadlineMissed.dispatch": "own_call"}
    found = implied("DSP-001", counted(10, 1, inside=False), declares=declares)
    assert (found.outcome, found.got) == ("none", "no callback came")


# --- presence -------------------------------------------------------------------------------------

TWO = [*TALKER, state("created", 6, "second", session="pub")]
ENTITIES: dict[str, Any] = {
    "talker": {"publisher": "sensor"},
    "second": {"publisher": "sensor"},
    "elsewhere": {"publisher": "other"},
    "listener": {"subscription": "sensor"},
}


@pytest.mark.parametrize(
    ("records", "outcome"),
    [
        ([*TWO, alive(10, 2, 2)], "pass"),
        ([*TWO, state("destroyed", 20, "talker"), alive(200, 2, 2)], "pass"),  # within the discovery bound and late
        ([*TWO, state("destroyed", 20, "talker"), alive(251, 2, 2)], "fail"),
        ([*TWO, state("destroyed", 20, "talker"), alive(251, 2, 2, wait=5)], "unclear"),
        ([*TWO, state("destroyed", 20, "talker", code=-1), alive(900, 2, 2)], "pass"),
        ([*TWO, state("destroyed", 20, session="pub"), alive(251, 1, 1)], "fail"),
        ([*TWO, fault("dead", 20, "crash", "pub"), alive(251, 1, 1)], "fail"),
        ([*TWO, fault("cold", 20, "freeze", "pub"), alive(251, 1, 1)], "pass"),
        ([*TALKER, state("created", 6, "elsewhere", session="pub"), alive(10, 2, 2)], "fail"),
        ([*TALKER, state("created", 30, "second", session="pub"), alive(29, 2, 2)], "fail"),
        ([*TALKER, state("created", 30, "second", session="pub", end=40), alive(31, 2, 2)], "pass"),
    ],
)
def test_there_are_never_more_alive_than_there_are(records: list[Any], outcome: str) -> None:
    assert implied("CNT-005", records, entities=ENTITIES).outcome == outcome


def test_a_creation_in_progress_is_not_on_record_yet() -> None:
    assert implied("CNT-005", alive(10, 1, 1), outcome=None).outcome == "unclear"
    assert implied("CNT-005", alive(10, 1, 1)).outcome == "fail"


def test_a_lease_keeps_them_longer() -> None:
    lease = {**ENTITIES, "talker": {"publisher": "sensor", "qos": {"lease": "5T"}}}
    gone = [*TWO, state("destroyed", 20, "talker")]
    assert implied("CNT-005", gone, alive(500, 2, 2), entities=lease).outcome == "pass"
    assert implied("CNT-005", gone, alive(551, 2, 2), entities=lease).outcome == "fail"


def test_presence_is_one_at_most() -> None:
    declares = {"LivelinessChanged.presence_only": True}
    found = implied("CNT-005", TWO, alive(10, 2, 2), entities=ENTITIES, declares=declares)
    assert found.outcome == "fail"


# --- after destroy --------------------------------------------------------------------------------

GONE = state("destroyed", 50, "listener")
DESTROY = act("gone", 50, op="destroy", entity="listener", session="sub")


@pytest.mark.parametrize(
    ("records", "outcome", "got"),
    [
        ([GONE, DESTROY, spins(50, 100)], "pass", "none came"),
        (
            [GONE, DESTROY, counted(60, 1), spin(55, 61, callbacks=1)],
            "fail",
            f"{MISSED}: total 1 (+1) at 60.0 ms, after listener was destroyed at 50.0 ms",
        ),
        (
            [GONE, DESTROY, counted(60, 1, inside=False)],
            "fail",
            f"{MISSED}: total 1 (+1) at 60.0 ms, after listener was destroyed at 50.0 ms",
        ),
        (
            [GONE, DESTROY, counted(60, 1, inside=False, wait=20)],
            "unclear",
            f"{MISSED}: total 1 (+1) at 60.0 ms, after listener was destroyed at 50.0 ms",
        ),
        ([GONE, DESTROY, counted(60, 1, entity="other", session="sub"), spins(60, 70)], "pass", "none came"),
        ([counted(40, 1), GONE, DESTROY, spins(50, 100)], "pass", "none came"),
        ([GONE, DESTROY, state("created", 55, "listener"), counted(60, 1), spins(60, 70)], "pass", "none came"),
        (
            [state("destroyed", 50, session="sub"), DESTROY, counted(60, 1, inside=False), spins(60, 70)],
            "fail",
            f"{MISSED}: total 1 (+1) at 60.0 ms, after session sub was destroyed at 50.0 ms",
        ),
        ([DESTROY, state("destroyed", 60, session="sub")], "none", "nothing was destroyed before the end"),
        ([state("destroyed", 50, "listener", code=-1), DESTROY, counted(60, 1), spins(60, 70)], "none",
         "nothing was destroyed before the end"),
    ],
)  # fmt: skip
def test_after_destroy_there_is_silence(records: list[Any], outcome: str, got: str) -> None:
    found = implied("DSP-004", records)
    assert (found.name, found.outcome, found.got) == ("silence after destroy", outcome, got)


# --- codes ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("record", "got"),
    [
        (act("data", 10, result=-77), "publish (data[0]) on talker answered unpublished code -77"),
        (act("data", 10, result=1), "publish (data[0]) on talker answered unpublished code 1"),
        (
            act("data", 10, result=None, raised="ValueError: no"),
            "publish (data[0]) on talker raised: ValueError: no",
        ),
        (call("c", 0, 10, op="spin"), None),
        (act("t", 10, op="take", entity="listener", result=7), None),
        (act("t", 10, op="has_data", entity="listener", result=True), None),
        (act("d", 10, op="drive", entity="", session="", result=None), None),
        (state("refused", 10, "talker", code=-20), "refused talker answered unpublished code -20"),
        (state("destroyed", 10, session="sub", code=3), "destroying sub answered unpublished code 3"),
        (spin(0, 10, code=-50), "drive_io of session sub answered unpublished code -50"),
        (
            registered(RDM, code=-99),
            "register listener/RequestedDeadlineMissed answered unpublished code -99",
        ),
    ],
)
def test_return_codes_are_published_ones(record: Any, got: str | None) -> None:
    found = implied("ROB-003", record, setup=[*ALL])
    assert (found.name, found.outcome) == ("published return codes", "fail" if got else "pass")
    if got:
        assert found.got == got


def test_no_call_no_code() -> None:
    assert implied("ROB-003", setup=[]).got == "no call was made"
