from __future__ import annotations

from xml.etree import ElementTree

import msgspec

from nros_conformance.judge.results import Verdict
from nros_conformance.report.junit import junit
from nros_conformance.report.results import Attempt, Difference
from nros_conformance.suite.loader import load_suites
from tests.report.build import declare, known, report, result

CATALOGUE = {one.id: one for one in load_suites().requirements}


def suite(text: bytes) -> ElementTree.Element:
    found = ElementTree.fromstring(text).find("testsuite")
    assert found is not None
    return found


def outcomes(of: ElementTree.Element) -> dict[str | None, tuple[str, str | None] | None]:
    found = {}
    for case in of.findall("testcase"):
        (*_, last) = case if len(case) else [None]
        shown = last is not None and last.tag not in ("properties", "system-out")
        found[case.get("name")] = (last.tag, last.get("message")) if last is not None and shown else None
    return found


def test_every_outcome_has_its_form() -> None:
    declaration = declare(known=[known("RDM-003", "rdm.known")])
    warned = Attempt(
        number=1, T_ns=1, trace="t", seconds=0.25, verdict=Verdict(verdict="warn", warnings=("RDM-009: 12 callbacks",))
    )
    one = report(declaration, [
        result("rdm.fine", "RDM-001"),
        result("rdm.wrong", "RDM-003", outcome="fail", reason="RDM-003: total 2"),
        result("rdm.known", "RDM-003", outcome="fail", reason="RDM-003: total 2", known="D1"),
        result("rdm.slow", "RDM-001", outcome="unclear", reason="gap of 200 ms"),
        result("rdm.not", "RDM-001", status="not-applicable", reason="it is not claimed"),
        result("rdm.broken", findings=[], verdict="error", reason="the harness failed: \x00"),
        msgspec.structs.replace(result("rdm.warned", "RDM-009"), attempts=(warned,), verdict="warn"),
    ], differences=(Difference(text="claimed, but broken"),))  # fmt: skip
    written = suite(junit([one], CATALOGUE))
    assert outcomes(written) == {
        "rdm.fine": None,
        "rdm.wrong": ("failure", "RDM-003: total 2"),
        "rdm.known": ("skipped", "[[known]] D1: RDM-003: total 2"),
        "rdm.slow": ("skipped", "gap of 200 ms"),
        "rdm.not": ("skipped", "it is not claimed"),
        "rdm.broken": ("error", "the harness failed: \N{REPLACEMENT CHARACTER}"),
        "rdm.warned": None,
        "declaration": ("failure", "claimed, but broken"),
    }
    assert {name: written.get(name) for name in ("name", "tests", "failures", "errors", "skipped")} == {
        "name": "demo", "tests": "8", "failures": "2", "errors": "1", "skipped": "3",
    }  # fmt: skip
    (wrong,) = (case for case in written.findall("testcase") if case.get("name") == "rdm.wrong")
    (warning,) = written.iter("system-out")
    assert warning.text == "warn: RDM-009: 12 callbacks"
    text = wrong.findtext("failure")
    assert text is not None
    assert "again   nros-conformance run --backend demo --scenario rdm.wrong" in text
    assert [one.get("value") for one in wrong.iter("property")] == ["RDM-003"]


def test_a_backend_that_is_not_available_is_an_error() -> None:
    missing = report(declare(), available=False, unavailable_reason="No module named 'demo'")
    assert outcomes(suite(junit([missing], CATALOGUE))) == {"declaration": ("error", "No module named 'demo'")}
