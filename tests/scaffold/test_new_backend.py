"""From an empty directory to a verdict. What follows, `docs/writing-a-backend.md` shows and tests/docs plays."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from nros_conformance.cli.main import main

CHECKOUT = Path(__file__).parents[2]


def command(*arguments: str, cwd: Path, path: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Python, with ``path`` to be found in."""
    environment = os.environ | ({"PYTHONPATH": str(path)} if path else {})
    return subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, check=False, cwd=cwd, env=environment
    )  # fmt: skip


def nros(*arguments: str, cwd: Path, path: Path | None = None) -> subprocess.CompletedProcess[str]:
    return command("-m", "nros_conformance.cli.main", *arguments, cwd=cwd, path=path)


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory with the new package ``my_bus`` installed in it, away from the checkout."""
    place = tmp_path_factory.mktemp("author")
    assert nros("new-backend", "my_bus", cwd=place).returncode == 0
    done = command(
        "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--no-index",
        "--disable-pip-version-check", "--target", "site", "./nros-my-bus", cwd=place,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return place


def test_it_says_what_it_wrote_and_the_next_two_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new-backend", "my_bus"]) == 0
    files = [".github/workflows/conformance.yml", ".gitignore", "README.md", "nros_my_bus/__init__.py",
             "nros_my_bus/backend.toml", "nros_my_bus/environment.py", "nros_my_bus/py.typed",
             "nros_my_bus/stand_in.py", "pyproject.toml", "tests/test_adapter.py", "tox.ini"]  # fmt: skip
    written = "".join(f"written  nros-my-bus/{file}\n" for file in files)
    assert capsys.readouterr().out == (
        f"{written}\nnext     pip install -e nros-my-bus\n         nros-conformance run --backend my_bus\n"
    )
    assert all((tmp_path / "nros-my-bus" / file).is_file() for file in files)
    texts = [(tmp_path / "nros-my-bus" / file).read_text(encoding="utf-8") for file in files]
    assert not [text for text in texts if re.search(r"\$\w|nros_NAME", text)]


@pytest.mark.parametrize(("arguments", "message"), [
    (("My-Bus",), "a backend cannot be called 'My-Bus'; use lower-case letters, digits and _, as in my_mqtt"),
    (("uorb",), "there is a backend 'uorb' already: nros_backends.uorb:UorbBackend"),
    (("my_bus", "--into", "."), ". exists already; remove it, or choose another place with --into DIR"),
])  # fmt: skip
def test_what_cannot_be_written_is_a_usage_error(
    arguments: tuple[str, ...], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["new-backend", *arguments]) == 4
    assert capsys.readouterr().err == f"nros-conformance: {message}\n"


def test_it_is_clean_by_ruff(installed: Path) -> None:
    pytest.importorskip("ruff")
    for arguments in (("check", "."), ("format", "--check", ".")):
        done = command("-m", "ruff", *arguments, cwd=installed / "nros-my-bus")
        assert done.returncode == 0, done.stdout


@pytest.fixture(scope="module")
def played(installed: Path) -> subprocess.CompletedProcess[str]:
    """The run that the guide shows, by its smoke profile."""
    run = ("run", "--backend", "my_bus", "--profile", "smoke", "--results", "results")
    return nros(*run, cwd=installed, path=installed / "site")


def test_it_is_discovered_green_and_says_what_it_claims(played: subprocess.CompletedProcess[str]) -> None:
    assert played.returncode == 0, played.stdout
    assert "claims   my_bus: 0 of 5 events claimed\n" in played.stdout
    assert played.stdout.endswith("\nexit 0\n")


def test_its_own_pytest_is_green(installed: Path) -> None:
    done = command(
        "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:hypothesispytest", "--assert=plain",
        "--nros-profile", "smoke", "-k", "absent or adapter", cwd=installed / "nros-my-bus", path=installed / "site",
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert re.search(r"^[1-9]\d* passed, \d+ deselected", done.stdout, re.MULTILINE), done.stdout


def test_it_merges_into_one_matrix_with_a_built_in_backend(
    installed: Path, played: subprocess.CompletedProcess[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert played.returncode == 0
    monkeypatch.chdir(installed)
    assert main(["run", "--backend", "uorb", "--profile", "smoke", "--results", "results"]) == 0
    assert main(["matrix", "--results", "results"]) == 0
    rows = re.findall(r"^\| \*\*(.+?)\*\*, (\w+) \|", (installed / "matrix.md").read_text(encoding="utf-8"), re.M)
    assert rows == [("uORB", "model"), ("My bus", "library")]
