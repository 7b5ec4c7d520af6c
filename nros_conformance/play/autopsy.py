"""Where a backend crashed: the scenario is played once more under a debugger, which prints the native frames."""

from __future__ import annotations

import contextlib
import socket
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from nros_conformance.play.plan import Plan
from nros_conformance.play.wire import Job, encode
from nros_conformance.rmw.backtraces import innermost, under_debugger

LIMIT_S = 30.0
"""Beyond the time of the script. A play that does not crash again within it tells nothing."""


def autopsy(
    debugger: str, worker: Sequence[str], environment: Mapping[str, str], plan: Plan, log: Path, *, virtual: bool
) -> str:
    """The innermost native frames; empty when it did not crash again. What the debugger says is added to ``log``."""
    trace = Path(f"{plan.trace}.autopsy")
    ours, theirs = socket.socketpair()
    with ours, theirs:
        process = subprocess.Popen(
            under_debugger(debugger, [*worker, str(theirs.fileno())]),
            pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            env=environment,
        )  # fmt: skip
        ours.sendall(encode(Job([msgspec.structs.replace(plan, trace=str(trace))], 1, virtual)))
        try:
            printed, _ = process.communicate(timeout=plan.expected_ns / 1e9 + LIMIT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            printed, _ = process.communicate()
    with contextlib.suppress(FileNotFoundError):
        trace.unlink()
    with log.open("ab") as file:
        file.write(printed)
    return innermost(printed.decode(errors="replace"))
