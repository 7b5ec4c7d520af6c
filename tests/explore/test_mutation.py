"""Every defect has a mutant or a reason, every must has a mutant, and every mutant is caught where it should be."""

from __future__ import annotations

import functools
import gc
import re
import time
from pathlib import Path

import pytest

from nros_conformance.campaign.plans import Row
from nros_conformance.explore import mutation
from nros_conformance.explore.mutation import exposed, play_defective, run_mutants, try_mutant
from nros_conformance.report.mutation import (
    FILE,
    MutantResult,
    MutationReport,
    read_mutation,
    scores,
    stored_scores,
    write_mutation,
)
from nros_conformance.report.results import ReportError
from nros_conformance.rmw.discovery import find_backend
from nros_conformance.rmw.mutants import Mutant, find_mutants
from nros_conformance.suite.loader import Suites, load_suites

LISTED = re.findall(
    r"\S+",
    """
    REG-01 REG-03 REG-05 REG-10 REG-11 REG-12 REG-14 REG-16 REG-18 REG-20 REG-22 REG-23 DSP-01 DSP-04 DSP-06 DSP-08
    DSP-10 DSP-12 DSP-13 DSP-14 DSP-17 DSP-18 DSP-21 DSP-25 DSP-26 DSP-28 DSP-30 DSP-33 DSP-34 DSP-35 DSP-36 CNT-03
    CNT-04 CNT-06 CNT-07 CNT-09 CNT-11 RDM-01 RDM-03 RDM-07 RDM-08 RDM-09 RDM-10 RDM-12 RDM-16 RDM-17 ODM-02 ODM-05
    ODM-07 ODM-08 LVC-01 LVC-03 LVC-04 LVC-07 LVC-11 LVC-12 LVC-13 LVC-16 LVC-17 LVC-18 LVC-20 LVC-24 LVC-25 LVC-26
    LVC-30 LVL-03 LVL-05 LVL-07 LVL-08 LVL-09 MSL-02 MSL-05 MSL-07 MSL-08 MSL-09 MSL-11 MSL-13 MSL-16 MSL-17 QOS-02
    QOS-03 QOS-05 QOS-07 QOS-08 LIF-02 LIF-03 LIF-04 LIF-05 LIF-06 LIF-09 LIF-12 LIF-14 LIF-18 ROB-02 ROB-04 ROB-06
    ROB-09 ROB-10 CON-01 CON-03 CON-04 CON-06 CON-07 CON-08 CON-10 CON-12 CON-14 CON-15 CON-16 CON-19 CON-22 CON-25
    CON-26 CON-30 CON-35 CON-36
    """,
)
"""The defects of the list."""

SLOW = ("leaks-memory",)
"""Only a thousand sessions expose it."""


@functools.cache
def suites() -> Suites:
    return load_suites()


@functools.cache
def row() -> Row:
    found = find_backend("reference")
    assert found.declaration is not None
    return Row(found.declaration, found.adapter)


def mutants() -> dict[str, Mutant]:
    return {one.name: one for one in find_mutants()["reference"]}


def result(name: str = "m", violates: str = "RDM-001", killed_by: str = "") -> MutantResult:
    return MutantResult(name=name, defect="", violates=violates, says="is bad", killed_by=killed_by, played=3)


def report(*results: MutantResult, digest: str = "sha256:1") -> MutationReport:
    return MutationReport(digest=digest, backend="reference", mutants=results, seconds=1.0)


def test_every_listed_defect_has_a_mutant_or_a_reason_and_not_both() -> None:
    file = Path(mutation.__file__).parent / "defects.toml"
    reasons = set(re.findall(r"^(D-[A-Z]{3}-\d\d) =", file.read_text(encoding="utf-8"), re.MULTILINE))
    named = {one.defect for one in mutants().values() if one.defect}
    assert named | reasons == {f"D-{id_}" for id_ in LISTED}
    assert named & reasons == set()


def test_every_must_and_should_has_a_mutant() -> None:
    violated = {one.violates for one in mutants().values()}
    assert [id_ for id_, level in suites().levels.items() if level != "may" and id_ not in violated] == []


def test_names_are_unique_and_each_says_what_is_wrong() -> None:
    names = [one.name for one in find_mutants()["reference"]]
    assert len(names) == len(set(names))
    assert all(one.says and one.adapter.__doc__ == one.says for one in mutants().values())


@pytest.mark.parametrize("name", [name for name in mutants() if name not in SLOW])
def test_a_mutant_is_killed_on_the_requirement_that_it_violates(name: str) -> None:
    assert try_mutant(mutants()[name], suites(), row()).killed_by


def test_the_reference_itself_is_exposed_by_nothing() -> None:
    one = next(one for one in suites().scenarios if one.scenario.id == "rdm.odd-phase")
    trace = play_defective(one, row(), suites(), find_backend("reference").load())
    assert exposed(trace, "RDM-001") == ""


def test_a_mutant_that_never_returns_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    endless = mutants()["clock-reads-zero"].adapter

    class Spins(endless):  # type: ignore[misc, valid-type]
        def create_session(self, options: object) -> object:
            while True:
                pass

    monkeypatch.setattr(mutation, "PLAY_S", 0.2)
    one = next(one for one in suites().scenarios if one.scenario.id == "rdm.odd-phase")
    trace = play_defective(one, row(), suites(), Spins)
    assert trace.end is not None
    assert (trace.end.outcome, trace.end.detail) == ("hang", "the play did not end within 0.2 s")
    assert exposed(trace, "RDM-001") == "the backend hung: the play did not end within 0.2 s"
    assert exposed(trace, "LVC-001") == ""


def test_it_is_cut_off_where_the_exception_is_propagated(monkeypatch: pytest.MonkeyPatch) -> None:
    endless = mutants()["clock-reads-zero"].adapter

    class Collects(endless):  # type: ignore[misc, valid-type]
        def create_session(self, options: object) -> object:
            while True:
                gc.collect(0)

    def takes_long(phase: str, info: dict[str, int]) -> None:  # what is raised here ends in a warning, as in Hypothesis
        time.sleep(0.02)

    monkeypatch.setattr(mutation, "PLAY_S", 0.1)
    one = next(one for one in suites().scenarios if one.scenario.id == "rdm.odd-phase")
    gc.callbacks.append(takes_long)
    try:
        trace = play_defective(one, row(), suites(), Collects)
    finally:
        gc.callbacks.remove(takes_long)
    assert trace.end is not None
    assert trace.end.outcome == "hang"


def test_several_run_in_processes_of_their_own() -> None:
    found = run_mutants(suites(), only=["fires-early", "no-going"])
    assert [(one.name, bool(one.killed_by)) for one in found.mutants] == [("fires-early", True), ("no-going", True)]
    assert found.digest == suites().digest


def test_the_score_is_kept_for_the_very_suites_only(tmp_path: Path) -> None:
    stored = report(result("a", killed_by="x"), result("b"), result("c", "LVC-001", "y"))
    write_mutation(tmp_path, stored)
    assert scores(stored) == {"RDM": (1, 2), "LVC": (1, 1)}
    assert stored_scores(tmp_path, "sha256:1") == (scores(stored), "")
    assert stored_scores(tmp_path, "sha256:2") == (
        {}, f"{tmp_path / FILE}: its mutants were played on other suites; run again: nros-conformance mutants"
    )  # fmt: skip
    assert stored_scores(tmp_path / "none", "sha256:1") == ({}, "")
    assert list(stored.unexercised({"RDM-001": "must", "RDM-002": "should", "CNT-006": "may"})) == ["RDM-002"]


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ('{"format": 1}', "damaged: Object missing required field `digest`"),
        ("{", "damaged: Input data was truncated"),
        (
            '{"format": 2, "digest": "", "backend": "", "mutants": [], "seconds": 1}',
            "format 2; this nros-conformance reads format 1: run again: nros-conformance mutants",
        ),
    ],
)
def test_a_stored_run_that_cannot_be_read_is_named(text: str, wrong: str, tmp_path: Path) -> None:
    (tmp_path / FILE).write_text(text, encoding="utf-8")
    with pytest.raises(ReportError) as caught:
        read_mutation(tmp_path)
    remedy = "" if wrong.startswith("format") else "; run again: nros-conformance mutants"
    assert str(caught.value) == f"{tmp_path / FILE}: {wrong}{remedy}"
