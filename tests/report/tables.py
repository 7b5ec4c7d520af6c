"""Published tables, the one shipped here and a small one, and reports to put beside them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from nros_conformance.report.results import Report
from nros_conformance.rmw.events import EventKind
from nros_conformance.suite.loader import shipped_suites
from nros_conformance.suite.published import Published, load_published, read_published
from tests.report.build import LVC, LVL, MSL, REFUSED, REQUIREMENTS, canonical, declare, everything, report

NEWS = "https://github.com/NEWSLabNTU/nano-ros/blob/9a7a150ce7edaf319182f9fda763c529e225cb1d"
SMALL = """\
name: the book
revision: abc1234
link: https://example.org/abc1234/table.md
subject: {says: their own backends, kinds: [compiled]}
legend:
  works: {mark: x, says: it works, means: works}
  never: {mark: "-", says: it does not, means: absent}
backends:
  - backend: demo
    title: Demo
    cells:
      LivelinessChanged: {word: works, remark: polled}
      RequestedDeadlineMissed:
        word: works
        remark: only on take
        details:
          - {about: where, holds: RDM-001, observed: anywhere}
      MessageLost: {word: never, remark: not wired}
      LivelinessLost: {word: never, remark: not wired}
      OfferedDeadlineMissed: {word: never, remark: not wired}
"""


def shipped() -> Published:
    found = load_published(shipped_suites(), REQUIREMENTS)
    assert found is not None
    return found


def small() -> Published:
    return read_published(Path("p.yaml"), SMALL, REQUIREMENTS)


def xrce(**fields: Any) -> Report:
    declaration = declare(
        "xrce", title="XRCE-DDS", kind="protocol", events=dict.fromkeys((LVC, LVL, MSL), REFUSED), **fields
    )  # fmt: skip
    return report(declaration, everything(declaration))


def demo(kind: str = "library", *results: Any, events: Any = None, name: str = "demo", variant: str = "") -> Report:
    declaration = declare(name, kind=kind, events=events)
    return report(declaration, [*everything(declaration), *results], variant=variant)


def with_canonical(one: Report, kind: EventKind, outcome: Any) -> Report:
    kept = [each for each in one.results if each.canonical != kind.label]
    new = canonical(kind, status="untested", reason="no wire") if outcome == "untested" else canonical(kind, outcome)
    return msgspec.structs.replace(one, results=(*kept, new))
