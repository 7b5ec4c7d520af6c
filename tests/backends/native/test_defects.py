"""Each defect that can be compiled into the C example fails on the requirement that it violates."""

from __future__ import annotations

from pathlib import Path

import pytest

from nros_conformance.play.launch import Launch
from nros_conformance.rmw.backtraces import find_debugger
from tests.backends.native.compiling import Build, Play, needs

DEFECTS = {
    "WRONG_CODE": ("reg.wrong-side-is-refused", "REG-002"),
    "FIRES_IN_REGISTER": ("reg.state-before-registration[n=1]", "DSP-001"),
    "FIRES_IN_PUBLISH": ("reg.raises-message-lost", "DSP-001"),
    "WRONG_THREAD": ("cnt.one-by-one", "DSP-002"),
    "NEVER_RESETS_CHANGE": ("cnt.one-by-one", "CNT-002"),
    "ALIASES_KIND": ("reg.unknown-kind[kind=256]", "REG-003"),
    "COUNTS_BEFORE_REGISTRATION": ("cnt.before-the-registration", "CNT-002"),
    "FIRES_AFTER_DESTROY": ("dsp.after-destroy", "DSP-004"),
}


@pytest.mark.parametrize("defect", DEFECTS)
def test_a_defect_fails_on_the_requirement_that_it_violates(defect: str, build: Build, play: Play) -> None:
    scenario, requirement = DEFECTS[defect]
    (verdict,) = play(build("loopback.c", defect), scenario).values()
    assert verdict.verdict == "fail"
    assert requirement in {proved for finding in verdict.failed() for proved in finding.proves}


def test_the_example_passes_every_scenario_on_which_a_defect_fails(loopback: Path, play: Play) -> None:
    verdicts = play(loopback, *sorted({scenario for scenario, _ in DEFECTS.values()}))
    assert {key: (verdict.verdict, verdict.reason) for key, verdict in verdicts.items()} == {
        key: ("pass", "") for key, _ in DEFECTS.values()
    }


@pytest.mark.parametrize(("storage", "verdict"), [("fresh", "fail"), ("stable", "pass")])
def test_a_kept_pointer_to_a_struct_is_found_by_fresh_structs(
    storage: str, verdict: str, build: Build, play: Play
) -> None:
    (found,) = play(build("loopback.c", "KEEPS_STRUCT"), "reg.raises-message-lost", storage=storage).values()
    assert found.verdict == verdict


def test_a_crash_costs_the_scenario_that_caused_it(build: Build, play: Play) -> None:
    verdicts = play(build("loopback.c", "CRASHES_IN_PUBLISH"), "reg.raises-liv*", "reg.raises-message-lost")
    assert {key: verdict.verdict for key, verdict in verdicts.items()} == {
        "reg.raises-liveliness-changed": "pass",
        "reg.raises-liveliness-lost": "pass",
        "reg.raises-message-lost": "fail",
    }
    reason = verdicts["reg.raises-message-lost"].reason
    assert reason.startswith("the backend crashed: the process died of SIGSEGV, in publish_raw at entities.py:")


@needs("gdb")
def test_a_crash_comes_with_the_native_frames_where_a_debugger_is_installed(build: Build, play: Play) -> None:
    launch = Launch(debugger=find_debugger())
    (verdict,) = play(build("loopback.c", "CRASHES_IN_PUBLISH"), "reg.raises-message-lost", launch=launch).values()
    before, _, native = verdict.reason.partition("; natively in ")
    assert before.startswith("the backend crashed: the process died of SIGSEGV")
    assert native.startswith("publish_raw at loopback.c:")
