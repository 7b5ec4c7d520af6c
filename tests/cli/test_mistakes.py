"""What somebody gives the command by mistake: one line that names it and the remedy, and exit code 4."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from nros_conformance.cli.main import main
from nros_conformance.report import terminal
from nros_conformance.report.results import Control

EVENTS = ("LivelinessChanged", "RequestedDeadlineMissed", "MessageLost", "LivelinessLost", "OfferedDeadlineMissed")


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of one scenario on the uORB model."""
    results = tmp_path_factory.mktemp("results")
    assert main(["run", "--backend", "uorb", "--results", str(results), "--scenario", "msl.exactly-full*"]) == 0
    return results


@pytest.fixture
def results(played: Path, tmp_path: Path) -> Path:
    """A copy of them that a test may damage."""
    return Path(shutil.copytree(played, tmp_path / "results"))


@pytest.mark.parametrize(("arguments", "message"), [
    (("rnu",), "no command 'rnu'; did you mean 'run'?"),
    (("list", "backend"), "no list 'backend'; did you mean 'backends'?"),
    (("run", "--profile", "smok"), "argument --profile: invalid choice 'smok'; did you mean 'smoke'?"),
    (("run", "--max-unclear", "-1"),
     "argument --max-unclear: '-1' is not a number from 0 on; see: nros-conformance run --help"),
    (("new-backend",), "the following arguments are required: NAME; see: nros-conformance new-backend --help"),
    ((), "the following arguments are required: COMMAND; see: nros-conformance --help"),
])  # fmt: skip
def test_what_the_command_line_does_not_have(
    arguments: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 4
    assert capsys.readouterr().err == f"nros-conformance: {message}\n"


@pytest.mark.parametrize(("arguments", "message"), [
    (("--backend", "uorb", "--option", "foo=bar"), "--option: uorb takes no option 'foo'"),
    (("--backend", "xrce", "--option", "agnet=1"), "--option: xrce takes no option 'agnet'; did you mean 'agent'?"),
    (("--backend", "uorb", "--option", "foo"),
     "--option: 'foo' is not NAME=VALUE; write --option agent=127.0.0.1:8888"),
])  # fmt: skip
def test_an_option_that_no_backend_takes(
    arguments: tuple[str, ...], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "--results", str(tmp_path), "--scenario", "msl.exactly-full*", *arguments]) == 4
    assert capsys.readouterr().err == f"nros-conformance: {message}\n"


def test_a_file_that_cannot_be_written_or_read(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nowhere = tmp_path / "nowhere" / "matrix.md"
    assert main(["matrix", "--results", str(results), "--output", str(nowhere)]) == 4
    assert capsys.readouterr().err == (
        f"nros-conformance: {nowhere}: No such file or directory; name another file or folder\n"
    )
    readme = tmp_path / "README.md"
    table = ["matrix", "--results", str(results), "--output", str(tmp_path / "matrix.md")]
    assert main([*table, "--readme", str(readme)]) == 4
    assert capsys.readouterr().err == (
        f"nros-conformance: {readme}: No such file or directory; name another file or folder\n"
    )


def test_a_broken_adapter_is_told_and_the_others_are_played(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    package = tmp_path / "collapsing"
    package.mkdir()
    (package / "__init__.py").write_text("raise ValueError('no licence')\n", encoding="utf-8")
    (package / "backend.toml").write_text(
        'schema = 1\nname = "collapsing"\ntitle = "Collapsing"\nadapter = "collapsing:It"\n'
        '[subject]\nkind = "library"\nsays = "nothing"\n[connection]\nabsent = "not-yet"\nbecause = "so"\n'
        + "".join(f'[events.{kind}]\nclaim = "no"\nabsent = "not-yet"\nbecause = "so"\n' for kind in EVENTS),
        encoding="utf-8",
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    assert main(["run", "--backend", "collapsing:It", "--backend", "uorb", "--results", str(tmp_path / "results"),
                 "--scenario", "msl.exactly-full*"]) == 4  # fmt: skip
    out, err = capsys.readouterr()
    assert err.splitlines()[0] == (
        f"nros-conformance: {package / '__init__.py'}:1: importing it raised ValueError: no licence"
    )
    assert any(line.split()[:3] == ["uorb", "3", "3"] for line in out.splitlines())


@pytest.mark.parametrize(("control", "said"), [
    (Control(reference="passes 1 of 1", planted='"fires late" stayed unclear in 6 attempts: x', ok=False),
     "exit 3: this host was too busy for the control, so nothing was played; run again when it is less loaded"),
    (Control(reference="passes 1 of 1", planted='"fires late" is NOT caught', ok=False),
     "exit 3: a planted defect went unnoticed, so nothing was played; please report it with the lines above"),
    (Control(reference="passes 0 of 1; a.b: why", planted="", ok=False),
     "exit 3: the reference does not pass, so nothing was played; with suites of your own mend the scenario that the "
     "control names, else please report it"),
])  # fmt: skip
def test_why_nothing_is_played_without_the_control(control: Control, said: str) -> None:
    assert terminal.without_control(control) == said
