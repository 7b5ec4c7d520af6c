"""The pytest plugin as an author meets it: pytest in processes of its own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from xml.etree import ElementTree

import pytest

from nros_conformance.cli.main import main
from nros_conformance.report.results import read_report
from nros_conformance.suite.loader import load_suites
from tests.plugin.conftest import declaration

pytest_plugins = ["pytester"]

LOST, TWICE = "sample.overflow[depth=4]", "mine:CountsTwice"
SILENCE, PAIR = "rdm.silence-after-data", "sample.pair"
KNOWN = """\
[[known]]
key = "M1"
requirement = "{requirement}"
scenario = "sample.overflow"
cause = "adapter"
because = "it counts twice"
link = "unreported"
"""


def run(author: pytest.Pytester, *arguments: str) -> pytest.RunResult:
    quick = ("--assert=plain", "-p", "no:hypothesispytest")  # pytester compiles everything anew in each run
    return author.runpytest_inprocess(*quick, "-p", "no:cacheprovider", "--nros-suites", "suites", *arguments)


def test_nothing_is_imported_in_a_project_that_does_not_ask_for_it(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("def test_one(): pass")
    code = (
        "import sys, pytest\n"
        "assert pytest.main(['--collect-only', '-q', '-p', 'no:cacheprovider']) == 0\n"
        "print(sorted(name for name in sys.modules if name.startswith(('nros', 'msgspec', 'greenlet', 'ruamel'))))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=pytester.path)
    assert done.stdout.splitlines()[-1] == "['nros_conformance', 'nros_conformance.pytest_plugin']"


def test_scenarios_are_tests_with_stable_ids_that_can_be_given_back(author: pytest.Pytester) -> None:
    listed = run(author, "--nros-backend", "mine:Mine", "--collect-only", "-q")
    ids = [line for line in listed.outlines if "::" in line]
    assert ids == [
        "mine/backend.toml::sample.overflow[depth=1]",
        "mine/backend.toml::sample.overflow[depth=4]",
        "mine/backend.toml::sample.refused",
        "mine/backend.toml::rdm.silence-after-data",
        "mine/backend.toml::sample.pair",
        "mine/backend.toml::declaration",
    ]
    assert not author.path.joinpath(".nros-conformance").exists()
    run(author, "--nros-backend", "mine:Mine", ids[1], ids[4]).assert_outcomes(passed=2)


@pytest.mark.parametrize(("arguments", "names"), [
    (("-k", "MSL-005"), ["sample.overflow[depth=1]", "sample.overflow[depth=4]"]),
    (("-k", "should or silence"), ["rdm.silence-after-data", "sample.pair"]),
    (("-m", 'requirement(id="RDM-001")'), ["rdm.silence-after-data"]),
    (("-m", 'level(name="should") and suite(name="sample")'), ["sample.pair"]),
    (("-m", "not nros"), []),
])  # fmt: skip
def test_keywords_and_markers_select(author: pytest.Pytester, arguments: tuple[str, ...], names: list[str]) -> None:
    done = run(author, "--nros-backend", "mine:Mine", "--collect-only", "-q", "--strict-markers", *arguments)
    assert [line.partition("::")[2] for line in done.outlines if "::" in line] == names


@pytest.mark.parametrize("way", ["conftest", "ini"])
def test_a_conftest_or_the_configuration_can_name_the_backend(author: pytest.Pytester, way: str) -> None:
    author.makepyfile(test_zebra="def test_zebra(): pass")
    if way == "conftest":
        author.makeconftest('nros_backend = "mine:Mine"')
    else:
        author.makeini("[pytest]\nnros_backends = mine:Mine\ntestpaths = test_zebra.py")
    run(author, "-k", "sample.pair or zebra").assert_outcomes(passed=2, deselected=5)
    run(author, "test_zebra.py").assert_outcomes(passed=1)


def test_a_violation_is_told_by_its_timeline_and_nothing_else(author: pytest.Pytester) -> None:
    done = run(author, "--nros-backend", TWICE, f"mine/backend.toml::{LOST}")
    done.assert_outcomes(failed=1)
    assert done.ret == 1
    done.stdout.fnmatch_lines([
        "FAIL   sample.overflow?depth=4? on mine*attempt 1 of 1, a fail is final",
        "MSL-001 (must)*",
        "  from       SE MessageLost*",
        "Script   suites/sample.yaml:4*",
        "  publish times 20, by talker   (burst)",
        "Timeline   ms after the start",
        "*MessageLost total 32 (+32)*",
        "Judgement",
        "Again      nros-conformance run --backend mine:CountsTwice --scenario 'sample.overflow?depth=4?'",
        "Pytest     pytest 'mine/backend.toml::sample.overflow?depth=4?'",
    ])  # fmt: skip
    done.stdout.no_fnmatch_line("*items.py*")


def test_the_command_says_the_same(author: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(author.path)
    outcomes = {
        report.nodeid.partition("::")[2]: report.outcome
        for report in run(author, "--nros-backend", TWICE).reprec.getreports("pytest_runtest_logreport")  # type: ignore[attr-defined]
        if report.when == "call"
    }
    assert outcomes.pop("declaration") == "passed"
    assert main(["run", "--backend", TWICE, "--suites", "suites", "--results", "by-command"]) == 1
    theirs, ours = (read_report(author.path / where / "mine") for where in (".nros-conformance", "by-command"))
    assert [(one.key, one.status, one.verdict) for one in theirs.results] == [
        (one.key, one.status, one.verdict) for one in ours.results
    ]
    assert {one.verdict for one in ours.results} == {"pass", "fail", None}
    told = {"pass": "passed", "fail": "failed", None: "skipped"}
    assert outcomes == {one.key: told[one.verdict] for one in ours.results}
    assert (theirs.observations, theirs.differences) == (ours.observations, ours.differences)
    assert main(["explain", "mine", "sample.overflow[depth=4]"]) == 0  # traces are where the command looks


def collected(author: pytest.Pytester, *arguments: str) -> list[pytest.Item]:
    found: list[pytest.Item] = []

    class Collecting:
        def pytest_collection_finish(self, session: pytest.Session) -> None:
            found.extend(session.items)

    quiet = ("--collect-only", "-q", "-p", "no:cacheprovider", "-p", "no:hypothesispytest", "--nros-suites", "suites")
    assert author.inline_run(*quiet, *arguments, plugins=[Collecting()]).ret == 0
    return found


# VS Code shows an item in the file `path`, at the line of `location`, below its parents that are classes, and
# runs it again by its path and what follows in its id; PyCharm's runner takes id and location as they are.
def test_items_are_what_the_runners_of_ides_rely_on(author: pytest.Pytester) -> None:
    file = author.path.joinpath("mine", "backend.toml")
    lines = file.read_text(encoding="utf-8").splitlines()
    found = collected(author, "--nros-backend", "mine:Mine")
    assert len({item.nodeid for item in found}) == len(found) == 6
    for item in found:
        assert item.path == file
        assert item.nodeid.partition("::")[::2] == ("mine/backend.toml", item.name)
        assert item.location[0] == os.path.join("mine", "backend.toml")  # noqa: PTH118 - pytest's text
        assert all(parent.path.exists() for parent in item.listchain() if hasattr(parent, "path"))
        assert not hasattr(item, "callspec")
    at = {item.name: lines[item.location[1] or 0] for item in found}
    assert at == {
        "sample.overflow[depth=1]": "[events.MessageLost]",
        "sample.overflow[depth=4]": "[events.MessageLost]",
        "sample.refused": "[events.MessageLost]",
        "rdm.silence-after-data": "[events.RequestedDeadlineMissed]",
        "sample.pair": lines[0],  # the declaration has no [qos]
        "declaration": lines[0],
    }


def test_variants_are_a_level_of_their_own(author: pytest.Pytester) -> None:
    file = author.path.joinpath("mine", "backend.toml")
    variants = "".join(f'\n[variants.{name}]\ntitle = "{name}"\nsays = "as {name}"\n' for name in ("near", "far"))
    file.write_text(file.read_text(encoding="utf-8") + variants, encoding="utf-8")
    found = collected(author, "--nros-backend", "mine:Mine", "-k", "pair")
    assert [item.nodeid for item in found] == [
        "mine/backend.toml::near::sample.pair", "mine/backend.toml::far::sample.pair",
    ]  # fmt: skip
    assert [isinstance(item.parent, pytest.Class) and item.parent.path == file for item in found] == [True, True]
    run(author, "--nros-backend", "mine:Mine", found[0].nodeid).assert_outcomes(passed=1)


def test_no_two_scenarios_look_alike_where_a_runner_replaces_dots() -> None:
    keys = [one.key for one in load_suites().scenarios]
    assert len({re.sub(r"[./]", "_", key) for key in keys}) == len(keys)


def test_a_should_that_is_violated_is_a_warning(author: pytest.Pytester) -> None:
    done = run(author, "--nros-backend", "mine:Lenient", "-W", "default", f"mine/backend.toml::{PAIR}")
    done.assert_outcomes(passed=1, warnings=1)
    done.stdout.fnmatch_lines(["*ShouldViolation: mine sample.pair: QOS-006: *"])


def test_unclear_is_an_outcome_of_its_own_and_has_its_exit_code(author: pytest.Pytester) -> None:
    slow = ("--nros-backend", "mine:Slow", f"mine/backend.toml::{SILENCE}", "-v")
    done = run(author, *slow)
    done.stdout.fnmatch_lines([
        "mine/backend.toml::rdm.silence-after-data UNCLEAR*",
        "UNCLEAR mine/backend.toml::rdm.silence-after-data: given gap data: *; wanted *(1 attempt)",
        "*= 1 unclear in *",
    ])  # fmt: skip
    assert done.ret == 8
    assert run(author, *slow, "--nros-max-unclear", "1").ret == 0


def test_what_does_not_apply_is_skipped_with_the_reason(author: pytest.Pytester) -> None:
    done = run(author, "--nros-backend", "mine:Mine", "mine/backend.toml::sample.refused", "-rs")
    done.assert_outcomes(skipped=1)
    claim = (
        author.path.joinpath("mine", "backend.toml").read_text(encoding="utf-8").partition("[events.MessageLost]")[0]
    )
    line = claim.count("\n") + 1
    done.stdout.fnmatch_lines([f"SKIPPED * mine/backend.toml:{line}: not-applicable: MessageLost is claimed"])


def test_a_known_failure_is_expected(author: pytest.Pytester) -> None:
    known = "\n".join(KNOWN.format(requirement=one) for one in ("MSL-001", "MSL-005"))
    author.path.joinpath("known.toml").write_text(known, encoding="utf-8")
    done = run(author, "--nros-backend", TWICE, "--nros-known", "known.toml", "-rx", "-k", "overflow or declaration")
    done.assert_outcomes(xfailed=2, passed=1, deselected=3)
    done.stdout.fnmatch_lines(
        ["XFAIL mine/backend.toml::sample.overflow?depth=1? - [[]*known*]] M1: MSL-001, MSL-005: *"]
    )


def test_a_known_failure_that_holds_is_an_error(author: pytest.Pytester) -> None:
    author.path.joinpath("known.toml").write_text(KNOWN.format(requirement="MSL-001"), encoding="utf-8")
    done = run(author, "--nros-backend", "mine:Mine", "--nros-known", "known.toml", "-k", "overflow or declaration")
    done.assert_outcomes(failed=3, deselected=3)
    done.stdout.fnmatch_lines(["[[]*known*]] M1 (MSL-001, sample.overflow) holds; remove the entry"])


def test_a_known_failure_of_another_rule_excuses_nothing(author: pytest.Pytester) -> None:
    author.path.joinpath("known.toml").write_text(KNOWN.format(requirement="MSL-001"), encoding="utf-8")
    done = run(author, "--nros-backend", TWICE, "--nros-known", "known.toml", "-k", "overflow")
    done.assert_outcomes(failed=2, deselected=4)


def test_an_entry_for_something_else_is_an_error_before_anything_runs(author: pytest.Pytester) -> None:
    author.path.joinpath("known.toml").write_text(KNOWN.format(requirement="MSL-099"), encoding="utf-8")
    done = run(author, "--nros-backend", TWICE, "--nros-known", "known.toml")
    assert done.ret == 4
    done.stderr.fnmatch_lines(["ERROR: nros-conformance: *known.toml:3: known M1: no requirement 'MSL-099'; see: *"])


def test_a_claim_that_behaviour_contradicts_fails_the_declaration(author: pytest.Pytester) -> None:
    claim = '[events.MessageLost]\nclaim = "yes"\nhow   = "model"'
    absent = '[events.MessageLost]\nclaim = "no"\nabsent = "not-yet"\nbecause = "it was forgotten"'
    author.path.joinpath("mine", "backend.toml").write_text(declaration(**{claim: absent}), encoding="utf-8")
    done = run(author, "--nros-backend", "mine:Mine", "-k", "refused or declaration")
    assert done.ret == 1
    done.stdout.fnmatch_lines([
        "*backend.toml and what was observed differ:",
        '[[]events.MessageLost] claim = "no", but *',
    ])  # fmt: skip


def test_workers_of_xdist_play_a_share_each_and_junit_xml_has_it_all(author: pytest.Pytester) -> None:
    done = author.runpytest_subprocess(
        "-p", "no:cacheprovider", "--nros-suites", "suites", "--nros-backend", TWICE, "-n", "2", "--junitxml", "j.xml"
    )
    assert done.parseoutcomes() == {"failed": 2, "passed": 3, "skipped": 1}
    cases = list(ElementTree.parse(author.path / "j.xml").iter("testcase"))
    assert {case.get("classname") for case in cases} == {"mine.backend.toml"}
    failed = {case.get("name") for case in cases if case.find("failure") is not None}
    assert failed == {"sample.overflow[depth=1]", "sample.overflow[depth=4]"}
    report = read_report(author.path / ".nros-conformance" / "mine")
    assert {result.key for result in report.results} == {case.get("name") for case in cases} - {"declaration"}
    assert report.control is not None
    assert [one.name for one in author.path.joinpath(".nros-conformance").iterdir()] == ["mine"]


@pytest.mark.parametrize(("arguments", "code", "message"), [
    (("--nros-backend", "refrence"), 4, "ERROR: nros-conformance: no backend 'refrence'; did you mean 'reference'?"),
    (("--nros-backend", "nowhere:Mine"), 4,
     "ERROR: nros-conformance: nowhere:Mine: there is no module 'nowhere'"),
    (("--nros-backend", "mine:Mine", "--nros-backend", "reference", "--nros-known", "k.toml"), 4,
     "ERROR: nros-conformance: k.toml: a list of known failures is about one backend; name one"),
])  # fmt: skip
def test_a_name_that_nothing_has_is_a_usage_error(
    author: pytest.Pytester, arguments: tuple[str, ...], code: int, message: str
) -> None:
    done = run(author, *arguments)
    assert done.ret == code
    assert message in done.stderr.str()


def test_a_missing_package_ends_with_the_command_that_installs_it(author: pytest.Pytester) -> None:
    author.path.joinpath("mine", "__init__.py").write_text("import not_there\n", encoding="utf-8")
    done = run(author, "--nros-backend", "mine:Mine")
    assert done.ret == 5
    assert (
        "mine missing: No module named 'not_there'; install it, and name the command in backend.toml: [subject] install"
        in done.stderr.str()
    )


def test_durations_are_those_of_the_plays(author: pytest.Pytester) -> None:
    done = run(author, "--nros-backend", "mine:Mine", "--durations", "0", "-vv", f"mine/backend.toml::{PAIR}")
    (seconds,) = re.findall(r"([\d.]+)s call +mine/backend.toml::sample.pair", done.stdout.str())
    assert float(seconds) < 0.2  # of virtual time; the item has waited for a worker process and the control


def test_the_package_is_found_where_pytest_finds_it(author: pytest.Pytester) -> None:
    author.mkdir("src")
    (author.path / "mine").rename(author.path / "src" / "mine")
    author.makeini("[pytest]\npythonpath = src\nnros_backends = mine:Mine")
    run(author, "-k", PAIR).assert_outcomes(passed=1, deselected=5)
