"""A broker, router or agent as a process of its own: the usual `Environment`."""

from __future__ import annotations

import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence

from nros_conformance.rmw.backend import Environment, Host
from nros_conformance.rmw.codes import ReturnCode, RmwError

READY_S = 10.0
"""How long it may take to accept a connection; brokers take some 50 ms on an idle host."""

_POLL_S = 0.01

_LEASHED = (
    sys.executable, "-I", "-S", "-c",
    "import ctypes, os, sys\n"
    "if sys.platform == 'linux': ctypes.CDLL(None).prctl(1, 9)  # PR_SET_PDEATHSIG, SIGKILL\n"
    "os.execvp(sys.argv[1], sys.argv[1:])",
)  # fmt: skip
"""Starts what follows so that it dies with its parent. A ``preexec_fn`` may deadlock in a process with threads."""


class ProcessEnvironment(Environment):
    """Runs ``command`` until it is stopped; ready when it accepts TCP connections on its port.

    ``{port}`` and ``{scratch}`` in the command become a port and a folder of this play alone. It ends with the
    process that started it (Linux), and its output is kept in the folder.
    """

    def __init__(self, command: Sequence[str], host: Host, *, ready_s: float = READY_S) -> None:
        self._command = tuple(command)
        self._scratch = host.scratch
        self._log = host.scratch / "environment.log"
        self._ready_s = ready_s
        self._process: subprocess.Popen[bytes] | None = None
        # Every process of a play computes the same one.
        self.port = host.ports[host.network % len(host.ports)] if host.ports else _free_port()

    def start(self) -> None:
        self._scratch.mkdir(parents=True, exist_ok=True)
        command = [part.format(port=self.port, scratch=self._scratch) for part in self._command]
        if shutil.which(command[0]) is None:
            raise RmwError(ReturnCode.CONNECTION_FAILED, f"there is no program {command[0]!r} on this machine")
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(
                [*_LEASHED, *command], stdin=subprocess.DEVNULL, stdout=log, stderr=log
            )  # fmt: skip
        until = time.monotonic() + self._ready_s
        while not self._accepts():
            if self._process.poll() is not None:
                code = self._process.returncode
                raise RmwError(ReturnCode.CONNECTION_FAILED, f"{command[0]} ended with {code}: {self._last_words()}")
            if time.monotonic() > until:
                self.stop(kill=True)
                raise RmwError(
                    ReturnCode.CONNECTION_FAILED,
                    f"{command[0]} accepts no connection on port {self.port} after {self._ready_s:g} s: "
                    f"{self._last_words()}",
                )
            time.sleep(_POLL_S)

    def stop(self, *, kill: bool = False) -> None:
        if self._process is not None and self._process.poll() is None:
            self._process.send_signal(signal.SIGKILL if kill else signal.SIGTERM)
            try:
                self._process.wait(self._ready_s)
            except subprocess.TimeoutExpired:  # it does not mind being asked
                self._process.kill()
                self._process.wait()
        self._process = None

    def endpoint(self) -> str:
        return f"127.0.0.1:{self.port}"

    def processes(self) -> Sequence[int]:
        process = self._process
        return () if process is None else (process.pid,)

    def log(self) -> str:
        return self._log.read_text(encoding="utf-8", errors="replace") if self._log.is_file() else ""

    def _accepts(self) -> bool:
        with socket.socket() as caller:
            caller.settimeout(1.0)
            return caller.connect_ex(("127.0.0.1", self.port)) == 0

    def _last_words(self) -> str:
        return (self.log().strip().splitlines() or ["it printed nothing"])[-1]


def _free_port() -> int:
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        port: int = holder.getsockname()[1]
    return port
