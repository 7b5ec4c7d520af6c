"""The command as its users call it: exit codes, and the exact text of what goes wrong."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from nros_conformance.cli.codes import ExitCode, strongest
from nros_conformance.cli.main import main
from nros_conformance.report.gaps import GROUPS
from nros_conformance.report.mutation import MutantResult, MutationReport, write_mutation
from nros_conformance.report.results import read_report, write_report
from nros_conformance.suite.loader import load_suites

ADAPTERS = Path(__file__).parents[1] / "play" / "adapters"
SCENARIOS = ("--scenario", "reg.raises-message-lost", "--scenario", "reg.absent-*", "--scenario", "reg.wrong-side-*")


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a short run on the uORB model."""
    results = tmp_path_factory.mktemp("results")
    assert main(["run", "--backend", "uorb", "--results", str(results), *SCENARIOS]) == 0
    return results


@pytest.fixture
def results(played: Path, tmp_path: Path) -> Path:
    """A copy of them that a test may damage."""
    return Path(shutil.copytree(played, tmp_path / "results"))


def command(*arguments: str, path: Path = ADAPTERS) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "nros_conformance.cli.main", *arguments],
        capture_output=True, text=True, check=False, env={"PYTHONPATH": str(path), "PATH": ""},
    )  # fmt: skip


def test_of_several_codes_the_strongest_is_reported() -> None:
    order = [
        ExitCode.INTERNAL,
        ExitCode.USAGE,
        ExitCode.INTERRUPTED,
        ExitCode.FAILED,
        ExitCode.NOTHING,
        ExitCode.UNCLEAR,
    ]
    for index, code in enumerate(order):
        assert strongest(reversed(order[index:])) is code
    assert strongest([]) is ExitCode.OK
    assert [int(code) for code in order] == [3, 4, 2, 1, 5, 8]


def test_a_run_prints_its_control_its_rows_and_its_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "--backend", "uorb", "--results", str(tmp_path), *SCENARIOS]) == 0
    out = capsys.readouterr().out
    assert 'planted defect "fires late" is caught' in out
    assert "uorb       " in out
    assert out.endswith("\nexit 0\n")
    report = read_report(tmp_path / "uorb")
    assert report.control is not None
    assert report.control.ok
    assert {result.key for result in report.results if result.attempts} >= {"reg.raises-message-lost"}
    assert all((tmp_path / "uorb" / attempt.trace).is_file() for one in report.results for attempt in one.attempts)


def test_json_is_the_reports_and_nothing_else(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "--backend", "uorb", "--json", "--results", str(tmp_path), *SCENARIOS]) == 0
    (report,) = json.loads(capsys.readouterr().out)
    assert report["row"] == "uorb"
    assert {result["status"] for result in report["results"]} <= {"played", "not-applicable", "untested"}


@pytest.mark.parametrize(("arguments", "message"), [
    (("--backend", "cyclon"), "no backend 'cyclon'; did you mean 'cyclone'?"),
    (("--backend", "mqtt"), "no backend 'mqtt'; installed are can, cyclone, reference, uorb, xrce, zenoh"),
    (("--backend", "uorb", "--scenario", "mqtt.lost"), "no scenario 'mqtt.lost'; see: nros-conformance list scenarios"),
    (
        ("--backend", "uorb", "--scenario", "rdm.silence-after"),
        "no scenario 'rdm.silence-after'; did you mean 'rdm.silence-after-data'?",
    ),
    (("--backend", "uorb", "--suite", "registraton"), "no suite 'registraton'; did you mean 'registration'?"),
    (("--backend", "uorb", "--requirement", "RDM-099"), "no requirement 'RDM-099'; did you mean 'RDM-009'?"),
    (("--backend", "nowhere:Backend"), "nowhere:Backend: there is no module 'nowhere'"),
])  # fmt: skip
def test_a_name_that_nothing_has_is_a_usage_error(
    arguments: tuple[str, ...], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "--results", str(tmp_path), *arguments]) == 4
    assert f"nros-conformance: {message}" in capsys.readouterr().err


def test_a_missing_package_is_reported_with_its_command_and_the_others_are_played(tmp_path: Path) -> None:
    done = command(
        "run", "--backend", "absent:AbsentBackend", "--backend", "uorb", "--results", str(tmp_path), *SCENARIOS
    )
    assert done.returncode == 5
    assert done.stderr.startswith(
        "absent   missing: No module named 'middleware_that_is_not_there'; "
        "install it: pip install middleware-that-is-not-there\n"
    )
    assert read_report(tmp_path / "uorb").results


def test_a_backend_that_crashes_fails_the_run_and_leaves_the_others_alone(tmp_path: Path) -> None:
    done = command("run", "--backend", "broken:Segfaults", "--backend", "uorb", "--results", str(tmp_path), *SCENARIOS)
    assert done.returncode == 1
    assert "FAIL  broken  reg.raises-message-lost" in done.stdout
    assert "cause   the backend crashed: the process died of SIGSEGV, in string_at at __init__.py:" in done.stdout
    assert "exit 1: a must fails that no [[known]] entry covers: broken reg.raises-message-lost" in done.stdout
    assert {one.verdict for one in read_report(tmp_path / "uorb").results if one.attempts} == {"pass"}


def test_rejudging_stored_traces_gives_the_same_verdicts(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = read_report(results / "uorb")
    assert main(["rejudge", str(results)]) == 0
    assert capsys.readouterr().out.endswith(" traces judged again, 0 verdicts changed\n")
    assert read_report(results / "uorb") == before


def test_rejudging_corrects_a_verdict_that_the_trace_does_not_support(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = read_report(results / "uorb")
    wrong = tuple(
        msgspec.structs.replace(one, verdict="inconclusive") if one.id == "reg.raises-message-lost" else one
        for one in report.results
    )
    write_report(results, msgspec.structs.replace(report, results=wrong))
    assert main(["rejudge", str(results)]) == 0
    assert "uorb reg.raises-message-lost: was inconclusive, is pass\n" in capsys.readouterr().out
    assert read_report(results / "uorb") == report


def test_a_truncated_trace_is_judged_without_its_end(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trace = results / "uorb" / "traces" / "reg.raises-message-lost.1.jsonl"
    trace.write_bytes(trace.read_bytes()[:-300])
    assert main(["rejudge", str(results)]) == 0
    assert "uorb reg.raises-message-lost: was pass, is inconclusive\n" in capsys.readouterr().out


def test_the_matrix_is_written_checked_and_found_stale(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    matrix, page = tmp_path / "matrix.md", tmp_path / "page" / "matrix.html"
    arguments = ["matrix", "--results", str(results), "--output", str(matrix)]
    assert main([*arguments, "--check"]) == 4
    assert capsys.readouterr().err == (
        f"nros-conformance: {matrix}: there is no such file; write it: nros-conformance matrix\n"
    )
    assert main([*arguments, "--html", str(page)]) == 0
    first = matrix.read_bytes()
    assert main(arguments) == 0
    assert matrix.read_bytes() == first
    assert page.read_text(encoding="utf-8").startswith("<!doctype html>")
    assert main([*arguments, "--check"]) == 0
    matrix.write_text(matrix.read_text(encoding="utf-8").replace("| no ", "| yes ", 1), encoding="utf-8")
    assert main([*arguments, "--check"]) == 1
    assert "matrix.md is not what was observed; write it again: nros-conformance matrix\n" in capsys.readouterr().out


def test_the_score_of_the_mutants_is_in_the_matrix_as_long_as_it_is_of_these_suites(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    matrix, page, row = tmp_path / "matrix.md", tmp_path / "matrix.html", "planted defects caught"
    arguments = ["matrix", "--results", str(results), "--output", str(matrix), "--html", str(page)]
    killed, alive = (
        MutantResult(name=name, defect="", violates="CON-001", says="is bad", killed_by=by)
        for name, by in (("a", "con.cut-off"), ("b", ""))
    )
    of_here = MutationReport(
        digest=load_suites().digest, backend="reference", mutants=(killed, killed, alive), seconds=1.0
    )
    file = write_mutation(results, of_here)
    assert main(arguments) == 0
    scored = next(line for line in matrix.read_text(encoding="utf-8").splitlines() if row in line)
    cells = [cell.strip() for cell in scored.strip("|").split("|")]
    assert (cells[0], cells[1 + GROUPS.index("CON")], cells[-1]) == (row, "2/3", "2/3")
    assert f"{row}</th>" in page.read_text(encoding="utf-8")
    assert main([*arguments, "--check"]) == 0
    capsys.readouterr()
    write_mutation(results, msgspec.structs.replace(of_here, digest="sha256:other"))
    assert main(arguments) == 0
    assert capsys.readouterr().out.splitlines()[0] == (
        f"left out {file}: its mutants were played on other suites; run again: nros-conformance mutants"
    )
    assert row not in matrix.read_text(encoding="utf-8")


def test_the_table_is_copied_into_a_readme_between_its_markers(results: Path, tmp_path: Path) -> None:
    readme = tmp_path / "README.md"
    readme.write_text("above\n<!-- matrix: table -->\nold\n<!-- /matrix -->\nbelow\n", encoding="utf-8")
    arguments = ["matrix", "--results", str(results), "--output", str(tmp_path / "matrix.md"), "--readme", str(readme)]
    assert main(arguments) == 0
    text = readme.read_text(encoding="utf-8")
    assert text.startswith("above\n<!-- matrix: table -->\n| Backend, what ran |")
    assert "old" not in text
    assert text.endswith("|\n<!-- /matrix -->\nbelow\n")
    assert main([*arguments, "--check"]) == 0


def test_badges_are_written_and_checked_with_the_matrix(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    badges = tmp_path / "badges"
    arguments = ["matrix", "--results", str(results), "--output", str(tmp_path / "matrix.md"), "--badges", str(badges)]
    assert main(arguments) == 0
    assert capsys.readouterr().out.endswith(f"written  {badges}/   uorb.svg\n")
    assert {file.name for file in badges.iterdir()} == {"uorb.json", "uorb.svg"}
    assert main([*arguments, "--check"]) == 0
    (badges / "uorb.svg").unlink()
    assert main([*arguments, "--check"]) == 1
    assert f"{badges}/uorb.svg: there is no such badge\n" in capsys.readouterr().out


def test_explain_shows_requirement_script_timeline_and_judgement(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", "uorb", "reg.raises-message-lost", "--results", str(results)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("pass   reg.raises-message-lost on uorb")
    for part in ("REG-005 (must)", "Script   suites/registration.yaml:", "  publish times 20, by talker   (burst)",
                 "MessageLost total 16 (+16)", "Judgement", "run --backend uorb --scenario reg.raises"):  # fmt: skip
        assert part in out


def test_explain_names_the_log_of_the_peer_of_a_play_that_did_not_pass(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = read_report(results / "uorb")
    (one,) = (each for each in report.results if each.key == "reg.raises-message-lost")
    trace = one.attempts[-1].trace
    log = results / "uorb" / f"{trace}.d" / "peer.log"
    log.parent.mkdir(exist_ok=True)
    log.write_text("no route", encoding="utf-8")
    subject = ["explain", "uorb", one.key, "--results", str(results)]
    assert main(subject) == 0
    assert "peer.log" not in capsys.readouterr().out
    verdict = msgspec.structs.replace(one.attempts[-1].verdict, verdict="fail")
    failed = msgspec.structs.replace(one, attempts=(msgspec.structs.replace(one.attempts[-1], verdict=verdict),))
    write_report(results, msgspec.structs.replace(report, results=(failed,)))
    assert main(subject) == 0
    assert capsys.readouterr().out.endswith(
        f"\nTrace      uorb/{trace}\nPeer       uorb/{trace}.d/peer.log: what the agent, router or broker has printed\n"
    )


@pytest.mark.parametrize(("subject", "start"), [
    ("uorb/MessageLost", "untested (no_evidence)   uORB, Message lost\n"),
    ("uorb/LivelinessChanged", "no (refused)   uORB, Liveliness changed\n"),
    ("RDM-003", "RDM-003 (must)  "),
    ("deviates", 'deviates   printed as "partly n/m": works, but violates rules'),
])  # fmt: skip
def test_explain_takes_cells_requirements_and_words(
    results: Path, subject: str, start: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", subject, "--results", str(results)]) == 0
    assert capsys.readouterr().out.startswith(start)


def test_explaining_what_was_not_played_names_the_nearest(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "reg.raises-mesage-lost", "--results", str(results)]) == 4
    assert capsys.readouterr().err == (
        "nros-conformance: nothing was played that is called 'reg.raises-mesage-lost'; "
        "did you mean 'reg.raises-message-lost'?\n"
    )


def test_results_of_other_suites_are_refused(results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report = msgspec.structs.replace(read_report(results / "uorb"), digest="sha256:other")
    write_report(results, report)
    assert main(["matrix", "--results", str(results), "--output", str(tmp_path / "m.md")]) == 4
    assert "these results are on other suites (sha256:other) than those here (sha256:" in capsys.readouterr().err


@pytest.mark.parametrize("what", ["backends", "suites", "scenarios", "requirements"])
def test_lists_are_tables_and_json(what: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", what]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert main(["list", what, "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)) == len(lines) - 1 > 1


def test_the_command_starts_without_importing_what_it_does_not_need() -> None:
    code = (
        "import sys, nros_conformance.cli.main as m\n"
        "try: m.main(['--version'])\n"
        "except SystemExit: pass\n"
        "print(sorted(n for n in ('msgspec', 'ruamel.yaml', 'greenlet', 'cyclonedds') if n in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "nros-conformance 0.1.0\n[]\n"
