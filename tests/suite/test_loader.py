from __future__ import annotations

import contextlib
import copy
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from nros_conformance.formats.places import Document, FormatError
from nros_conformance.formats.yaml12 import read_yaml
from nros_conformance.suite import schema
from nros_conformance.suite.check import check
from nros_conformance.suite.expand import expand
from nros_conformance.suite.heads import read_scenario
from nros_conformance.suite.loader import Loaded, Suites, load_suites, shipped_suites, typed

Load = Callable[..., Suites]
Scenarios = Callable[[str], tuple[Loaded, ...]]

SUITE = """\
suite: {name}
title: A sample
scenarios:
  - id: {name}.one
    title: First
    entities: {{listener: {{subscription: sensor}}}}
    script: [settle]
    expect: [{{never: ANY, of: ALL, proves: RDM-001}}]
  - id: {name}.two
    title: Second
    for: {{n: [1, 2]}}
    entities: {{listener: {{subscription: sensor}}}}
    script: [{{drive: $n * T}}]
    expect: [{{never: ANY, of: ALL, proves: [RDM-001, RDM-002]}}]
"""

EVERYTHING = """\
  - id: rdm.everything
    title: All that a scenario may hold
    profile: smoke
    scale: {T: 200ms}
    needs: {claims: [MessageLost], declares: {callback_cap: true}, clock: real, process: own}
    canonical: RequestedDeadlineMissed
    sessions: {far: {process: own, may_fail: true}}
    entities:
      crowd: {publisher: sensor, session: far, count: 3, qos: {liveliness: manual_by_topic, lease: infinite}}
      late: {subscription: sensor, deferred: true, may_fail: true, register: [MessageLost]}
      listener: {subscription: sensor, qos: {deadline: 0, depth: 4}, registration_deadline: 1T}
    script:
      - settle
      - {do: create, entity: late, as: come, at: start + 1T}
      - {do: publish, by: crowd, times: 2, every: 0.5T, as: data}
      - parallel:
        - [{idle: 1T}, {do: assert, by: 'crowd[1]'}]
        - [{fault: freeze, of: far, for: 2T, as: gone}, {do: has_data, of: listener, as: asked}]
      - {do: register, of: listener, kind: 255, callback: none, deadline: infinite, as: registered}
      - {do: supports, of: listener, kind: MessageLost, as: supported}
      - {do: drive, timeout: 0, as: call}
      - {phase: 1T}
      - {cycle: 2, as: turns, script: [{do: has_data, of: listener, as: turned}]}
      - {do: measure, what: cpu, as: before}
      - {do: measure, what: cpu, as: after}
      - {do: spin, session: far, timeout: 1T, cap: 1, times: 4, as: spins}
      - {do: take, from: listener, max: 1}
      - {do: destroy, of: far}
      - {do: destroy, of: late}
    given:
      - {gap: data, max: 0.9T, min: 1ms}
      - {returns: come, is: [OK]}
      - {driven: sub, max: 0.2T, until: data.last}
    expect:
      - {never: [MessageLost, LivelinessChanged], of: [listener, late], from: 'data[5].end', proves: RDM-001}
      - {never: LivelinessLost, of: crowd, until: 'crowd[2].LivelinessLost[-1] - 1T', proves: RDM-001}
      - {periodic: RequestedDeadlineMissed, of: listener, every: 1T, since: data.last, until: gone.end, proves: RDM-001}
      - {total: MessageLost, of: listener, at_least: 0, at_most: 3, proves: RDM-002}
      - {level: alive_count, of: [listener], is: 3, by: 'crowd[0].settled + discovery_bound', proves: LVC-001}
      - {level: not_alive_count, of: listener, is: 0, from: start.settled, until: end, proves: LVC-001}
      - {returns: asked, is: [true, false, DATA, ANY_ERROR], some: true, proves: RDM-001}
      - {returns: late, is: [OK, INCOMPATIBLE_QOS], proves: RDM-001}
      - {returns: far, is: [OK], proves: RDM-001}
      - {agrees: supported, with: registered, proves: RDM-001}
      - {admitted: late, proves: RDM-001}
      - {measured: cpu, from: before, to: after, at_most: 0.5T, proves: RDM-002}
      - {cycles: turns, step: turned, is: [OK], proves: RDM-002}
      - {counted: after, since: before, at_least: 0, at_most: 3, proves: RDM-002}
      - {received: data, of: listener, is: 2, proves: RDM-001}
      - {conserved: listener, from: [crowd], since: data, proves: RDM-001}
      - {inside: spins, event: LivelinessChanged, of: listener, status: {alive_count: 3}, proves: RDM-001}
      - {callback: registered, is: never, kind: MessageLost, context: x, proves: RDM-001}
      - {callbacks: spins, counting: [events], each: true, at_most: 1, proves: RDM-001}
      - {takes: call, at_most: tolerance, proves: RDM-001}
      - proves: [RDM-001, RDM-002]
        any_of:
          - [{never: ANY, of: ALL}, {takes: spins, at_least: 1T, proves: LVC-001}]
          - [{returns: spins, is: [ANY_ERROR]}]
"""


@pytest.fixture
def everything(scenarios: Scenarios) -> Loaded:
    (loaded,) = scenarios(EVERYTHING)
    return loaded


def test_scenarios_come_in_the_order_of_files(load: Load) -> None:
    suites = load(b=SUITE.format(name="beta"), a=SUITE.format(name="alpha"))
    assert [(one.key, one.suite, one.source) for one in suites.scenarios] == [
        ("alpha.one", "alpha", "suites/a.yaml:4"),
        ("alpha.two[n=1]", "alpha", "suites/a.yaml:9"),
        ("alpha.two[n=2]", "alpha", "suites/a.yaml:9"),
        ("beta.one", "beta", "suites/b.yaml:4"),
        ("beta.two[n=1]", "beta", "suites/b.yaml:9"),
        ("beta.two[n=2]", "beta", "suites/b.yaml:9"),
    ]
    assert suites.version == "1.0"
    assert suites.directory.name == "suites"
    assert suites.levels == {"RDM-001": "must", "RDM-002": "should", "LVC-001": "must"}
    assert len(suites.requirements) == 3


def test_all_parts_are_typed(everything: Loaded) -> None:
    scenario = everything.scenario
    assert all(isinstance(step, schema.Step) for step in scenario.script)
    parallel = scenario.script[3]
    assert isinstance(parallel, schema.Parallel)
    assert [type(step) for branch in parallel.parallel for step in branch] == [
        schema.Idle, schema.Assert, schema.Fault, schema.HasData
    ]  # fmt: skip
    assert [type(given) for given in scenario.given] == [schema.GapGiven, schema.ReturnsGiven, schema.DrivenGiven]
    assert {type(one) for one in scenario.expect} == set(schema.EXPECTATIONS.values())
    any_of = scenario.expect[-1]
    assert isinstance(any_of, schema.AnyOf)
    assert [[one.requirements for one in group] for group in any_of.any_of] == [
        [("RDM-001", "RDM-002"), ("LVC-001",)],
        [("RDM-001", "RDM-002")],
    ]


def test_a_bare_word_is_a_doing(everything: Loaded) -> None:
    assert everything.scenario.script[0] == schema.Settle(do="settle")
    assert everything.raw["script"][0] == {"do": "settle"}


def test_true_and_false_are_answers(everything: Loaded) -> None:
    assert everything.raw["expect"][6]["is"] == ["true", "false", "DATA", "ANY_ERROR"]


def test_raw_data_survives_json_and_is_the_same_scenario_again(everything: Loaded) -> None:
    assert typed(json.loads(json.dumps(everything.raw))) == everything.scenario


def test_raw_data_leaves_out_what_is_default(everything: Loaded) -> None:
    assert everything.raw["entities"]["listener"] == {
        "subscription": "sensor",
        "qos": {"depth": 4, "deadline": "0"},
        "registration_deadline": "1T",
    }


def test_typed_takes_the_notation_of_suites() -> None:
    scenario = typed(
        {
            "id": "rdm.by-hand",
            "title": "By hand",
            "entities": {"listener": {"subscription": "sensor"}},
            "script": ["settle", {"do": "has_data", "of": "listener", "as": "asked"}],
            "expect": [{"any_of": [[{"returns": "asked", "is": [True]}]], "proves": "RDM-001"}],
        }
    )
    assert scenario.script[0] == schema.Settle(do="settle")
    assert scenario.expect[0].any_of[0][0] == schema.Returns(returns="asked", is_=["true"], proves="RDM-001")


def test_typed_names_what_it_was_given() -> None:
    with pytest.raises(FormatError) as caught:
        typed({"id": "rdm.x", "title": "X", "entities": {}, "script": [{"driv": "1T"}], "expect": []}, "trace.jsonl")
    assert str(caught.value) == "trace.jsonl: unknown head 'driv' of a step; did you mean 'drive'?"


def test_typed_is_fast(everything: Loaded) -> None:
    def once() -> float:
        begin = time.perf_counter()
        typed(everything.raw)
        return time.perf_counter() - begin

    # The fastest of many: a busy host makes single ones slow. Measured: 0.2 ms for this overfull scenario.
    assert min(once() for _ in range(50)) < 0.001


# --- the digest -----------------------------------------------------------------------------------


def test_the_digest_does_not_depend_on_the_layout(load: Load) -> None:
    one = load(a=SUITE.format(name="alpha"), b=SUITE.format(name="beta")).digest
    again = SUITE.replace("script: [settle]", "script:\n      - do: settle   # matched").replace(
        "title: First\n", "title: 'First'\n"
    )
    other = load(a=again.format(name="beta"), b="# moved\n" + SUITE.format(name="alpha")).digest
    assert one == other
    assert one.startswith("sha256:")
    assert len(one) == 71


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("[1, 2]", "[1, 3]"),
        ("title: First", "title: Last"),
        ("ANY, of: ALL, proves: RDM-001", "ANY, of: ALL, proves: RDM-002"),
    ],
)
def test_the_digest_depends_on_what_is_said(load: Load, old: str, new: str) -> None:
    assert old in SUITE
    before = load(a=SUITE.format(name="alpha")).digest
    assert load(a=SUITE.replace(old, new).format(name="alpha")).digest != before


def test_the_digest_depends_on_the_catalogue(load: Load, tmp_path: Path) -> None:
    before = load(a=SUITE.format(name="alpha"))
    file = tmp_path / "suites" / "requirements.yaml"
    file.write_text(file.read_text().replace("level: should", "level: must"))
    assert load_suites(before.directory).digest != before.digest


# --- files that cannot be used --------------------------------------------------------------------


def failure(directory: Path) -> str:
    with pytest.raises(FormatError) as caught:
        load_suites(directory)
    return str(caught.value)


def test_no_directory(tmp_path: Path) -> None:
    assert failure(tmp_path / "nowhere") == f"{tmp_path}/nowhere: no such directory"


def test_no_suite_files(tmp_path: Path) -> None:
    (tmp_path / "requirements.yaml").write_text("")
    (tmp_path / "notes.txt").write_text("")
    assert failure(tmp_path) == f"{tmp_path}: no suite files here; suites are files that end in .yaml"


FILES = [
    ("", "1: the file is empty"),
    ("# nothing\n", "1: the file is empty"),
    ("suite: [", "1: not YAML: while parsing a flow node, expected the node content, but found '<stream end>'"),
    ("suite: sample\nsuite: sample\n", "2: the key 'suite' stands here twice; the first is in line 1"),
    ("- a\n", "1: value: expected `object`, got `array`"),
    ("suite: sample\ntitel: X\n", "2: unknown key 'titel'; did you mean 'title'?"),
    ("suite: Sample\ntitle: X\nscenarios: []\n", "1: suite: 'Sample' does not have the form ^[a-z_]+$"),
    ("suite: sample\ntitle: X\n", "1: the key 'scenarios' is missing; add scenarios: ..."),
    ("suite: sample\ntitle: X\nscenarios: []\n", "3: the suite has no scenarios; add one or more"),
    (
        "suite: sample\ntitle: X\nscenarios: [one]\n",
        "3: 'one' is not a scenario; a scenario is a mapping with id:, title:, ...",
    ),
]


@pytest.mark.parametrize(("text", "expected"), FILES)
def test_files_that_are_no_suites(load: Load, text: str, expected: str) -> None:
    with pytest.raises(FormatError) as caught:
        load(sample=text)
    assert str(caught.value) == f"suites/sample.yaml:{expected}"


def test_a_file_that_is_no_text(load: Load, tmp_path: Path) -> None:
    load(a=SUITE.format(name="alpha"))
    (tmp_path / "suites" / "b.yaml").write_bytes(b"suite: \xff\n")
    assert failure(tmp_path / "suites") == (
        "suites/b.yaml: cannot be read: 'utf-8' codec can't decode byte 0xff in position 7: invalid start byte"
    )


def test_an_id_twice_in_one_file(load: Load) -> None:
    text = SUITE.format(name="alpha").replace("alpha.two", "alpha.one")
    with pytest.raises(FormatError) as caught:
        load(a=text)
    assert str(caught.value) == "suites/a.yaml:9: the scenario alpha.one stands twice; the first is at suites/a.yaml:4"


def test_an_id_twice_in_two_files(load: Load) -> None:
    with pytest.raises(FormatError) as caught:
        load(a=SUITE.format(name="alpha"), b=SUITE.format(name="beta").replace("beta.two", "alpha.one"))
    assert str(caught.value) == "suites/b.yaml:9: the scenario alpha.one stands twice; the first is at suites/a.yaml:4"


def test_a_suite_twice(load: Load) -> None:
    with pytest.raises(FormatError) as caught:
        load(a=SUITE.format(name="alpha"), b=SUITE.format(name="alpha"))
    assert str(caught.value) == "suites/b.yaml:1: there is another suite 'alpha'; one file for each"


# --- where the shipped ones lie -------------------------------------------------------------------


def test_the_shipped_suites_lie_beside_the_package_in_a_checkout() -> None:
    assert shipped_suites() == Path(__file__).parents[2] / "suites"


def test_a_directory_without_a_catalogue_uses_the_shipped_one(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(SUITE.format(name="alpha"))
    assert len(load_suites(tmp_path).requirements) == 90


def test_the_shipped_suites_lie_within_the_package_in_a_wheel(tmp_path: Path) -> None:
    package = tmp_path / "nros_conformance"
    shutil.copytree(Path(__file__).parents[2] / "nros_conformance", package)
    (package / "suites").mkdir()
    shutil.copy(shipped_suites() / "requirements.yaml", package / "suites")
    (package / "suites" / "a.yaml").write_text(SUITE.format(name="alpha"))
    script = "from nros_conformance.suite.loader import load_suites as l; s = l(); print(s.directory, len(s.scenarios))"
    path = {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, env=path, capture_output=True, text=True, check=True
    )
    assert done.stdout == f"{package / 'suites'} 3\n"


def test_the_shipped_suites_load() -> None:
    suites = load_suites()
    assert len({one.key for one in suites.scenarios}) == len(suites.scenarios)
    for one in suites.scenarios:
        assert typed(one.raw, one.key) == one.scenario


# --- anything at all ------------------------------------------------------------------------------


def places(data: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield path
    for key in data if isinstance(data, dict) else range(len(data)) if isinstance(data, list) else ():
        yield from places(data[key], (*path, key))


@pytest.mark.parametrize(
    "junk", [None, True, -1, 10**30, "x", "$x", "1T", [], ["x"], {}, {"do": ["x"]}, {"when": {"x": 1}}], ids=repr
)
def test_whatever_stands_somewhere_else_is_read_or_refused(load: Load, tmp_path: Path, junk: object) -> None:
    requirements = load(sample=f"suite: sample\ntitle: X\nscenarios:\n{EVERYTHING}").requirements
    whole = read_yaml(tmp_path / "suites" / "sample.yaml").data["scenarios"][0]
    for path in places(whole):
        data = copy.deepcopy(whole)
        if path:
            inner = data
            for key in path[:-1]:
                inner = inner[key]
            inner[path[-1]] = junk
        document = Document("sample.yaml", data, {})
        with contextlib.suppress(FormatError):  # anything else fails the test
            for expanded in expand(document, (), data):
                check(expanded.document, read_scenario(expanded.document), requirements)
