from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from nros_conformance.cli.main import main
from nros_conformance.judge.results import Finding, Verdict
from nros_conformance.report.explain import _finding
from nros_conformance.report.picture import svg
from nros_conformance.report.timeline import Row

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
