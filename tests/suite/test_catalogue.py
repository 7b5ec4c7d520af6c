from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pytest

from nros_conformance.formats.places import FormatError
from nros_conformance.suite.catalogue import Requirements, load_requirements
from nros_conformance.suite.loader import shipped_suites

SIZES = {
    "REG": 9, "DSP": 12, "CNT": 7, "RDM": 9, "ODM": 4, "LVC": 11, "LVL": 6, "MSL": 8, "QOS": 6, "CON": 10, "LIF": 4,
    "ROB": 4,
}  # fmt: skip
SHOULD = {
    "REG-007", "REG-008", "DSP-006", "DSP-009", "DSP-012", "CNT-007", "RDM-009", "LVC-003", "LVC-005", "LVL-004",
    "LVL-006", "MSL-006", "MSL-007", "MSL-008", "QOS-006", "CON-007", "ROB-004",
}  # fmt: skip


@pytest.fixture(scope="module")
def requirements() -> Requirements:
    return load_requirements(shipped_suites() / "requirements.yaml")


def test_there_are_ninety_in_twelve_groups(requirements: Requirements) -> None:
    assert [one.id for one in requirements] == [
        f"{group}-{number:03}" for group, size in SIZES.items() for number in range(1, size + 1)
    ]
    assert list(requirements.groups) == list(SIZES)
    assert Counter(one.group for one in requirements) == SIZES


def test_72_must_17_should_1_may(requirements: Requirements) -> None:
    assert Counter(requirements.levels.values()) == {"must": 72, "should": 17, "may": 1}
    assert {one.id for one in requirements if one.level == "should"} == SHOULD
    assert requirements.level("CNT-006") == "may"


def test_all_31_conflicts_are_settled(requirements: Requirements) -> None:
    conflicts = {conflict for one in requirements for conflict in one.conflicts}
    assert conflicts == {f"C{number:02}" for number in range(1, 32)}
    assert all(one.resolution for one in requirements if one.conflicts)


def test_statements_are_sentences(requirements: Requirements) -> None:
    for one in requirements:
        assert re.fullmatch(r"[A-Za-z].*\.", one.statement), one.id
        assert re.fullmatch(r"([A-Z].*\.)?", one.resolution), one.id
        assert one.source, one.id


def test_every_abbreviation_is_expanded_and_used(requirements: Requirements) -> None:
    used = {word for one in requirements for word in re.findall(r"(?:^|; )([A-Z]+[0-9]*)\b", one.source)}
    spelt_out = {"PX4", "ROS", "CNT"}  # "PX4 pull request ...", "ROS 2 design article", "CNT-006"
    assert used == set(requirements.sources) | spelt_out


def test_it_reads_like_a_mapping(requirements: Requirements) -> None:
    assert requirements["RDM-003"].conflicts == ("C02", "C26")
    assert requirements.by_id["RDM-003"] is requirements["RDM-003"]
    assert "RDM-003" in requirements
    assert "RDM-010" not in requirements
    assert len(requirements) == 90
    assert requirements.version == "1.0"
    with pytest.raises(KeyError):
        requirements.level("RDM-010")


GOOD = """\
version: "1.0"
sources: {EH: nros/rmw_event.h}
groups: {RDM: Requested deadline missed}
requirements:
  - id: RDM-001
    level: must
    statement: A miss is reported.
    source: EH
    conflict: [C01]
    resolution: It is.
"""


def test_a_good_catalogue() -> None:
    assert load_requirements(Path("r.yaml"), GOOD)["RDM-001"].resolution == "It is."


@pytest.mark.parametrize(
    ("good", "bad", "expected"),
    [
        ("level: must", "level: shall", "6: level: unknown value 'shall'; valid are may, must, should"),
        ("level: must", "levl: must", "6: unknown key 'levl'; did you mean 'level'?"),
        ("RDM-001", "RDM-1", "5: id: 'RDM-1' does not have the form ^[A-Z]{3}-[0-9]{3}$"),
        ("RDM-001", "RDN-001", "5: RDN-001: unknown group 'RDN'; did you mean 'RDM'?"),
        ("[C01]", "[C1]", "9: conflict: 'C1' does not have the form ^C[0-9]{2}$"),
        ("    resolution: It is.\n", "", "5: RDM-001: a conflict without its resolution; add resolution: ..."),
        ("source: EH", "source: ''", "8: RDM-001: the source is empty"),
        ("A miss is reported.", "''", "7: RDM-001: the statement is empty"),
        (
            "    resolution: It is.\n",
            "    resolution: It is.\n  - {id: RDM-001, level: may, statement: x, source: EH}\n",
            "11: the requirement RDM-001 stands here twice; the first is in line 5",
        ),
    ],
)
def test_a_catalogue_that_cannot_be_used(good: str, bad: str, expected: str) -> None:
    assert good in GOOD
    with pytest.raises(FormatError) as caught:
        load_requirements(Path("r.yaml"), GOOD.replace(good, bad))
    assert str(caught.value) == f"r.yaml:{expected}"
