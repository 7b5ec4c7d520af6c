from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from nros_conformance.cli.explore import compared, told
from nros_conformance.cli.main import main
from nros_conformance.explore.explore import Comparison, Deviation, Difference, Search
from nros_conformance.explore.timelines import Action, Timeline
from nros_conformance.judge.results import Verdict
from nros_conformance.rmw.events import EventKind

TIMELINE = Timeline(
    (Action("drive", count=5), Action("lose", "manual", 2), Action("publish", "manual")), (EventKind.MESSAGE_LOST,)
)
FAIL = Verdict(verdict="fail", reason="MSL-001: total 0")


def test_a_search_that_finds_nothing(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = tmp_path / "explored.yaml"
    assert main(["explore", "--backend", "reference", "--examples", "5", "--seed", "9", "--output", str(out)]) == 0
    assert capsys.readouterr().out == "reference: 5 timelines, seed 9: nothing found\n"
    assert not out.exists()


def test_what_was_found_is_told_action_by_action() -> None:
    search = Search(31, [Deviation(TIMELINE, {}, FAIL, 2)], Counter({"C2": 4}), Counter({"RDM-003": 1}), 3)
    assert told(search, "mine", 4).splitlines() == [
        "mine: 31 timelines, seed 4: 1 found",
        "  known    C2 in 4 timelines",
        "  once     RDM-003 in 1 timeline, and not when played again",
        "  unclear  3 timelines",
        "",
        "1  MSL-001: total 0 (and 2 timelines more)",
        "",
        "      1  drive 2.5T",
        "      2  lose manual x2",
        "      3  publish manual",
        "         events: MessageLost",
    ]


def test_differences_are_told_by_requirement() -> None:
    assert compared(Comparison(7), "one", "two", 5) == "one and two: 7 timelines, seed 5: no difference"
    known = Difference("LVC-009", "one", 1, TIMELINE, FAIL, "C2")
    comparison = Comparison(7, [known, Difference("MSL-001", "two", 3, TIMELINE, FAIL)], Counter(), 1)
    assert compared(comparison, "one", "two", 5).splitlines() == [
        "one and two: 7 timelines, seed 5: 2 differences",
        "  unclear  1 timeline",
        "",
        "LVC-009  one alone fails, in 1 timeline, known as C2",
        "         shortest: drive 2.5T, lose manual x2, publish manual",
        "         MSL-001: total 0",
        "",
        "MSL-001  two alone fails, in 3 timelines",
        "         shortest: drive 2.5T, lose manual x2, publish manual",
        "         MSL-001: total 0",
    ]
