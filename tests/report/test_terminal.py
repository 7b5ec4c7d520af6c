"""What a run prints: columns as wide as their longest name, and a line per reason and not per scenario."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from nros_conformance.report.results import Report
from nros_conformance.report.terminal import closing, meaning, opening, row_line
from tests.report.build import REQUIREMENTS, cyclone, declare, everything, reference, report, result, uorb


@dataclass(frozen=True)
class Selected:
    profile: str = "publish"
    narrowed: bool = False


@dataclass(frozen=True)
class Loaded:
    version: str = "1.0"
    scenarios: tuple[object, ...] = (1, 2, 3)


def closed(*reports: Report, selected: Selected = Selected()) -> list[str]:
    return closing(reports, REQUIREMENTS, Path("results"), selected).splitlines()


def lines(word: str, *reports: Report) -> list[str]:
    return [line for line in closed(*reports) if line.startswith(word)]


def router() -> Report:
    declaration = declare("zenoh")
    return report(declaration, everything(declaration), variant="through-a-router", seconds=12.25)


@pytest.mark.parametrize(("selected", "what"), [
    (Selected(), "profile publish"), (Selected(narrowed=True), "selected"),
])  # fmt: skip
def test_the_first_line_says_what_was_selected(selected: Selected, what: str) -> None:
    assert opening("0.1.0", Loaded(), selected, 2) == f"nros-conformance 0.1.0   suites 1.0   {what}: 2 of 3 scenarios"


def test_the_rows_to_be_played_stand_in_columns() -> None:
    first = row_line("can", declare(), {"python-can": "4.6.1"}, False, 3, 5, 12)
    second = row_line("zenoh-router", declare(), {}, True, 4, 5, 12)
    assert first == "can          python-can 4.6.1, library, real clock                      3 apply, 2 do not"
    assert second == "zenoh-router library, virtual clock                                     4 apply, 1 do not"


def test_a_long_name_does_not_run_into_the_first_column() -> None:
    found = closed(cyclone(), router())
    heads = [index for index, line in enumerate(found) if "scenarios   pass" in line]
    assert found[heads[0] : heads[0] + 3] == [
        "                        scenarios   pass  warn  known  FAIL  unclear  none      time",
        "cyclone                        68     66     1      1     0        0     0     0.0 s",
        "zenoh-through-a-router         68     68     0      0     0        0     0    12.2 s",
    ]
    assert found[4:8] == [
        "",
        "                        Liveliness  Requested  Message    Liveliness  Offered    Base",
        "                        changed     deadline   lost       lost        deadline   rules",
        "cyclone                 partly 8/9  yes°       limited    yes         yes        33/33",
    ]
    assert found[8].startswith("zenoh-through-a-router  yes         yes        yes")


def test_short_names_are_as_wide_as_the_words_before_other_lines() -> None:
    assert closed(uorb())[1].startswith("          scenarios")
    assert closed(uorb())[2].startswith("uorb      ")


def test_the_control_has_no_cells() -> None:
    assert not [line for line in closed(reference()) if "Liveliness" in line]


def test_what_was_not_played_is_one_line_for_each_reason() -> None:
    untested = [
        *(result(f"lvc.freeze[{key}]", status="untested", reason="no child") for key in "abc"),
        result("lvc.thaws", status="untested", reason="no child"),
        result("msl.reordering", status="untested", reason="no wire"),
        result("lvc.stops", status="untested", reason="no child"),
    ]
    assert lines("untested", report(results=untested)) == [
        "untested demo: 5 scenarios, no child (lvc.freeze, lvc.thaws, ...)",
        "untested demo: 1 scenario, no wire (msl.reordering)",
    ]


def test_what_is_known_or_unclear_is_named() -> None:
    assert lines("known", cyclone()) == [
        "known    cyclone lvc.frozen-idle-publisher-returns (C1) fails as declared"
    ]  # fmt: skip
    assert lines("unclear", uorb()) == ["unclear  uorb msl.two-publishers:  (1 attempt)"]


def test_musts_without_evidence_are_counted() -> None:
    declaration = declare()
    assert lines("gaps", report(declaration, everything(declaration, "LVC-011", "CON-001"))) == [
        "gaps     demo: 2 musts that apply were not exercised: LVC-011, CON-001"
    ]
    asked = result("con.ping", "CON-001")
    assert lines("gaps", report(declaration, [*everything(declaration, "LVC-011"), asked])) == [
        "gaps     demo: 1 must that applies was not exercised: LVC-011"
    ]


def test_a_narrowed_run_names_what_passed_and_why_the_rest_does_not_apply_and_has_no_cells() -> None:
    one = report(results=[
        result("rdm.recovery[period=1]", "RDM-003", "RDM-004"),
        result("lvc.comes", status="not-applicable", reason="LivelinessChanged is not claimed"),
    ])  # fmt: skip
    narrowed = Selected("standard", narrowed=True)
    assert closing([one], REQUIREMENTS, Path("results"), narrowed, apart=["demo"]).splitlines()[4:] == [
        "pass     demo rdm.recovery[period=1]   RDM-003, RDM-004",
        "n/a      demo: 1 scenario, LivelinessChanged is not claimed (lvc.comes)",
        "claims   demo: 5 of 5 events claimed",
        "written  results/   narrowed/demo/report.json",
        "kept     results/demo: the results of the last whole run",
    ]
    many = report(results=[result(f"rdm.recovery[period={number}]") for number in range(13)])
    assert not [line for line in closed(many, selected=narrowed) if line.startswith("pass")]


def test_when_nothing_that_was_selected_applies_the_exit_code_says_so() -> None:
    one = report(results=[result("lvc.comes", status="not-applicable", reason="LivelinessChanged is not claimed")])
    assert meaning(5, [one]) == ": no scenario that was selected applies"


def test_a_backend_that_could_not_run_says_what_installs_it() -> None:
    declaration = declare(subject={"kind": "library", "says": "it", "install": "pip install it"})
    assert lines("missing", report(declaration, available=False, unavailable_reason="no it")) == [
        "missing  demo: no it; install it: pip install it"
    ]


@pytest.mark.parametrize(("selected", "next_"), [
    (Selected(), []), (Selected(narrowed=True), []),
    (Selected("standard"), ["next     nros-conformance matrix   (a published matrix needs --profile publish)"]),
])  # fmt: skip
def test_the_next_command_is_named_where_there_is_one(selected: Selected, next_: list[str]) -> None:
    assert [line for line in closed(uorb(), selected=selected) if line.startswith("next")] == next_


@pytest.mark.parametrize(("code", "text"), [
    (0, ""), (1, ": a must fails that no [[known]] entry covers: uorb dsp.has-data"),
    (2, ": interrupted; what was judged is kept"), (3, ": the harness itself failed"),
    (4, ": something given cannot be used"), (5, ": a named backend is not available, or nothing was judged"),
    (8, ": more scenarios stayed unclear than --max-unclear allows"),
])  # fmt: skip
def test_an_exit_code_is_explained(code: int, text: str) -> None:
    assert meaning(code, [cyclone(), uorb()]) == text


def test_without_a_failure_it_is_the_declaration_that_differs() -> None:
    assert meaning(1, [cyclone()]) == ": declaration and behaviour differ"
