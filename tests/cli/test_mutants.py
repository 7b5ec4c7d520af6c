from __future__ import annotations

from pathlib import Path

import pytest

from nros_conformance.cli.codes import ExitCode
from nros_conformance.cli.main import main
from nros_conformance.cli.mutants import decided, told
from nros_conformance.report.mutation import FILE
from tests.explore.test_mutation import report, result

LEVELS = {"RDM-001": "must", "RDM-002": "should", "CNT-006": "may"}


def test_the_report_tells_killed_ones_survivors_and_what_no_mutant_violates() -> None:
    text = told(report(result("early", killed_by="rdm.a"), result("worse")), LEVELS)
    assert text.splitlines() == [
        "early  RDM-001  -          killed    rdm.a",
        "worse  RDM-001  -          SURVIVES  3 scenarios played",
        "",
        "1 of 2 mutants are killed   1.0 s",
        "survives  worse: is bad (RDM-001, must)",
        "no mutant violates RDM-002",
    ]


def test_all_is_well_when_every_must_has_a_mutant_and_each_of_those_is_killed() -> None:
    killed, alive = result("a", killed_by="x"), result("b")
    should = result("c", violates="RDM-002")
    assert decided(report(killed, should), LEVELS) == ExitCode.OK
    assert decided(report(killed, alive), LEVELS) == ExitCode.FAILED
    assert decided(report(should), LEVELS) == ExitCode.FAILED
    assert decided(report(should), LEVELS, whole=False) == ExitCode.OK
    assert decided(report(alive), LEVELS, whole=False) == ExitCode.FAILED


def test_one_mutant_by_name_is_told_and_not_stored(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["mutants", "--mutant", "fires-early", "--results", str(tmp_path)]) == 0
    assert "1 of 1 mutants are killed" in capsys.readouterr().out
    assert not (tmp_path / FILE).exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--mutant", "fires-erly"], "nros-conformance: no mutant 'fires-erly'; did you mean 'fires-early'?\n"),
        (["--backend", "cyclone"], "nros-conformance: the backend 'cyclone' has no mutants\n"),
    ],
)
def test_what_is_not_there(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["mutants", *arguments]) == 4
    assert capsys.readouterr().err == message
