from __future__ import annotations

import pytest

from nros_conformance.report.columns import columns
from nros_conformance.report.results import ReportError
from tests.report.build import MUSTS, REQUIREMENTS, report, result


def test_every_must_has_exactly_one_column() -> None:
    held = [must for column in columns(REQUIREMENTS) for must in column.musts]
    assert len(held) == len(MUSTS) == 72
    assert sorted(held) == sorted(MUSTS)


def test_the_columns_hold_as_many_musts_as_the_documents_say() -> None:
    assert {column.title: len(column.musts) for column in columns(REQUIREMENTS)} == {
        "Liveliness changed": 9, "Requested deadline missed": 8, "Message lost": 5, "Liveliness lost": 4,
        "Offered deadline missed": 4, "Base rules": 33, "Ping": 3, "Reconnect": 3, "Hard liveliness": 3,
    }  # fmt: skip


def test_a_must_without_a_column_is_refused() -> None:
    with pytest.raises(ReportError) as error:
        columns({**REQUIREMENTS, "XYZ-002": "must", "CON-011": "must", "XYZ-001": "should"})
    assert str(error.value) == ("no column of the matrix holds CON-011, XYZ-002; give it one in report/columns.py")


def test_patterns_are_columns_once_their_suite_is_there() -> None:
    pattern = result("pat.slow-consumer", suite="patterns", title="Slow consumer")
    assert [one.id for one in columns(REQUIREMENTS, [report(results=[pattern])]) if one.pattern] == [
        "pat.slow-consumer"
    ]
    assert not [one for one in columns(REQUIREMENTS, [report(results=[result("a.a")])]) if one.pattern]
