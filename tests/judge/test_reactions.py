"""What callbacks do, and drives that an exception of one ended, in the judgement."""

from __future__ import annotations

from msgspec.structs import replace

from tests.judge.build import RDM, act, call, counted, finding, implied, spin, spins, step, take, taken, verdict

PERIODIC = {"periodic": RDM, "of": "listener", "every": "1T", "since": "one", "until": "rest.end"}
WITHIN = "listener/RequestedDeadlineMissed"


def test_a_drive_that_an_exception_ended_had_to_deliver_nothing() -> None:
    ended = spin(60, 150, callbacks=1)
    neighbour, late = counted(140, 1, entity="other"), counted(152, 1)
    before = [act("one", 0), spins(0, 60), neighbour]
    after = [late, spin(150, 160, callbacks=1), spins(160, 200), step("rest", 0, 200)]
    found = finding(PERIODIC, before, ended, after)
    assert (found.outcome, found.nearest_ns) == ("fail", 22_000_000)
    assert finding(PERIODIC, before, replace(ended, raised="boom"), after).outcome == "pass"


def test_what_a_callback_does_is_no_end_of_the_script() -> None:
    last = step("rest", 0, 300)
    inner = replace(act("inner", 350, op="publish", session="sub", entity="listener"), within=WITHIN)
    total = {"total": RDM, "of": "listener", "is": 1}
    records = [spins(0, 300), counted(100, 1), last, spins(300, 340), counted(350, 2), inner, spins(350, 400)]
    assert finding(total, records).outcome == "pass"
    assert finding(total, [*records[:-2], replace(inner, within="")]).outcome == "fail"


def test_how_long_a_call_within_a_callback_took_is_judged_like_any_other() -> None:
    inner = replace(call("inner", 100, 180), within=WITHIN)
    records = [spins(0, 100), counted(100, 1), inner, spin(100, 190, callbacks=1)]
    expect = {"takes": "inner", "at_most": "0.2T"}
    assert finding(expect, records).got == "inner[0] at 100.0 ms took 80 ms"
    assert finding(expect, spins(0, 100), counted(100, 1), replace(inner, wait=70_000_000)).outcome == "unclear"


def test_samples_taken_in_a_callback_were_received() -> None:
    data = act("data", 10, sequence=1)
    inner = replace(take("taken", 100, 1), within=WITHIN)
    records = [data, spins(0, 100), counted(100, 1), taken(100, 1), inner, spin(90, 110, callbacks=1)]
    assert finding({"received": "data", "of": "listener"}, records).outcome == "pass"


def test_an_answer_out_of_the_set_is_one_within_a_callback_too() -> None:
    inner = replace(act("inner", 100, result=-77), within=WITHIN)
    assert implied("ROB-003", spins(0, 100), inner).got == "publish (inner[0]) on talker answered unpublished code -77"


def test_an_exception_that_the_script_asked_for_is_no_failure() -> None:
    boom = replace(act("boom", 100, op="raise", entity="listener", session="sub", result=None), within=WITHIN)
    records = [act("one", 0), spins(0, 100), counted(100, 1), boom, replace(spin(90, 100, callbacks=1), raised="boom")]
    assert verdict({"never": RDM, "of": "listener", "until": "one"}, records, spins(100, 200)).verdict == "pass"
