"""A host that is well, and suites whose evidence hangs on what a host can do."""

from __future__ import annotations

from pathlib import Path

from nros_conformance.campaign.host import HostCheck
from nros_conformance.suite.loader import Suites, load_suites

CALM = HostCheck(cores=2, median_ms=0.31, worst_ms=4.12, seconds=2.0)

SUITE = """\
suite: sample
title: A sample
scenarios:
  - id: sample.step
    title: The wall clock is stepped
    sessions: {sub: {process: own}}
    entities: &entities
      talker: {publisher: sensor, qos: {deadline: 1T}}
      listener: {subscription: sensor, qos: {deadline: 1T}}
    script: [settle, {do: publish, by: talker, as: data}, {fault: clock_step, of: sub, by: 1s}, {drive: 2T}]
    expect:
      - {never: RequestedDeadlineMissed, of: listener, until: data.last, proves: [RDM-006, RDM-002]}
  - id: sample.quiet
    title: Nothing is stepped
    entities: *entities
    script: [settle, {do: publish, by: talker, as: data}, {drive: 2T}]
    expect:
      - {never: RequestedDeadlineMissed, of: listener, until: data.last, proves: RDM-002}
  - id: sample.crash
    title: A publisher dies
    sessions: {pub: {process: own}}
    entities: *entities
    script: [settle, {fault: crash, of: pub, as: gone}, {drive: 2T}]
    expect:
      - {level: alive_count, of: listener, is: 0, by: gone.end + 1T, proves: [LVC-004, LVC-001]}
"""


def suites_of_faults(directory: Path) -> Suites:
    """A wall clock that is stepped, a process that dies, and a scenario that needs neither."""
    (directory / "sample.yaml").write_text(SUITE, encoding="utf-8")
    return load_suites(directory)
