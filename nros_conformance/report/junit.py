"""Reports as JUnit XML, in the form that pytest writes (xunit2), for the test views of CI systems.

A scenario is a test case in the class of its backend and suite. A known failure and what could not be
judged are *skipped*, with the type and reason: nothing that is unclear looks like a pass.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from xml.etree import ElementTree

from nros_conformance.report.explain import failure
from nros_conformance.report.results import Report, ScenarioResult
from nros_conformance.suite.catalogue import Requirement

DECLARATION = "declaration"
"""The name of the test case that holds what declaration and behaviour differ in."""

_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def junit(reports: Iterable[Report], requirements: Mapping[str, Requirement]) -> bytes:
    """The whole file, UTF-8."""
    root = ElementTree.Element("testsuites", name="nros-conformance")
    for report in reports:
        _suite(root, report, requirements)
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return text + b"\n"


def _suite(root: ElementTree.Element, report: Report, requirements: Mapping[str, Requirement]) -> None:
    suite = ElementTree.SubElement(root, "testsuite", name=report.row)
    _properties(
        suite, [("suites", f"{report.suites_version} {report.digest}"), ("profile", report.profile),
                *(("version", f"{name} {version}") for name, version in sorted(report.versions.items()))],
    )  # fmt: skip
    cases = [_case(suite, report, result, requirements) for result in report.results]
    cases.append(_declaration(suite, report))
    for name, tag in (("errors", "error"), ("failures", "failure"), ("skipped", "skipped")):
        suite.set(name, str(sum(case.find(tag) is not None for case in cases)))
    suite.set("tests", str(len(cases)))
    suite.set("time", f"{report.seconds:.3f}")


def _case(
    suite: ElementTree.Element, report: Report, result: ScenarioResult, requirements: Mapping[str, Requirement]
) -> ElementTree.Element:
    seconds = sum(attempt.seconds for attempt in result.attempts)
    case = ElementTree.SubElement(
        suite, "testcase", classname=f"{report.row}.{result.suite}", name=result.key, time=f"{seconds:.3f}"
    )
    _properties(case, [("requirement", id_) for id_ in result.proves])
    verdict = result.last
    if verdict is None:
        _outcome(case, "skipped", result.status, result.reason or "not played")
    elif verdict.verdict == "fail" and result.known:
        _outcome(case, "skipped", "known", f"[[known]] {result.known}: {verdict.reason}")
    elif verdict.verdict == "fail":
        _outcome(case, "failure", "fail", verdict.reason, failure(report, result, requirements))
    elif verdict.verdict == "error":
        _outcome(case, "error", "error", verdict.reason)
    elif verdict.verdict in ("inconclusive", "none"):
        _outcome(case, "skipped", "unclear" if verdict.verdict == "inconclusive" else "none", verdict.reason)
    elif verdict.warnings:
        ElementTree.SubElement(case, "system-out").text = _clean("\n".join(f"warn: {one}" for one in verdict.warnings))
    return case


def _declaration(suite: ElementTree.Element, report: Report) -> ElementTree.Element:
    case = ElementTree.SubElement(suite, "testcase", classname=report.row, name=DECLARATION, time="0.000")
    if not report.available:
        _outcome(case, "error", "unavailable", report.unavailable_reason)
    elif report.differences:
        texts = [one.text for one in report.differences]
        _outcome(case, "failure", "differs", texts[0], "\n".join(texts))
    return case


def _outcome(case: ElementTree.Element, tag: str, kind: str, message: str, text: str = "") -> None:
    ElementTree.SubElement(case, tag, type=kind, message=_clean(message)).text = _clean(text) or None


def _properties(parent: ElementTree.Element, pairs: Sequence[tuple[str, str]]) -> None:
    if pairs:
        group = ElementTree.SubElement(parent, "properties")
        for name, value in pairs:
            ElementTree.SubElement(group, "property", name=name, value=_clean(value))


def _clean(text: str) -> str:
    """Without the characters that XML 1.0 cannot hold."""
    return _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)
