"""``run --native`` and ``declare --native`` as their users type them."""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from nros_backends.native.loader import DERIVED, load_library
from nros_conformance.cli import native
from nros_conformance.cli.main import main
from nros_conformance.play.launch import Launch
from nros_conformance.report.results import read_report
from nros_conformance.rmw import loading
from nros_conformance.rmw.declaration import load_declaration
from nros_conformance.rmw.loading import LibraryRequest
from tests.backends.native.compiling import EXAMPLE, HEADERS, Build, Play, needs

SCENARIOS = ("--scenario", "reg.raises-*", "--scenario", "pat.slow-consumer")


def command(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "nros_conformance.cli.main", *arguments],
        capture_output=True, text=True, check=False, cwd=folder,
    )  # fmt: skip


def test_a_library_is_played_and_what_was_derived_is_said_and_not_publishable(loopback: Path, tmp_path: Path) -> None:
    arguments = ["--native", str(loopback), "--name", "loopback", "--headers", str(HEADERS), "--sessions", "16"]
    done = command("run", *arguments, "--results", "results", *SCENARIOS, folder=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.splitlines()
    assert [line for line in lines if line.startswith("native")] == [
        "native   'loopback' of libloopback.so, registered by its constructor; 13 optional slots are NULL",
        f"native   layout: --headers {HEADERS} describes 11 structs and 71 fields just so; the symbol loopback_vtable "
        "has 280 bytes, every slot leads to code",
        "native   structs: a fresh copy in every call",
        "native   callbacks: C has no unregister; LIF-003 is kept by the adapter, which lets go, and who calls later "
        "fails DSP-004",
        "native   derived from return codes: LivelinessChanged yes, RequestedDeadlineMissed yes, MessageLost yes, "
        "LivelinessLost yes, OfferedDeadlineMissed yes; for claims of yours: --declaration FILE, see declare",
    ]
    report = read_report(tmp_path / "results" / "loopback" / "report.json")
    assert report.asked == " ".join([*arguments[:4], *arguments[6:], *arguments[4:6]])
    assert (report.declaration.subject.kind, report.clock) == ("compiled", "real")
    assert report.why_partial.endswith(f" scenarios left out; {DERIVED}")
    assert report.declaration.behaviour.derived_support
    assert not report.declaration.behaviour.callback_cap
    assert {result.verdict for result in report.results if result.attempts} == {"pass"}
    assert sum(bool(result.attempts) for result in report.results) == 8


def test_a_draft_can_be_declared_and_then_stands_for_itself(
    loopback: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "backend.toml"
    declare = ["declare", "--native", str(loopback), "--output", str(output)]
    assert main(declare) == 0
    assert capsys.readouterr().err.splitlines()[-1] == f"written  {output}"
    declaration = load_declaration(output)
    assert set(declaration.claims().values()) == {"yes"}
    assert declaration.connection.because == "the slot ping_session is NULL"
    assert main(declare) == 4
    assert capsys.readouterr().err.splitlines()[-1] == (
        f"nros-conformance: {output} exists; remove it, or name another --output"
    )
    derived = load_library(LibraryRequest(loopback))
    assert derived.found.provisional == DERIVED
    assert "at once: 4 scenarios of two sessions each; more with --sessions N, if it can" in derived.says
    loaded = load_library(LibraryRequest(loopback, declaration=output, sessions=4))
    assert (loaded.found.provisional, loaded.found.origin) == ("", str(output))
    assert loaded.found.declaration is not None
    assert loaded.found.declaration.bounds.sessions == 4
    assert not any(line.startswith(("derived", "at once")) for line in loaded.says)


@pytest.mark.parametrize(
    "words",
    [
        "--native ./lib.so",
        "--native ./lib.so --name mine --locator tcp/127.0.0.1:7447 --topic-hook know --declaration b.toml --mode peer "
        "--domain 3 --storage stable --sessions 4 --host-lib a.so --host-lib b.so --headers include",
    ],
)
def test_the_command_that_plays_a_scenario_again_names_the_library_as_it_was_named(words: str) -> None:
    parser = argparse.ArgumentParser()
    native.arguments(parser)
    parser.add_argument("--declaration")
    assert native.spelled(parser.parse_args(words.split())) == words


def test_a_library_with_one_session_leaves_scenarios_with_two_untested(build: Build, tmp_path: Path) -> None:
    library = build("one_session.c", name="one_session", flags=(f"-I{EXAMPLE}",))
    done = command("run", "--native", str(library), "--suite", "registration", folder=tmp_path)
    lines = done.stdout.splitlines()
    assert (
        "native   a second session in a process fails, so scenarios with two stay untested; "
        "if their number is set when it is built, build it with room for 8"
    ) in lines
    (untested,) = (line for line in lines if line.startswith("untested"))
    assert " scenarios, needs 2 sessions in one process, where a second one fails (" in untested
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_library_that_is_none_ends_with_5(build: Build, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["declare", "--native", str(build("nothing.c", name="nothing"))]) == 5
    printed = capsys.readouterr()
    assert (printed.out, printed.err.partition(":")[0]) == ("", "nros-conformance")
    assert printed.err.startswith("nros-conformance: libnothing.so is no nano-ros backend: ")


def test_a_library_that_crashes_at_once_ends_the_run_with_1(
    build: Build, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    library = build("loopback.c", "CRASHES_IN_CREATE")
    assert main(["run", "--native", str(library), "--results", str(tmp_path)]) == 1
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(f"nros-conformance: {library.name}: create_session: the process died of SIGABRT")
    assert len(printed.err.splitlines()) == 1


def test_without_a_loader_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.metadata.entry_points", lambda **_: ())
    with pytest.raises(loading.LibraryError) as caught:
        loading.find_loader("native")
    assert str(caught.value) == (
        "no loader for native libraries is installed; run: pip install -e . (entry points exist only once installed)"
    )


@pytest.mark.parametrize("launch", [Launch(wrap=("env", "WRAPPED=yes")), Launch(debug=True)])
def test_a_worker_can_be_wrapped_and_watched(launch: Launch, loopback: Path, play: Play) -> None:
    (verdict,) = play(loopback, "reg.raises-message-lost", launch=launch).values()
    assert verdict.verdict == "pass"


def test_a_wrapper_makes_the_harness_patient_and_a_debugger_asks_for_the_terminal() -> None:
    assert Launch().patience == 1
    assert Launch(wrap=("valgrind", "-q")).patience > 1
    assert Launch(wrap=("/usr/bin/gdb", "--args")).interactive
    assert Launch(wrap=("valgrind", "-q")).command(["python"]) == ["valgrind", "-q", "python"]
    assert not Launch().interactive


@needs("cmake", "cc")
def test_the_example_is_built_by_its_cmake_file(tmp_path: Path) -> None:
    source = shutil.copytree(EXAMPLE, tmp_path / "mine", ignore=shutil.ignore_patterns("rust", "build"))
    for arguments in (["-S", ".", "-B", "build"], ["--build", "build"]):
        built = subprocess.run(["cmake", *arguments], cwd=source, capture_output=True, text=True, check=False)
        assert built.returncode == 0, built.stdout + built.stderr
        assert "warning" not in built.stderr
    assert main(["declare", "--native", str(source / "build" / "libloopback.so"), "--results", str(tmp_path)]) == 0


def test_the_example_is_small_enough_to_copy() -> None:
    assert len((EXAMPLE / "loopback.c").read_text(encoding="utf-8").splitlines()) < 400


@needs("cargo")
@pytest.mark.parametrize("feature", ["", "panics"])
def test_the_rust_twin_passes_and_its_panic_is_a_crash(feature: str, tmp_path: Path, play: Play) -> None:
    environment = {**os.environ, "CARGO_TARGET_DIR": str(tmp_path)}
    built = subprocess.run(
        ["cargo", "build", "--offline", "--quiet", "--features", feature],
        cwd=EXAMPLE / "rust", env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (built.returncode, built.stderr) == (0, "")
    library = tmp_path / "debug" / "libloopback_rs.so"
    (verdict,) = play(library, "reg.raises-message-lost", name="loopback_rs").values()
    if not feature:
        assert (verdict.verdict, verdict.reason) == ("pass", "")
        return
    assert verdict.reason.startswith("the backend crashed: the process died of SIGABRT, in publish_raw at entities.py:")
    assert "publish_raw was told to" in (tmp_path / "worker.log").read_text(encoding="utf-8", errors="replace")
