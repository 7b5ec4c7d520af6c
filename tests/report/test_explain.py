from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from nros_conformance.cli.main import main
from nros_conformance.judge.results import Finding, Verdict
from nros_conformance.report.explain import (
    _finding,
    explain_cell,
    explain_note,
    explain_requirement,
    explain_word,
    script_lines,
)
from nros_conformance.report.picture import svg
from nros_conformance.report.table import assemble
from nros_conformance.report.timeline import Row
from nros_conformance.suite.catalogue import Requirement
from tests.report.build import MSL, REQUIREMENTS, canonical, cyclone, declare, registered, report, uorb

SVG = "{http://www.w3.org/2000/svg}"


@pytest.mark.parametrize(("nearest_ns", "surplus", "line"), [
    (4_300_000, None, "  nearest    4.3 ms too late"),
    (-2_000_000, None, "  nearest    2.0 ms too early"),
    (None, 3, "  nearest    3 too many"),
    (7_000_000, -1, "  nearest    7.0 ms too late, 1 too few"),
])  # fmt: skip
def test_the_nearest_miss_says_by_how_much(nearest_ns: int | None, surplus: int | None, line: str) -> None:
    missed = Finding(name="total", outcome="fail", nearest_ns=nearest_ns, surplus=surplus)
    assert _finding(missed)[-1] == line
    assert Verdict(verdict="fail", findings=(missed,)).failed() == (missed,)


def test_the_picture_has_a_row_for_each_line_and_what_is_wrong_in_red() -> None:
    rows = [
        Row(1_000_000, "talker", "publish_raw #1: OK"),
        Row(131_500_000, "listener", "RequestedDeadlineMissed total 1 (+1)"),
        Row(200_000_000, "talker", "raised \x00 <here>", "<- fails here"),
    ]
    root = ElementTree.fromstring(svg(rows, 1_000_000, "rdm.x on mine: fail"))
    texts = [(one.text, one.get("class")) for one in root.iter(f"{SVG}text")]
    assert [text for text, _ in texts] == [
        "rdm.x on mine: fail", "ms", "talker", "listener",
        "0.0", "publish_raw #1: OK", "130.5", "RequestedDeadlineMissed total 1 (+1)",
        "199.0", "raised \N{REPLACEMENT CHARACTER} <here>  <- fails here",
    ]  # fmt: skip
    assert [text for text, class_ in texts if class_ and "wrong" in class_] == [
        "199.0", "raised \N{REPLACEMENT CHARACTER} <here>  <- fails here",
    ]  # fmt: skip
    assert [circle.get("cx") for circle in root.iter(f"{SVG}circle")] == ["102", "212", "102"]


def test_explain_draws_the_timeline_of_a_stored_play(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results, picture = ("--results", str(tmp_path)), tmp_path / "why.svg"
    assert main(["run", "--backend", "uorb", "--scenario", "reg.raises-message-lost", *results]) == 0
    assert main(["explain", "uorb", "reg.raises-message-lost", "--svg", str(picture), *results]) == 0
    assert capsys.readouterr().out.endswith(f"\nPicture    {picture}\n")
    title = ElementTree.parse(picture).getroot().findtext(f"{SVG}title")
    assert title == "reg.raises-message-lost on uorb: pass"
    assert main(["explain", "deviates", "--svg", str(picture), *results]) == 4
    assert capsys.readouterr().err == (
        "nros-conformance: a picture is of one scenario: explain [BACKEND] SCENARIO --svg FILE\n"
    )


def test_the_steps_of_a_cycle_stand_below_it() -> None:
    script = {"script": [{"cycle": 5, "as": "loop", "script": [{"do": "publish", "by": "talker"}, "settle"]}]}
    assert script_lines(script) == ["cycle 5   (loop)", "    publish by talker", "    settle"]


TABLE = assemble([uorb(), cyclone()], REQUIREMENTS)


def test_a_note_is_explained_with_the_cells_that_lead_to_it() -> None:
    assert explain_note("U1", TABLE) == (
        "U1   never: the bus has no liveliness (https://docs.px4.io/main/en/middleware/uorb.html).\n\n"
        "  cells    uorb/LivelinessChanged, uorb/LivelinessLost"
    )
    assert explain_note("U9", TABLE) is None


def test_a_word_of_the_legend_names_the_cells_that_say_it() -> None:
    assert explain_word("deviates", TABLE) == (
        'deviates   printed as "partly n/m": works, but violates rules: n of the m that apply hold. If\n'
        "    [[known]] entries cover all of it the run ends with 0, otherwise with 1.\n"
        "  in these results  cyclone/LivelinessChanged C1, uorb/base !1"
    )
    assert explain_word("limited") == (
        'reduced   printed as "limited": holds inside a limit that the note states.'
    )  # fmt: skip


def test_an_absent_event_shows_what_was_answered_and_that_nothing_fired() -> None:
    one = report(
        declare("demo", events={MSL: {"claim": "no", "absent": "not-yet", "because": "no counter"}}),
        [canonical(MSL)],
        observations=[registered(2, code=-5), registered(2, code=-5)],
    )
    text = explain_cell(one, "MessageLost", assemble([one], REQUIREMENTS)).splitlines()
    assert "  register   answered UNSUPPORTED, 2 times" in text
    assert "  fired      nothing, in 1 scenario" in text


def test_the_abbreviations_of_a_source_are_expanded() -> None:
    one = Requirement(id="RDM-001", level="must", group="RDM", statement="It comes.", source="SE, on timers; RV8")
    text = explain_requirement(one, [], [], {"SE": "nano-ros, status-events.md", "VH": "nano-ros, rmw_vtable.h"})
    assert text.splitlines()[:3] == [
        "RDM-001 (must)  It comes.",
        "  from       SE, on timers; RV8",
        "             SE: nano-ros, status-events.md",
    ]
