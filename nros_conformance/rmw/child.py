"""A module of a backend as a process of its own, such as an agent or a router written in Python."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from collections.abc import Callable, Sequence
from typing import IO, Any, Protocol


class Child(Protocol):
    """A process and its pipes: the part of `subprocess.Popen` that backends need."""

    pid: int
    stdin: IO[bytes] | None
    stdout: IO[bytes] | None

    def poll(self) -> int | None:
        """The exit code (negative: the signal that killed it), or None when it still runs."""

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end, at most ``timeout`` seconds. Raises `subprocess.TimeoutExpired`."""

    def terminate(self) -> None:
        """SIGTERM."""

    def kill(self) -> None:
        """SIGKILL."""


Launcher = Callable[[str, Sequence[str], "IO[Any] | None"], Child]
"""Runs ``main()`` of a module, which finds its arguments (the second one) in ``sys.argv``, as ``python -m`` does.

Standard input and output are pipes; standard error goes to the file given, without one to standard output.
"""


def launch(module: str, arguments: Sequence[str], errors: IO[Any] | None = None) -> Child:
    """`Launcher` in a new interpreter, 0.1 s. The harness lends backends one that forks (`Host.launch`)."""
    return subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT if errors is None else errors,
    )  # fmt: skip


def await_end(child: Child, within_s: float) -> None:
    """Wait for one that was told to end; one that is frozen, or does not mind being asked, is killed after that."""
    try:
        child.wait(within_s)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()


def close_pipes(child: Child) -> None:
    """Of one that has ended, and whose output nobody reads any more."""
    for pipe in (child.stdin, child.stdout):
        if pipe is not None:
            with contextlib.suppress(BrokenPipeError):
                pipe.close()
