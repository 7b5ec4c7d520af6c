"""The commands of docs/native-backends.md, typed one after the other as they stand there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from nros_conformance.cli.main import main
from tests.backends.native.compiling import EXAMPLE, needs

GUIDE = (EXAMPLE.parents[1] / "docs" / "native-backends.md").read_text(encoding="utf-8")


@needs("cmake", "cc", "bash")
def test_every_command_of_the_guide_works(tmp_path: Path) -> None:
    commands = [line for block in re.findall(r"```sh\n(.*?)```", GUIDE, re.DOTALL) for line in block.splitlines()]
    assert len(commands) == 9
    (tmp_path / "examples").symlink_to(EXAMPLE.parent)
    binaries = tmp_path / "bin"
    binaries.mkdir()
    script = f'#!/bin/sh\nexec {sys.executable} -m nros_conformance.cli.main "$@"\n'
    (binaries / "nros-conformance").write_text(script, encoding="utf-8")
    (binaries / "nros-conformance").chmod(0o755)
    environment = {**os.environ, "PATH": f"{binaries}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(
        ["bash", "-e", "-c", "\n".join(commands)],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "reg.wrong-side-is-refused   REG-002 (must)" in done.stdout


def test_every_option_of_the_guide_exists(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["run", "--help"])
    text = capsys.readouterr().out
    for option in set(re.findall(r"--[a-z][a-z-]+", GUIDE)) - {"--build", "--args", "--output"}:
        assert option in text
