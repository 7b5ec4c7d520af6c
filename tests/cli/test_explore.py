from __future__ import annotations

from pathlib import Path

import pytest

from nros_conformance.cli.explore import compared, told
from nros_conformance.cli.main import main
from nros_conformance.explore.explore import Deviation, Search
from nros_conformance.explore.timelines import Action, Timeline
from nros_conformance.judge.results import Verdict

TIMELINE = Timeline((Action("drive", count=5), Action("lose", "manual", 2), Action("publish", "manual")))


def test_a_search_that_finds_nothing(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = tmp_path / "explored.yaml"
    assert main(["explore", "--backend", "reference", "--examples", "5", "--seed", "9", "--output", str(out)]) == 0
    assert capsys.readouterr().out == "reference: 5 timelines, seed 9: nothing found\n"
    assert not out.exists()


def test_what_was_found_is_told_action_by_action() -> None:
    found = Deviation(TIMELINE, {}, Verdict(verdict="fail", reason="MSL-001: total 0"))
    assert told(Search(31, found), "mine", 4).splitlines() == [
        "mine: after 31 timelines, seed 4: MSL-001: total 0", "", "  1  drive 2.5T", "  2  lose manual x2",
        "  3  publish manual",
    ]  # fmt: skip


def test_differences_are_told_by_requirement() -> None:
    assert compared({}, "one", "two", 7) == "one and two: 7 timelines, no difference"
    assert compared({"MSL-001": (0, 3, TIMELINE)}, "one", "two", 7).splitlines() == [
        "          one alone fails  two alone fails  shortest timeline",
        "MSL-001                 0                3  drive 2.5T, lose manual x2, publish manual",
    ]
