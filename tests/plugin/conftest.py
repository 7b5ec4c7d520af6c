# ruff: noqa: E501
"""An author's repository: ``mine`` behind the contract, one class for each way in which a verdict can go."""

from __future__ import annotations

import importlib.util
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import nros_conformance.plugin.session  # noqa: F401 - pytester forgets what was imported during a run
from nros_conformance.judge.invariants import INVARIANTS
from nros_conformance.suite.loader import REQUIREMENTS, shipped_suites

ADAPTER = '''
import dataclasses

from nros_backends.reference.backend import ReferenceBackend, ReferenceSession
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.events import CountStatus, EventKind
from nros_conformance.rmw.qos import Reliability


class Mine(ReferenceBackend):
    """All is well."""


class CountsTwice(Mine):
    """MessageLost doubles its total."""

    def create_session(self, options):
        return _CountingTwice(self, options)


class _CountingTwice(ReferenceSession):
    def create_subscription(self, topic, type_name, qos):
        made = super().create_subscription(topic, type_name, qos)
        register = made.register_event

        def twice(kind, deadline_ms, callback, context):
            def call(kind, status, context):
                callback(kind, CountStatus(status.total_count * 2, status.total_count_change * 2), context)
            doubled = callback is not None and kind == EventKind.MESSAGE_LOST
            return register(kind, deadline_ms, call if doubled else callback, context)

        made.register_event = twice
        return made


class Slow(Mine):
    """Publishing takes a second, so no stimulus ever happens in time."""

    def create_session(self, options):
        return _Slow(self, options)


class _Slow(ReferenceSession):
    def create_publisher(self, topic, type_name, qos):
        made = super().create_publisher(topic, type_name, qos)
        publish = made.publish_raw

        def slowly(data):
            self.clock.wait(None, self.clock.now_ns() + 1000 * MS)
            return publish(data)

        made.publish_raw = slowly
        return made


class Lenient(Mine):
    """Promises RELIABLE whatever is asked for, which violates a should."""

    def create_session(self, options):
        return _Lenient(self, options)


class _Lenient(ReferenceSession):
    def create_publisher(self, topic, type_name, qos):
        return super().create_publisher(topic, type_name, dataclasses.replace(qos, reliability=Reliability.RELIABLE))
'''


SUITE = """\
suite: sample
title: A few scenarios, so that each run is short
scenarios:
  - id: sample.overflow
    title: What a full queue had no room for is counted
    for: {depth: [1, 4]}
    entities:
      talker: {publisher: sensor}
      listener: {subscription: sensor, qos: {depth: $depth}}
    script: [settle, {do: publish, by: talker, times: 20, as: burst}, {drive: 1T}, {do: take, from: listener}, {drive: 1T}]
    expect:
      - {conserved: listener, from: [talker], proves: [MSL-001, MSL-005]}
  - id: sample.refused
    title: MessageLost is refused
    refusal: MessageLost
    entities:
      listener: {subscription: sensor, register: none}
    script: [{do: supports, of: listener, kind: MessageLost, as: asked}, {drive: 1T}]
    expect:
      - {returns: asked, is: [false], proves: REG-002}
  - id: rdm.silence-after-data
    title: One miss per elapsed period after the last sample
    entities:
      talker: {publisher: sensor}
      listener: {subscription: sensor, registration_deadline: 1T}
    script: [settle, {do: publish, by: talker, every: 0.4T, times: 5, as: data}, {drive: 3.5T, as: silence}]
    given:
      - {gap: data, max: 0.9T}
    expect:
      - {periodic: RequestedDeadlineMissed, of: listener, every: 1T, since: data.last, until: silence.end, proves: RDM-001}
  - id: sample.pair
    title: Best effort offered and reliable asked for is refused, or gives no data
    entities:
      talker: {publisher: sensor, qos: {reliability: best_effort}, may_fail: true}
      listener: {subscription: sensor, qos: {reliability: reliable}, take: always, may_fail: true}
    script: [{drive: discovery_bound}, {do: publish, by: talker, times: 3, as: data}, {drive: 0.5T}]
    expect:
      - {received: data, of: listener, is: none, proves: QOS-006}
"""


def declaration(**replaced: str) -> str:
    """The reference's, as somebody else's backend."""
    spec = importlib.util.find_spec("nros_backends.reference")
    assert spec is not None
    assert spec.origin is not None
    text = (Path(spec.origin).parent / "backend.toml").read_text(encoding="utf-8")
    head, _, rest = text.partition("control = true\n")
    before, _, after = rest.partition("[[planted]]")
    text = head + before + after[after.index("[events.") :]
    for old, new in {'"reference"': '"mine"', '"Reference"': '"Mine"', **replaced}.items():
        text = text.replace(old, new)
    return text


def catalogue(suite: str) -> str:
    """The shipped requirements that a suite names, and those of the invariants: reading all takes a third of a second."""
    head, *entries = re.split(
        r"(?=^  - id: )", (shipped_suites() / REQUIREMENTS).read_text(encoding="utf-8"), flags=re.M
    )
    ids = {*re.findall(r"[A-Z]{3}-\d{3}", suite), *(law.proves for law in INVARIANTS)}
    return head + "".join(one for one in entries if one[8:15] in ids)


@pytest.fixture
def author(pytester: pytest.Pytester) -> Iterator[pytest.Pytester]:
    """A directory with the package ``mine`` and nothing else."""
    pytester.mkpydir("mine").joinpath("__init__.py").write_text(ADAPTER, encoding="utf-8")
    pytester.path.joinpath("mine", "backend.toml").write_text(declaration(), encoding="utf-8")
    suites = pytester.mkdir("suites")
    suites.joinpath("sample.yaml").write_text(SUITE, encoding="utf-8")
    suites.joinpath("requirements.yaml").write_text(catalogue(SUITE), encoding="utf-8")
    pytester.syspathinsert()
    yield pytester
    for name in [name for name in sys.modules if name == "mine" or name.startswith("mine.")]:
        del sys.modules[name]  # each test has its own
