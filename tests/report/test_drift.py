from __future__ import annotations

from typing import Any

import msgspec
import pytest

from nros_conformance.judge.results import Finding
from nros_conformance.report.matrix import check, render
from nros_conformance.report.results import Report, ScenarioResult
from nros_conformance.rmw.declaration import Declaration
from tests.report.build import (
    LVC,
    RDM,
    REQUIREMENTS,
    canonical,
    cyclone,
    known,
    refusal,
    registered,
    report,
    result,
    uorb,
)

PUBLISHED = render([cyclone(), uorb()], REQUIREMENTS)
FROZEN = "lvc.frozen-idle-publisher-returns"


def differences(*reports: Report, published: str = PUBLISHED) -> list[str]:
    return check(published, reports, REQUIREMENTS)


def instead(report_: Report, *results: ScenarioResult) -> Report:
    """With these results in place of those with the same key."""
    kept = [one for one in report_.results if one.key not in {new.key for new in results}]
    return msgspec.structs.replace(report_, results=(*kept, *results))


def declared(report_: Report, **fields: Any) -> Report:
    declaration: Declaration = msgspec.structs.replace(report_.declaration, **fields)
    return msgspec.structs.replace(report_, declaration=declaration)


def with_outcome(one: ScenarioResult, outcome: Any) -> ScenarioResult:
    findings: tuple[Finding, ...] = one.last.findings if one.last else ()
    return result(
        one.key, findings=[msgspec.structs.replace(found, outcome=outcome) for found in findings],
        canonical=one.canonical, refusal=one.refusal,
    )  # fmt: skip


def test_what_was_published_from_these_reports_is_the_same() -> None:
    assert differences(uorb(), cyclone()) == []


def test_versions_of_what_ran_do_not_count() -> None:
    known = [msgspec.structs.replace(one, versions="==11.0.2") for one in cyclone().declaration.known]
    newer = msgspec.structs.replace(
        declared(cyclone(), known=known), versions={"cyclonedds": "11.0.2"}, tool="0.2.0", profile="standard"
    )  # fmt: skip
    assert differences(newer, uorb()) == []


@pytest.mark.parametrize("outcome", ["unclear", "none"])
def test_a_host_that_decides_nothing_contradicts_nothing(outcome: str) -> None:
    shaken = [
        msgspec.structs.replace(one, results=tuple(with_outcome(each, outcome) for each in one.results))
        for one in (cyclone(), uorb())
    ]
    assert differences(*shaken) == []


def test_a_violation_that_was_not_exercised_this_time_contradicts_nothing() -> None:
    blocked = result(FROZEN, "LVC-009", status="untested", reason="no child processes")
    assert differences(instead(cyclone(), blocked), uorb()) == []


def test_a_gap_more_contradicts_nothing_and_a_gap_less_does() -> None:
    gap = result("all.rdm-001", "RDM-001", status="untested", reason="needs a wire")
    assert differences(instead(cyclone(), gap), uorb()) == []
    closed = result("rdm.clock-stepped[way=back]", "RDM-006")
    assert differences(instead(cyclone(), closed), uorb()) == [
        'Cyclone DDS, Requested deadline missed: published "yes°", observed "yes"'
    ]


def test_a_violation_beside_a_gap_is_seen() -> None:
    failing = result("all.rdm-001", "RDM-001", outcome="fail")
    assert differences(instead(cyclone(), failing), uorb()) == [
        'Cyclone DDS, Requested deadline missed: published "yes°", observed "**partly 6/8°** `!1`"',
        'uORB, Base rules: published "**28/29 FAIL** `!1`", observed "**28/29 FAIL** `!2`"',
        "note !1: published '**violates DSP-010**, which no `[[known]]` entry covers. Shown by `dsp.has-data`.', "
        "now '**violates RDM-001**, which no `[[known]]` entry covers. Shown by `all.rdm-001`.'",
    ]


def test_a_deviation_that_is_gone_is_seen() -> None:
    assert differences(instead(cyclone(), result(FROZEN, "LVC-009")), uorb()) == [
        'Cyclone DDS, Liveliness changed: published "**partly 8/9** `C1`", observed "yes"'
    ]


def test_a_deviation_that_is_gone_is_seen_although_something_else_was_not_exercised() -> None:
    gap = result("all.lvc-010", "LVC-010", status="untested", reason="needs a router")
    assert differences(instead(cyclone(), result(FROZEN, "LVC-009"), gap), uorb()) == [
        'Cyclone DDS, Liveliness changed: published "**partly 8/9** `C1`", observed "yes°"'
    ]


def test_more_rules_that_apply_are_seen_although_something_was_not_exercised() -> None:
    claimed = uorb().declaration.events | {"RequestedDeadlineMissed": uorb().declaration.events["MessageLost"]}
    found = differences(cyclone(), declared(uorb(), events=claimed))
    assert found[-1:] != []
    assert 'uORB, Base rules: published "**28/29 FAIL** `!1`", observed "**28/30° FAIL** `!1`"' in found


def test_a_limit_with_a_gap_more_contradicts_nothing() -> None:
    gap = result("all.msl-001", "MSL-001", status="untested", reason="needs a wire")
    assert differences(instead(cyclone(), gap), uorb()) == []


def test_another_word_with_a_gap_is_seen() -> None:
    claimed = uorb().declaration.events | {"RequestedDeadlineMissed": uorb().declaration.events["MessageLost"]}
    played = instead(declared(uorb(), events=claimed), canonical(RDM), result("all.rdm-001", "RDM-001"))
    blocked = result("all.rdm-006", "RDM-006", status="untested", reason="needs `libfaketime`")
    assert differences(cyclone(), instead(played, blocked))[0] == (
        'uORB, Requested deadline missed: published "no `U2`", observed "yes°"'
    )


def test_of_two_deviations_one_is_gone_and_one_was_not_exercised() -> None:
    both = [*cyclone().declaration.known, known("LVC-004", "lvc.leaves", "C9")]
    leaves = result("lvc.leaves", "LVC-004", outcome="fail")
    kept = [one for one in cyclone().results if "LVC-004" not in one.proves]
    whole = instead(declared(msgspec.structs.replace(cyclone(), results=tuple(kept)), known=both), leaves)
    published = render([whole, uorb()], REQUIREMENTS)
    blocked = result("lvc.leaves", "LVC-004", status="untested", reason="no child processes")
    assert differences(instead(whole, blocked), uorb(), published=published) == []
    gone = instead(whole, blocked, result(FROZEN, "LVC-009"))
    assert differences(gone, uorb(), published=published) == [
        'Cyclone DDS, Liveliness changed: published "**partly 7/9** `C1` `C9`", observed "yes°"'
    ]


def test_another_violation_beside_one_that_was_not_exercised_is_seen() -> None:
    blocked = result(FROZEN, "LVC-009", status="untested", reason="no child processes")
    failing = result("all.lvc-001", "LVC-001", outcome="fail")
    assert differences(instead(cyclone(), blocked, failing))[:1] == [
        'Cyclone DDS, Liveliness changed: published "**partly 8/9** `C1`", observed "**partly 7/9°** `!1`"'
    ]


def test_an_event_that_breaks_is_seen() -> None:
    found = differences(instead(cyclone(), canonical(LVC, "fail")), uorb())
    assert found[0] == (
        'Cyclone DDS, Liveliness changed: published "**partly 8/9** `C1`", observed "**broken** `!1` `C1`"'
    )


def test_an_absence_that_does_not_hold_is_seen() -> None:
    accepted = msgspec.structs.replace(uorb(), observations=(*uorb().observations, registered(LVC, 0)))
    assert differences(cyclone(), instead(accepted, refusal(LVC, "fail", fired={0: 1})))[:1] == [
        'uORB, Liveliness changed: published "no `U1`", observed "undeclared `U1`"',
    ]


def test_an_edited_cell_is_seen() -> None:
    edited = PUBLISHED.replace("| limited `C2` |", "| yes |")
    assert differences(cyclone(), uorb(), published=edited) == [
        'Cyclone DDS, Message lost: published "yes", observed "limited `C2`"'
    ]


def test_a_changed_reason_is_seen_in_its_note() -> None:
    edited = PUBLISHED.replace("the bus has no rate;", "the bus is slow;")
    assert differences(cyclone(), uorb(), published=edited) == [
        "note U2: published '**not wired**: the bus is slow; a clock in the adapter could do it.', "
        "now '**not wired**: the bus has no rate; a clock in the adapter could do it.'"
    ]


def test_a_scenario_more_that_shows_a_deviation_is_seen_and_one_less_is_not() -> None:
    more = PUBLISHED.replace(f"Shown by `{FROZEN}`.", f"Shown by `a.b[k=1.5]`, `{FROZEN}`.")
    assert differences(cyclone(), uorb(), published=more) == []
    other = PUBLISHED.replace(f"Shown by `{FROZEN}`.", "Shown by `a.b[k=1.5]`.")
    assert [one[:8] for one in differences(cyclone(), uorb(), published=other)] == ["note C1:"]


def test_return_codes_count_where_they_were_observed() -> None:
    observations = [one for one in cyclone().observations if one.case not in ("wrong side", "no callback")]
    fewer = msgspec.structs.replace(cyclone(), observations=tuple(observations))
    assert differences(fewer, uorb()) == []
    half = [one for one in observations if one.kind != 2]
    assert differences(msgspec.structs.replace(cyclone(), observations=tuple(half)), uorb()) == []
    changed = [one for one in half if one.kind != 1 or one.case != "right side"]
    changed.append(registered(1, -5))
    assert differences(msgspec.structs.replace(cyclone(), observations=tuple(changed)), uorb()) == [
        'Cyclone DDS, return codes, Subscription: published "0, 0, 0", observed "0, -5, \u2013"'
    ]
    half.append(registered(2, -5))
    assert differences(msgspec.structs.replace(cyclone(), observations=tuple(half)), uorb()) == [
        'Cyclone DDS, return codes, Subscription: published "0, 0, 0", observed "0, 0, -5"'
    ]
    other = msgspec.structs.replace(fewer, observations=(*observations, registered(1, -1, "no callback")))
    assert differences(other, uorb()) == ['Cyclone DDS, return codes, No callback: published "-4", observed "-1"']


def test_rows_without_a_report_and_reports_without_a_row_are_seen() -> None:
    assert differences(cyclone()) == ["uORB: published, but there is no report on it"]
    zenoh = report(msgspec.structs.replace(cyclone().declaration, name="zenoh", title="zenoh", known=[]))
    assert differences(cyclone(), uorb(), zenoh) == ["zenoh: no such row is published"]
    gone = msgspec.structs.replace(uorb(), available=False, unavailable_reason="No module named 'uorb'")
    assert differences(cyclone(), gone) == []


def test_another_subject_is_seen() -> None:
    subject = msgspec.structs.replace(uorb().declaration.subject, kind="device")
    assert differences(cyclone(), declared(uorb(), subject=subject)) == ["uORB: published as model, this is device"]


def test_findings_on_shoulds_are_compared() -> None:
    gone = instead(cyclone(), result("lvc.lost-is-not-alive", "LVC-005"))
    assert differences(gone, uorb()) == ["Cyclone DDS: the finding on LVC-005 (should) is published, but it holds"]
    new = instead(cyclone(), result("dsp.pacing", "DSP-006", outcome="fail", verdict="warn"))
    assert differences(new, uorb()) == ["Cyclone DDS: the finding on DSP-006 (should) is not published"]


def test_a_column_that_is_not_published_is_seen() -> None:
    pattern = result("pat.slow", suite="patterns", title="Slow consumer", findings=[])
    assert differences(instead(cyclone(), pattern), uorb()) == [
        "Cyclone DDS: no column Slow consumer is published",
        "uORB: no column Slow consumer is published",
    ]


def test_a_text_without_a_table_is_told_how_to_get_one() -> None:
    assert differences(cyclone(), published="# Nothing yet\n") == [
        "there is no table in it; write it with: nros-conformance matrix"
    ]
