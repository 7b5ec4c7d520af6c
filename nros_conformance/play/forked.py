"""Processes forked from a server process that has loaded the harness and opened nothing.

6 ms each, where a new interpreter takes 100 to 150.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from multiprocessing import forkserver
from multiprocessing.connection import Connection, wait
from typing import IO, Any

_PR_SET_PDEATHSIG = 1

_bookkeeping = threading.Lock()
"""multiprocessing asks after all its children when it starts one: two threads that read the same exit code
at once would leave one of them without."""


def die_with_parent() -> None:
    """Have the kernel kill this process when its parent is gone; Linux only."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


_LOADED = ("nros_conformance.play.session_process",)
"""What the server loads for sessions. Adapters are not among it: they may start threads when they are imported."""


class Forked:
    """``target(*args)`` in a process of its own, which ends with this one at the latest.

    ``target`` is a function of a module, connections among ``args`` are handed over. The modules ``loaded`` are
    imported by the server when this is its first process.
    """

    def __init__(self, name: str, target: Callable[..., None], args: tuple[Any, ...], *loaded: str) -> None:
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload([*_LOADED, *loaded])
        self._process = context.Process(target=_enter, args=(target, args), name=name, daemon=True)
        self._ended = False
        with _bookkeeping:
            self._process.start()
        assert self._process.pid is not None
        self.pid = self._process.pid

    def wait(self, timeout_s: float | None) -> int | None:
        """The exit code (negative: the signal that killed it), or None when it still runs."""
        # What has been read from a sentinel makes it silent for a moment, until its other end is closed.
        if self._ended or wait([self._process.sentinel], timeout_s):
            with _bookkeeping:
                self._ended = True
                return self._process.exitcode
        return None

    def signal(self, number: int) -> None:
        """Send it a signal, if it still runs."""
        if self.wait(0) is None:  # else the number may be another process's by now
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)


def _enter(target: Callable[..., None], args: tuple[Any, ...]) -> None:
    # Each child holds the server alive for grandchildren, which there are none of: a frozen one would do so for ever.
    alive = getattr(forkserver._forkserver, "_forkserver_alive_fd", None)
    if alive is not None:
        os.close(alive)
    die_with_parent()
    target(*args)


class ForkedModule:
    """A `Child` that runs ``main()`` of a module."""

    def __init__(self, module: str, arguments: Sequence[str], errors: IO[Any] | None = None) -> None:
        (stdin, to_it), (from_it, stdout) = os.pipe(), os.pipe()
        stderr = os.dup(stdout if errors is None else errors.fileno())
        self.stdin: IO[bytes] | None = os.fdopen(to_it, "wb")
        self.stdout: IO[bytes] | None = os.fdopen(from_it, "rb")
        with (
            Connection(stdin, writable=False) as theirs,
            Connection(stdout, readable=False) as said,
            Connection(stderr, readable=False) as complained,
        ):
            args = (module, tuple(arguments), (theirs, said, complained))
            self._forked = Forked(module, _run, args, module)
        self.pid = self._forked.pid

    def poll(self) -> int | None:
        return self._forked.wait(0)

    def wait(self, timeout: float | None = None) -> int:
        code = self._forked.wait(timeout)
        if code is None:
            raise subprocess.TimeoutExpired("", timeout or 0)
        return code

    def terminate(self) -> None:
        self._forked.signal(signal.SIGTERM)

    def kill(self) -> None:
        self._forked.signal(signal.SIGKILL)


def _run(module: str, arguments: tuple[str, ...], streams: tuple[Connection, Connection, Connection]) -> None:
    for number, stream in enumerate(streams):
        os.dup2(stream.fileno(), number)
        stream.close()
    sys.stdin = open(0, closefd=False)  # noqa: SIM115 - multiprocessing has put /dev/null there
    sys.argv = [module, *arguments]
    sys.exit(importlib.import_module(module).main())
