"""``nros-conformance list``."""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import msgspec

from nros_conformance.cli.codes import ExitCode
from nros_conformance.formats.places import FormatError
from nros_conformance.rmw.discovery import find_backends
from nros_conformance.suite.loader import Suites, load_suites
from nros_conformance.suite.walk import expectations


def run(options: argparse.Namespace) -> ExitCode:
    """Print one of the four lists."""
    if options.what == "backends":
        rows = _backends()
        heads: tuple[str, ...] = ("name", "state", "what runs")
    else:
        suites = load_suites(options.suites)
        lists = {"suites": _suites, "scenarios": _scenarios, "requirements": _requirements}
        rows = lists[options.what](suites)
        heads = {
            "suites": ("suite", "scenarios", "file"),
            "scenarios": ("scenario", "profile", "title"),
            "requirements": ("requirement", "level", "scenarios", "statement"),
        }[options.what]
    if options.json:
        print(msgspec.json.format(msgspec.json.encode(rows), indent=1).decode())
        return ExitCode.OK
    _table(heads, rows)
    if options.what == "requirements" and options.coverage:
        print("\n" + coverage(suites))
    return ExitCode.OK


def proving(suites: Suites) -> dict[str, list[str]]:
    """Requirement -> ids of the scenarios with an expectation that proves it."""
    found: dict[str, list[str]] = defaultdict(list)
    for one in suites.scenarios:
        for _, expectation in expectations(one.scenario):
            for id_ in expectation.requirements:
                if one.scenario.id not in found[id_]:
                    found[id_].append(one.scenario.id)
    return found


def coverage(suites: Suites) -> str:
    """How many requirements have a scenario, and which have none."""
    found = proving(suites)
    without = [one.id for one in suites.requirements if one.id not in found]
    total = len(suites.levels)
    text = f"{total - len(without)} of {total} requirements have a scenario"
    return text + (f"; without: {', '.join(without)}" if without else "")


def _backends() -> list[dict[str, Any]]:
    rows = []
    for name, found in find_backends().items():
        if found.declaration is None:
            rows.append({"name": name, "state": "broken", "what runs": str(found.error)})
            continue
        try:
            lacking = found.unavailable()
        except FormatError as error:
            rows.append({"name": name, "state": "broken", "what runs": str(error)})
            continue
        state = "ready" if lacking is None else "missing"
        subject = found.declaration.subject
        what = f"{subject.kind}: {subject.says}" if lacking is None else str(lacking)
        rows.append({"name": name, "state": state, "what runs": what})
    return rows


def _suites(suites: Suites) -> list[dict[str, Any]]:
    files: dict[str, list[str]] = defaultdict(list)
    for one in suites.scenarios:
        files[one.suite].append(one.source.rpartition(":")[0])
    return [{"suite": name, "scenarios": len(places), "file": places[0]} for name, places in files.items()]


def _scenarios(suites: Suites) -> list[dict[str, Any]]:
    return [
        {"scenario": one.key, "profile": one.scenario.profile, "title": one.scenario.title} for one in suites.scenarios
    ]  # fmt: skip


def _requirements(suites: Suites) -> list[dict[str, Any]]:
    found = proving(suites)
    return [
        {"requirement": one.id, "level": one.level, "scenarios": len(found.get(one.id, ())), "statement": one.statement}
        for one in suites.requirements
    ]


def _table(heads: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    texts = [[str(row[head]) for head in heads] for row in rows]
    widths = [max(len(head), *(len(row[i]) for row in texts)) if texts else len(head) for i, head in enumerate(heads)]
    for line in (list(heads), *texts):
        print("  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip())
