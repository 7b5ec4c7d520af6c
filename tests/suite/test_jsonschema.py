from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema  # type: ignore[import-untyped]
import pytest

from nros_conformance.formats.durations import DURATION_PATTERN, QUANTITIES, UNITS_NS, Duration
from nros_conformance.formats.yaml12 import read_yaml
from nros_conformance.suite import schema
from nros_conformance.suite.jsonschema import COMMAND, FILE, build, main, text
from nros_conformance.suite.loader import PUBLISHED, REQUIREMENTS, shipped_suites

SUITES = sorted(file for file in shipped_suites().glob("*.yaml") if file.name not in (PUBLISHED, REQUIREMENTS))

SUITE = """\
suite: sample
title: A sample
scenarios:
  - id: rdm.sample
    title: A sample with $n
    profile: smoke
    for:
      n: [1, 3]
      qos: {plain: {}, deep: {depth: 5}}
    needs: {claims: [$kind], declares: {callback_cap: true}}
    sessions: {far: {process: own, when: {n: 1}}}
    entities:
      talker: {publisher: sensor, qos: $qos, count: $n, session: far}
      listener: {$side: sensor, qos: {deadline: infinite, lease: 3T + tolerance}, unless: {n: 3}}
    script:
      - settle
      - $step
      - {do: $noise, by: talker, times: 3}
      - {do: publish, by: 'talker[0]', times: $n, every: 0.4T, as: data-$n, when: {n: [1, 3]}}
      - parallel:
        - [settle, {drive: 2 * connection_lease}]
        - [{fault: clock_step, of: far, by: -3600s, at: data.last + 1T}]
      - {do: drive, timeout: 0, as: call}
    given:
      - {gap: data, max: 0.9T}
      - {returns: data, is: [OK, true]}
    expect:
      - {never: ANY, of: ALL, until: 'talker[0].LivelinessLost[-1]', proves: RDM-001}
      - {never: [MessageLost], of: [listener], proves: [RDM-001, RDM-002], when: {n: 1}}
      - proves: RDM-001
        any_of:
          - [{returns: data, is: [ANY_ERROR]}, {total: MessageLost, of: listener, is: $n}]
          - [{any_of: [[{takes: call, at_most: 1T}]], proves: RDM-002}]
"""


@pytest.fixture(scope="module")
def validator() -> jsonschema.Draft202012Validator:
    return jsonschema.Draft202012Validator(build())


def plain(source: str) -> Any:
    return read_yaml(Path("sample.yaml"), source).data


def test_the_schema_in_the_repository_is_the_generated_one() -> None:
    file = shipped_suites() / FILE
    assert file.read_text(encoding="utf-8") == text(), f"suites/{FILE} is out of date: run {COMMAND}"


def test_the_command_writes_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("nros_conformance.suite.jsonschema.shipped_suites", lambda: tmp_path)
    main()
    assert (tmp_path / FILE).read_text(encoding="utf-8") == text()
    assert capsys.readouterr().out == f"written: {tmp_path / FILE}\n"


def test_the_schema_is_one() -> None:
    jsonschema.Draft202012Validator.check_schema(build())


@pytest.mark.parametrize("file", SUITES, ids=[file.stem for file in SUITES])
def test_the_suites_are_valid(file: Path, validator: jsonschema.Draft202012Validator) -> None:
    error = jsonschema.exceptions.best_match(validator.iter_errors(read_yaml(file).data))
    assert error is None, f"{list(error.absolute_path)}: {error.message}"


def test_all_notations_are_valid(validator: jsonschema.Draft202012Validator) -> None:
    error = jsonschema.exceptions.best_match(validator.iter_errors(plain(SUITE)))
    assert error is None, f"{list(error.absolute_path)}: {error.message}"


@pytest.mark.parametrize(
    ("good", "bad"),
    [
        ("suite: sample", "siute: sample"),
        ("suite: sample", "suite: $n"),
        ("id: rdm.sample", "id: rdm"),
        ("profile: smoke", "profile: smoky"),
        ("    title: A sample with $n\n", ""),
        ("      n: [1, 3]\n", "      n: 1\n"),
        ("      n: [1, 3]\n", "      n: []\n"),
        ("declares:", "declare:"),
        ("process: own", "process: mine"),
        ("count: $n", "count: many"),
        ("deadline: infinite", "deadline: 3 weeks"),
        ("lease: 3T + tolerance", "lease: 3T + tolerence"),
        ("unless: {n: 3}", "unless: {}"),
        ("- settle\n      - $step", "- setle\n      - $step"),
        ("{drive: 2 * connection_lease}", "{drive: 2}"),
        ("{drive: 2 * connection_lease}", "{driv: 2T}"),
        ("by: 'talker[0]'", "by: 'talker[x]'"),
        ("at: data.last + 1T", "at: data.lst + 1T"),
        ("fault: clock_step", "fault: clock_stop"),
        ("{do: drive, timeout: 0, as: call}", "{do: drive, as: call}"),
        ("is: [OK, true]", "is: [OKAY]"),
        ("{gap: data, max: 0.9T}", "{gap: data, mx: 0.9T}"),
        ("of: ALL, until: 'talker[0].LivelinessLost[-1]', proves: RDM-001", "of: ALL"),
        ("never: [MessageLost]", "never: [MessageLoss]"),
        ("total: MessageLost, of: listener, is: $n", "total: MessageLost, of: listener, ist: 1"),
        ("takes: call, at_most: 1T", "takes: call, at_most: 1X"),
    ],
)
def test_a_typo_is_not_valid(validator: jsonschema.Draft202012Validator, good: str, bad: str) -> None:
    assert SUITE.count(good) == 1
    assert not validator.is_valid(plain(SUITE.replace(good, bad)))


def test_every_head_is_in_it() -> None:
    definitions = build()["$defs"]
    for types in (schema.STEPS, schema.DOINGS, schema.GIVENS, schema.EXPECTATIONS):
        for type_ in types.values():
            assert type_.__name__ in definitions


def test_docstrings_describe_types_and_fields() -> None:
    definitions = build()["$defs"]
    assert definitions["Publish"]["description"] == "`publish_raw` with the next sequence number of that publisher."
    assert definitions["Publish"]["properties"]["size"]["description"] == (
        "Bytes of the serialized sample, when it matters. One of 0 bytes cannot say who sent it."
    )
    at = "Begin at this moment instead of after the step before."  # of a field that Publish inherits
    assert definitions["Publish"]["properties"]["at"]["description"] == at


@pytest.mark.parametrize("unit", [*UNITS_NS, *QUANTITIES])
def test_the_pattern_of_durations_knows_every_unit(unit: str) -> None:
    validator = jsonschema.Draft202012Validator({"pattern": DURATION_PATTERN})
    for written in (f"2{unit}", f"0.5 * {unit}", f"-1{unit}", f"1T - 3 {unit} + 2ms"):
        Duration.parse(written)
        assert validator.is_valid(written), written
    assert not validator.is_valid(f"2{unit}x")


def test_the_file_is_plain_json() -> None:
    assert json.loads(text()) == build()
