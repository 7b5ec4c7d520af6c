from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any, Protocol

import pytest

from nros_conformance.play.forked import ForkedModule
from nros_conformance.rmw.child import Child, launch

ECHO = "tests.play.echo"


class Start(Protocol):
    def __call__(self, module: str, arguments: Sequence[str], errors: IO[Any] | None = None) -> Child: ...


def forked(module: str, arguments: Sequence[str], errors: IO[Any] | None = None) -> Child:
    return ForkedModule(module, arguments, errors)


BOTH = pytest.mark.parametrize("start", [launch, forked])


@BOTH
def test_a_module_finds_its_arguments_and_streams(start: Start, tmp_path: Path) -> None:
    with (tmp_path / "errors").open("w+b") as errors:
        child = start(ECHO, ["1", "two"], errors)
        assert child.stdin is not None
        assert child.stdout is not None
        with child.stdin, child.stdout:
            assert child.poll() is None
            child.stdin.write(b"hello\n")
            child.stdin.flush()
            assert child.stdout.readline() == f"{child.pid} 1 two\n".encode()
            assert child.stdout.readline() == b"hello\n"
            child.stdin.close()
            assert (child.wait(30), child.poll()) == (3, 3)
        errors.seek(0)
        assert errors.read() == b"no more\n"


@BOTH
def test_errors_without_a_file_go_to_the_output(start: Start) -> None:
    child = start(ECHO, [])
    assert child.stdin is not None
    assert child.stdout is not None
    with child.stdout:
        child.stdin.close()
        assert child.stdout.read() == f"{child.pid} \nno more\n".encode()
    assert child.wait(30) == 3


@BOTH
@pytest.mark.parametrize("how", ["terminate", "kill"])
def test_the_exit_code_tells_the_signal(start: Start, how: str) -> None:
    child = start(ECHO, [])
    assert child.stdin is not None
    assert child.stdout is not None
    with child.stdin, child.stdout:
        assert child.stdout.readline()
        with pytest.raises(subprocess.TimeoutExpired):
            child.wait(0.01)
        getattr(child, how)()
        assert child.wait(30) == -(signal.SIGTERM if how == "terminate" else signal.SIGKILL)
        getattr(child, how)()  # it has ended: nothing happens


@BOTH
def test_a_module_that_cannot_be_run_says_why(start: Start) -> None:
    child = start("tests.play.no_such_module", [])
    assert child.stdin is not None
    assert child.stdout is not None
    with child.stdin, child.stdout:
        assert b"no_such_module" in child.stdout.read()
        assert child.wait(30) == 1


def test_it_ends_with_whoever_had_it_forked(tmp_path: Path) -> None:
    script = tmp_path / "starts.py"
    script.write_text(
        "import os\n"
        "from nros_conformance.play.forked import ForkedModule\n"
        "if __name__ == '__main__':\n"
        f"    child = ForkedModule({ECHO!r}, [])\n"
        "    child.stdout.readline()\n"
        "    print(child.pid, flush=True)\n"
        "    os.kill(os.getpid(), 9)\n"
    )
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, timeout=60, check=False, cwd=Path.cwd(),
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert done.returncode == -signal.SIGKILL, done.stderr
    limit = time.monotonic() + 20
    while Path(f"/proc/{int(done.stdout)}").exists():
        assert time.monotonic() < limit, "it lives on"
        time.sleep(0.01)
