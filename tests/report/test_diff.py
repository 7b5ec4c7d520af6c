"""``matrix --diff``: the exact text of what changed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

from nros_conformance.cli.main import main
from nros_conformance.report.changes import Snapshot, changes, of_table, of_text, read_old
from nros_conformance.report.matrix import render
from nros_conformance.report.printed import gaps
from nros_conformance.report.results import Report, ReportError, ScenarioResult, write_report
from nros_conformance.report.table import assemble
from nros_conformance.suite.loader import load_suites
from tests.report.build import (
    LVC,
    MUSTS,
    REFUSED,
    REQUIREMENTS,
    canonical,
    cyclone,
    declare,
    everything,
    known,
    reference,
    report,
    result,
    uorb,
)

FROZEN = "lvc.frozen-idle-publisher-returns"
SAME = "nothing changed against old: 18 cells"


def snapshot(*reports: Report) -> Snapshot:
    return of_table(assemble(reports, REQUIREMENTS))


def printed(*reports: Report) -> Snapshot:
    return of_text(render(reports, REQUIREMENTS), REQUIREMENTS)


def diff(old: Snapshot, *new: Report) -> str:
    return changes(old, snapshot(*new), "old")


def instead(one: Report, *results: ScenarioResult) -> Report:
    kept = [each for each in one.results if each.key not in {new.key for new in results}]
    return msgspec.structs.replace(one, results=(*kept, *results))


def untested(key: str, *proves: str, reason: str = "no wire") -> ScenarioResult:
    return result(key, *proves, status="untested", reason=reason)


BOTH = [snapshot, printed]
"""A former matrix can be had from results or from its text; what both know they tell alike."""


@pytest.mark.parametrize("read", BOTH)
def test_the_same_observations(read: Any) -> None:
    assert diff(read(cyclone(), uorb(), reference()), uorb(), cyclone()) == SAME


@pytest.mark.parametrize("read", BOTH)
def test_a_deviation_that_is_gone_is_shown_with_its_requirement_and_scenario(read: Any) -> None:
    assert diff(read(cyclone(), uorb()), instead(cyclone(), result(FROZEN, "LVC-009")), uorb()) == (
        "Cyclone DDS, Liveliness changed: partly 8/9 -> yes\n"
        f"  LVC-009  violated, known -> holds   {FROZEN}\n"
        "\n"
        "1 of 18 cells changed against old"
    )


def test_a_new_violation_is_shown_with_its_scenario() -> None:
    failing = instead(cyclone(), result("all.rdm-001", "RDM-001", outcome="fail"))
    assert diff(snapshot(cyclone(), uorb()), failing, uorb()) == (
        "Cyclone DDS, Requested deadline missed: yes° -> partly 6/8°\n"
        "  RDM-001  holds -> violated   all.rdm-001\n"
        "\n"
        "1 of 18 cells changed against old"
    )
    assert diff(printed(cyclone(), uorb()), failing, uorb()) == (
        "Cyclone DDS, Requested deadline missed: yes° -> partly 6/8°\n"
        "  RDM-001  violated   all.rdm-001\n"
        "\n"
        "1 of 18 cells changed against old"
    )


@pytest.mark.parametrize("read", BOTH)
def test_a_gap_that_was_closed(read: Any) -> None:
    closed = instead(cyclone(), result("rdm.clock-stepped[way=back]", "RDM-006"))
    assert diff(read(cyclone(), uorb()), closed, uorb()) == (
        "Cyclone DDS, Requested deadline missed: yes° -> yes\n"
        "  RDM-006  not exercised -> holds   rdm.clock-stepped[way=back]\n"
        "\n"
        "1 of 18 cells changed against old"
    )


@pytest.mark.parametrize("read", BOTH)
def test_a_deviation_that_was_not_exercised_any_more(read: Any) -> None:
    blocked = instead(cyclone(), untested(FROZEN, "LVC-009", reason="no child"))
    assert diff(read(cyclone(), uorb()), blocked, uorb()) == (
        "Cyclone DDS, Liveliness changed: partly 8/9 -> yes°\n"
        f"  LVC-009  violated, known -> not exercised   {FROZEN}; no child\n"
        "\n"
        "1 of 18 cells changed against old"
    )


@pytest.mark.parametrize("read", BOTH)
def test_a_violation_that_somebody_declared(read: Any) -> None:
    declared = msgspec.structs.replace(uorb().declaration, known=[known("DSP-010", "dsp.has-data", "U9")])
    assert diff(read(cyclone(), uorb()), cyclone(), msgspec.structs.replace(uorb(), declaration=declared)) == (
        "uORB, Base rules: 28/29 FAIL -> partly 28/29\n"
        "  DSP-010  violated -> violated, known   dsp.has-data\n"
        "\n"
        "1 of 18 cells changed against old"
    )


@pytest.mark.parametrize("read", BOTH)
def test_another_violation_under_the_same_word(read: Any) -> None:
    other = instead(cyclone(), result(FROZEN, "LVC-009"), result("all.lvc-001", "LVC-001", outcome="fail"))
    text = diff(read(cyclone(), uorb()), other, uorb())
    assert text.splitlines()[0] == "Cyclone DDS, Liveliness changed: partly 8/9"
    assert text.splitlines()[2] == f"  LVC-009  violated, known -> holds   {FROZEN}"


@pytest.mark.parametrize("read", BOTH)
def test_a_verdict_where_there_was_none(read: Any) -> None:
    decided = instead(uorb(), result("msl.two-publishers", "MSL-003"))
    assert diff(read(cyclone(), uorb()), cyclone(), decided) == (
        "uORB, Message lost: unclear -> yes\n"
        "  MSL-003  unclear -> holds   msl.two-publishers\n"
        "\n"
        "1 of 18 cells changed against old"
    )


@pytest.mark.parametrize("read", BOTH)
def test_without_a_requirement_behind_it_the_reason_is_told(read: Any) -> None:
    old = declare(), [each for each in everything(declare()) if each.canonical != LVC.label]
    broken = report(old[0], [*old[1], canonical(LVC, "fail")])
    text = diff(read(report(old[0], [*old[1], canonical(LVC)])), broken)
    assert text.splitlines()[:2] == [
        "Demo, Liveliness changed: yes -> broken",
        "  claimed, but the canonical stimulus fails: reg.raises-liveliness-changed",
    ]


@pytest.mark.parametrize(
    ("outcome", "lines"),
    [
        ("pass", ["  RDM-001  not exercised -> holds   rdm.a-long-name-of-a-scenario-0 and 4 more"]),
        ("fail", ["  RDM-001  not exercised -> violated   rdm.a-long-name-of-a-scenario-0,",
                  "    rdm.a-long-name-of-a-scenario-1, rdm.a-long-name-of-a-scenario-2 and 2 more"]),
    ],
)  # fmt: skip
def test_of_many_scenarios_some_are_named_and_long_lines_are_wrapped(outcome: Any, lines: list[str]) -> None:
    declaration = declare()
    old = report(declaration, everything(declaration, "RDM-001"))
    shown = [result(f"rdm.a-long-name-of-a-scenario-{number}", "RDM-001", outcome=outcome) for number in range(5)]
    assert diff(snapshot(old), instead(old, *shown)).splitlines()[1:-2] == lines


@pytest.mark.parametrize("read", BOTH)
def test_rows_versions_suites_profile_and_columns(read: Any) -> None:
    can = report(declare("can", title="CAN"))
    newer = msgspec.structs.replace(
        cyclone(), versions={"cyclonedds": "11.0.2", "python": "3.12"}, digest="sha256:55ab", suites_version="1.1",
        profile="standard", tool="0.2.0",
        results=(*cyclone().results, result("pat.slow", suite="patterns", title="Slow consumer", findings=[])),
    )  # fmt: skip
    declared = [msgspec.structs.replace(one, versions="==11.0.2") for one in newer.declaration.known]
    newer = msgspec.structs.replace(
        newer, declaration=msgspec.structs.replace(newer.declaration, known=declared)
    )  # fmt: skip
    alike: dict[str, Any] = {"digest": "sha256:55ab", "suites_version": "1.1", "profile": "standard", "tool": "0.2.0"}
    compiled = report(declare("zenoh", title="zenoh", kind="compiled"), **alike)
    gone = msgspec.structs.replace(uorb(), available=False, unavailable_reason="no 'uorb' (/opt/uorb.py)", **alike)
    old = read(cyclone(), uorb(), can, report(declare("zenoh", title="zenoh")))
    mqtt = report(declare("mqtt", title="MQTT <3>", adapter="acme:Mqtt"), **alike)
    assert diff(old, newer, gone, compiled, mqtt) == (
        "suites   1.0 (sha256:3f2a9c71) -> 1.1 (sha256:55ab)\n"
        "profile  publish -> standard\n"
        "tool     0.1.0 -> 0.2.0\n"
        "python   3.11 -> 3.12\n"
        "rows     + MQTT &lt;3>, library\n"
        "         - CAN, library\n"
        "         - uORB, model (not available here: no 'uorb')\n"
        "ran      zenoh: library -> compiled\n"
        "tested   Cyclone DDS: cyclonedds 11.0.1 -> cyclonedds 11.0.2\n"
        "         zenoh: nros-conformance 0.1.0 -> nros-conformance 0.2.0\n"
        "columns  + Slow consumer\n"
        "\n"
        "0 of 18 cells changed against old"
    )


def test_a_column_that_is_gone() -> None:
    pattern = result("pat.slow", suite="patterns", title="Slow consumer", findings=[])
    assert diff(snapshot(instead(uorb(), pattern)), uorb()).splitlines()[0] == "columns  - Slow consumer"


@pytest.mark.parametrize("read", BOTH)
def test_a_pattern_that_works_now(read: Any) -> None:
    def pattern(outcome: Any) -> ScenarioResult:
        return result("pat.slow", "DSP-010", suite="patterns", title="Slow consumer", outcome=outcome)

    assert diff(read(instead(uorb(), pattern("fail"))), instead(uorb(), pattern("pass"))) == (
        "uORB, Slow consumer: partly -> yes\n  the pattern works\n\n1 of 10 cells changed against old"
    )


def test_a_row_whose_variant_is_gone_with_its_backend() -> None:
    old = snapshot(uorb(), report(declare("zenoh", title="zenoh"), variant="peer"))
    gone = report(declare("zenoh", title="zenoh"), available=False, unavailable_reason="No module named 'zenoh'")
    assert diff(old, uorb(), gone).splitlines()[0] == (
        "rows     - zenoh (peer), library (not available here: No module named 'zenoh')"
    )


def test_one_cell_is_no_plural() -> None:
    def only(text: str) -> Snapshot:
        cells = {"Ping": msgspec.structs.replace(next(iter(whole.values())), text=text, rules={})}
        return Snapshot(ran={}, columns=("Ping",), rows={"A": msgspec.structs.replace(row, cells=cells)})

    row = snapshot(uorb()).rows["uORB"]
    whole = row.cells
    assert changes(only("yes"), only("yes"), "m.md") == "nothing changed against m.md: 1 cell"
    assert changes(only("no"), only("yes"), "m.md").endswith("\n\n1 of 1 cell changed against m.md")


def test_gaps_of_a_printed_matrix() -> None:
    declaration = declare(behaviour={"derived_support": True})
    first = report(declaration, everything(declaration, "RDM-006", "ROB-001"))
    second = report(declare("other", title="Other"), everything(declare(), "LVL-001", "ROB-001"))
    found = gaps(render([first, second], REQUIREMENTS))
    nothing = "no scenario proves it"
    assert found == {
        "Demo": {
            "REG-001": "not applicable, supports_event is derived from return codes", "RDM-006": nothing,
            "ROB-001": nothing,
        },
        "Other": {"LVL-001": nothing, "ROB-001": nothing},
    }  # fmt: skip


def test_what_does_not_apply_any_more() -> None:
    derived = declare(behaviour={"derived_support": True})
    old, new = report(derived, everything(derived)), report(declare(), everything(declare()))
    for read in BOTH:
        assert diff(read(old), new).splitlines()[:2] == [
            "Demo, Base rules: 32/32 -> 33/33",
            "  REG-001  n/a -> holds   all.reg-001",
        ]


def test_an_event_that_is_refused_now() -> None:
    refusing = declare(events={LVC: REFUSED})
    text = diff(snapshot(report(declare(), everything(declare()))), report(refusing, everything(refusing)))
    assert text.splitlines()[:2] == [
        "Demo, Liveliness changed: yes -> no", "  LVC-001  holds -> n/a   LivelinessChanged is not claimed",
    ]  # fmt: skip
    assert len([one for one in text.splitlines() if "  LVC-" in one]) == sum(one[:3] == "LVC" for one in MUSTS)


# --- what can be given as OLD -----------------------------------------------------------------------


def test_old_is_a_directory_of_results_or_a_matrix(tmp_path: Path) -> None:
    for one in (cyclone(), uorb()):
        write_report(tmp_path / "results", one)
    file = tmp_path / "matrix.md"
    file.write_text(render([cyclone(), uorb()], REQUIREMENTS), encoding="utf-8")
    assert read_old(tmp_path / "results", REQUIREMENTS) == snapshot(cyclone(), uorb())
    assert read_old(file, REQUIREMENTS) == printed(cyclone(), uorb())


def test_what_cannot_be_old(tmp_path: Path) -> None:
    text, binary, empty = tmp_path / "notes.md", tmp_path / "a.out", tmp_path / "empty"
    text.write_text("# Notes\n\n| a | b |\n|:--|:--|\n| c | d |\n", encoding="utf-8")
    binary.write_bytes(b"\xff\xfe")
    empty.mkdir()
    for path, message in [
        (tmp_path / "gone", "there is no such file or directory"),
        (text, "neither a directory of results nor a matrix.md"),
        (binary, "neither a directory of results nor a matrix.md"),
        (empty, "no reports here; run: nros-conformance run"),
    ]:
        with pytest.raises(ReportError) as error:
            read_old(path, REQUIREMENTS)
        assert str(error.value) == f"{path}: {message}"


SUITE = """\
suite: sample
title: A sample
scenarios:
  - id: sample.one
    title: Nothing is lost
    entities:
      talker: {publisher: sensor}
      listener: {subscription: sensor}
    script:
      - settle
      - {do: publish, by: talker, as: data}
      - {drive: 1T}
    expect:
      - {never: MessageLost, of: listener, proves: MSL-002}
"""


@pytest.fixture
def suites(tmp_path: Path) -> Path:
    """A small suite; catalogue and published table are the shipped ones."""
    directory = tmp_path / "suites"
    directory.mkdir()
    (directory / "sample.yaml").write_text(SUITE, encoding="utf-8")
    return directory


@pytest.fixture
def arguments(suites: Path, tmp_path: Path) -> list[str]:
    """The command on results that were played on these suites, up to the option that is tested."""
    write_report(tmp_path / "new", msgspec.structs.replace(uorb(), digest=load_suites(suites).digest))
    return [
        "matrix", "--results", str(tmp_path / "new"), "--suites", str(suites), "--output", str(tmp_path / "matrix.md")
    ]  # fmt: skip


def test_the_command_prints_it_and_writes_nothing(
    arguments: list[str], suites: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old, output = tmp_path / "old", tmp_path / "matrix.md"
    write_report(old, uorb())
    assert main([*arguments, "--diff", str(old)]) == 0
    assert capsys.readouterr().out == (
        f"suites   1.0 (sha256:3f2a9c71) -> 1.0 ({load_suites(suites).digest[:15]})\n\n"
        f"0 of 9 cells changed against {old}\n"
    )
    assert not output.exists()
    assert main(arguments) == 0
    capsys.readouterr()
    assert main([*arguments, "--diff", str(output)]) == 0
    assert capsys.readouterr().out == f"nothing changed against {output}: 9 cells\n"


def test_a_bad_old_is_a_usage_error(
    arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:  # fmt: skip
    assert main([*arguments, "--diff", str(tmp_path / "gone")]) == 4
    assert capsys.readouterr().err == (
        f"nros-conformance: {tmp_path / 'gone'}: there is no such file or directory\n"
    )  # fmt: skip


def test_check_and_diff_exclude_each_other(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["matrix", "--check", "--diff", "old"])
    assert "argument --diff: not allowed with argument --check" in capsys.readouterr().err


def test_the_matrix_command_puts_the_published_table_beside_the_rows(arguments: list[str], tmp_path: Path) -> None:
    output, web = tmp_path / "matrix.md", tmp_path / "matrix.html"
    assert main([*arguments, "--html", str(web)]) == 0
    assert "## Against the published table" in output.read_text(encoding="utf-8")
    assert 'id="published"' in web.read_text(encoding="utf-8")
    assert main([*arguments, "--check"]) == 0
    text = output.read_text(encoding="utf-8")
    output.write_text(text.replace("Of its 20 cells 4 agree", "Of its 20 cells 20 agree"), encoding="utf-8")
    assert main([*arguments, "--check"]) == 1
