"""A published table beside the rows in ``matrix.md`` and the web page, and what ``matrix --check`` makes of it."""

from __future__ import annotations

import random
import re

import msgspec
import pytest

from nros_conformance.report.drift import check
from nros_conformance.report.matrix import render
from nros_conformance.report.published import section
from nros_conformance.report.results import Report
from nros_conformance.report.table import assemble
from nros_conformance.report.web import page
from nros_conformance.suite.published import Published
from tests.report.build import (
    LVC,
    RDM,
    REQUIREMENTS,
    cyclone,
    result,
    uorb,
)
from tests.report.tables import NEWS, demo, shipped, with_canonical, xrce
from tests.report.test_web import Page


def test_the_section_stands_between_return_codes_and_gaps() -> None:
    text = render([cyclone(), uorb()], REQUIREMENTS, published=shipped())
    titles = re.findall(r"^## (.*)$", text, re.MULTILINE)
    assert titles[titles.index("Return codes observed") :][:3] == [
        "Return codes observed", "Against the published table", "Gaps",
    ]  # fmt: skip
    assert section(assemble([cyclone(), uorb()], REQUIREMENTS), shipped()) in text
    assert "Against the published table" not in render([cyclone(), uorb()], REQUIREMENTS)


def test_without_a_row_there_is_no_section() -> None:
    gone = msgspec.structs.replace(cyclone(), available=False, unavailable_reason="No module named 'cyclonedds'")
    assert "Against" not in render([gone], REQUIREMENTS, published=shipped())
    assert 'id="published"' not in page([gone], REQUIREMENTS, published=shipped())


def test_the_order_of_reports_changes_no_byte() -> None:
    reports = [cyclone(), uorb(), xrce(), demo(name="can")]
    first = render(reports, REQUIREMENTS, published=shipped())
    for seed in range(5):
        random.Random(seed).shuffle(reports)
        assert render(reports, REQUIREMENTS, published=shipped()) == first


def test_the_web_page_has_the_section_too() -> None:
    text = page([cyclone(), uorb()], REQUIREMENTS, published=shipped())
    found = Page(text)
    assert "published" in found.ids
    assert f"{NEWS}/packages/rmw/xrce/nros-rmw-xrce/src/vtable.c#L56-L57" in found.targets
    assert '<a href="#published">Published table</a>' in text
    part = text.partition('<h2 id="published">Against the published table</h2>')[2].partition("</section>")[0]
    assert '<th scope="row"><strong>Cyclone DDS</strong></th><td>all five</td>' in part
    assert "<td>understated: possible</td>" in part
    assert "Of its 20 cells 4 agree" in part
    assert "<p>Read, not run: " in part
    assert 'id="published"' not in page([cyclone(), uorb()], REQUIREMENTS)


def test_the_web_page_of_rows_that_agree_has_no_table_of_drift() -> None:
    part = (
        page([uorb()], REQUIREMENTS, published=shipped()).partition('<h2 id="published">')[2].partition("</section>")[0]
    )
    assert "<table" not in part
    assert "Of its 20 cells 4 agree" in part


# --- matrix --check ---------------------------------------------------------------------------------

PUBLISHED = render([cyclone(), uorb()], REQUIREMENTS, published=shipped())


def differences(*reports: Report, text: str = PUBLISHED, published: Published | None = None) -> list[str]:
    return check(text, reports, REQUIREMENTS, published=published or shipped())


def test_what_was_written_from_these_reports_is_the_same() -> None:
    assert differences(uorb(), cyclone()) == []


def test_an_edited_line_is_seen() -> None:
    edited = PUBLISHED.replace("| understated: possible |", "| agrees |")
    drift = [line for line in PUBLISHED.splitlines() if "| understated: possible |" in line]
    assert differences(uorb(), cyclone(), text=edited) == [
        f"against the published table: published {drift[0].replace('understated: possible', 'agrees')!r}, "
        "which is not so",
        f"against the published table: not published: {drift[0]!r}",
    ]


def test_a_published_table_that_changed_is_seen_whatever_was_exercised() -> None:
    newer = msgspec.structs.replace(shipped(), revision="0123456789", link="https://example.org/0123456789")
    shaken = with_canonical(cyclone(), LVC, "untested")
    for reports in ([uorb(), cyclone()], [uorb(), shaken]):
        found = differences(*reports, published=newer)
        assert [
            one for one in found if one.startswith("against the published table: not published: 'The nano-ros book")
        ]
        assert not [one for one in found if "Read, not run" in one or "Of its 20 cells" in one]


@pytest.mark.parametrize("reports", [
    [uorb(), with_canonical(cyclone(), LVC, "untested")],
    [uorb(), with_canonical(cyclone(), RDM, "unclear")],
    [uorb(), msgspec.structs.replace(cyclone(), available=False, unavailable_reason="No module named 'cyclonedds'")],
])  # fmt: skip
def test_what_was_not_decided_or_is_not_there_contradicts_nothing(reports: list[Report]) -> None:
    assert differences(*reports) == []


def test_a_detail_that_was_not_exercised_this_time_contradicts_nothing() -> None:
    silent = [one for one in xrce().results if "RDM-001" not in one.proves and "RDM-006" not in one.proves]
    gap = msgspec.structs.replace(xrce(), results=(*silent, result("rdm.silence", "RDM-001")))
    text = render([gap], REQUIREMENTS, published=shipped())
    assert differences(gap, text=text) == []
    other = msgspec.structs.replace(xrce(), results=(*silent, result("rdm.clock", "RDM-006")))
    assert "| yes° |" in text
    assert "| yes° |" in render([other], REQUIREMENTS, published=shipped())
    assert differences(other, text=text) == []


def test_a_matrix_without_the_section_is_seen() -> None:
    assert differences(uorb(), cyclone(), text=render([uorb(), cyclone()], REQUIREMENTS)) == [
        'there is no section "Against the published table" in it'
    ]
    assert check(PUBLISHED, [uorb(), cyclone()], REQUIREMENTS) == []
