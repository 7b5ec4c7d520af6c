from __future__ import annotations

from pathlib import Path

import pytest

from nros_conformance.campaign.rows import find_rows, rows_of, with_known
from nros_conformance.cli.main import main
from nros_conformance.formats.places import FormatError
from nros_conformance.report.results import read_report
from nros_conformance.rmw.discovery import BackendNotFound, find_backend
from nros_conformance.suite.loader import load_suites

SUITES = load_suites()
ENTRY = """\
[[known]]
key = "M1"
requirement = "{requirement}"
scenario = "{scenario}"
cause = "adapter"
because = "it was always so"
link = "{link}"
"""


def write(tmp_path: Path, requirement: str = "MSL-001", scenario: str = "msl.x", link: str = "unreported") -> Path:
    file = tmp_path / "known.toml"
    file.write_text(ENTRY.format(requirement=requirement, scenario=scenario, link=link), encoding="utf-8")
    return file


@pytest.mark.parametrize(("fields", "line", "message"), [
    ({"scenario": "reg.raises-mesage-lost"}, 4,
     "known M1: no scenario 'reg.raises-mesage-lost'; did you mean 'reg.raises-message-lost'?"),
    ({"scenario": "zzz"}, 4, "known M1: no scenario 'zzz'; see: nros-conformance list scenarios"),
    ({"scenario": "reg.raises-message-lost", "requirement": "MSL-099"}, 3,
     "known M1: no requirement 'MSL-099'; see: nros-conformance list requirements"),
    ({"scenario": "reg.raises-message-lost", "link": ""}, 1,
     'known M1: no link; add link = ..., or link = "unreported"'),
])  # fmt: skip
def test_an_entry_that_can_match_nothing_is_an_error_at_its_line(
    tmp_path: Path, fields: dict[str, str], line: int, message: str
) -> None:
    file = write(tmp_path, **fields)
    declaration = find_backend("uorb").declaration
    assert declaration is not None
    with pytest.raises(FormatError) as caught:
        with_known(declaration, file, SUITES)
    assert str(caught.value) == f"{file}:{line}: {message}"


def test_a_backend_without_variants_is_one_row() -> None:
    found = find_backend("uorb")
    assert found.declaration is not None
    (row,) = rows_of(found, found.declaration, "somewhere:Else")
    assert (row.name, row.asked, dict(row.versions)) == ("uorb", "somewhere:Else", {"PX4 uORB (model)": "0148665"})


def test_a_known_failure_that_holds_is_an_error_within_the_selection_and_silent_outside(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write(tmp_path, "REG-005", "reg.raises-message-lost")
    run = ["run", "--backend", "uorb", "--known", str(file), "--results", str(tmp_path / "results")]
    assert main([*run, "--scenario", "reg.raises-message-lost"]) == 1
    out = capsys.readouterr().out
    assert "differs  [[known]] M1 (REG-005, reg.raises-message-lost) holds; remove the entry\n" in out
    assert out.endswith("exit 1: declaration and behaviour differ\n")
    assert main([*run, "--scenario", "reg.wrong-side-is-refused"]) == 0
    known = read_report(tmp_path / "results" / "uorb").declaration.known
    assert [one.key for one in known] == ["M1"]


def test_a_list_of_known_failures_is_about_one_backend(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "--known", str(write(tmp_path)), "--results", str(tmp_path)]) == 4
    assert capsys.readouterr().err == (
        "nros-conformance: a list of known failures is about one backend; name it: --backend NAME --known FILE\n"
    )


def test_verdicts_are_written_as_junit_xml(tmp_path: Path) -> None:
    file = tmp_path / "new" / "junit.xml"
    run = ["run", "--backend", "uorb", "--results", str(tmp_path), "--junit", str(file)]
    assert main([*run, "--scenario", "reg.raises-message-lost"]) == 0
    assert file.read_text(encoding="utf-8").startswith("<?xml version='1.0' encoding='utf-8'?>\n<testsuites ")
    assert 'testcase classname="uorb.registration" name="reg.raises-message-lost"' in file.read_text(encoding="utf-8")


def test_a_row_written_with_a_colon_is_told_apart_from_a_class() -> None:
    with pytest.raises(BackendNotFound) as caught:
        find_rows("zenoh:router")
    assert str(caught.value) == (
        "no backend 'zenoh:router'; rows of zenoh are zenoh-peer, zenoh-router (MODULE:CLASS names an adapter)"
    )
    assert find_rows("nros_backends.uorb:UorbBackend").name == "uorb"
