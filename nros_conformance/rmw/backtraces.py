"""Where native code crashed: a debugger runs the command, and its report is cut down to a few frames."""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence

FRAMES = 3
"""As many of a backtrace say where it is; the rest is in the log."""

_CRASH = re.compile(r"received signal (SIG\w+)")
_FRAME = re.compile(r"^#\d+\s+(?:0x[0-9a-f]+ in )?(?P<function>\S+) \(.*?\)(?: at (?P<at>\S+)| from (?P<of>\S+))?")
_NOT_THEIRS = re.compile(r"^(?:__pthread_kill.*|__GI_\w+|raise|gsignal|abort|pthread_kill|\?\?|ffi_\w+|_ctypes\w*)$")
_OURS = re.compile(r"_ctypes|libffi|libpython|/python|Objects/|Python/|ceval|callproc")


def find_debugger() -> str:
    """The path of gdb, or an empty text."""
    return shutil.which("gdb") or ""


def under_debugger(debugger: str, command: Sequence[str]) -> list[str]:
    """The command that runs ``command`` and prints the frames of a crash to its standard output."""
    quiet = ("set confirm off", "set pagination off", "set print thread-events off", "set width 0")
    passed = "handle SIGPIPE SIGINT SIGUSR1 SIGUSR2 SIGCHLD nostop noprint pass"
    steps = (*quiet, "set startup-with-shell off", "set debuginfod enabled off", passed, "run", "backtrace 24", "kill")
    start = [debugger, "-q", "-nx", "-batch", "-iex", "set auto-load off"]
    return [*start, *(part for step in steps for part in ("-ex", step)), "--args", *command]


def innermost(report: str) -> str:
    """``f at file.c:12, called by g at file.c:40`` from a debugger's report; empty when it saw no crash."""
    crash = _CRASH.search(report)
    if crash is None:
        return ""
    shown: list[str] = []
    for line in report[crash.end() :].splitlines():
        frame = _FRAME.match(line)
        if frame is None:
            continue
        place = frame["at"] or frame["of"] or ""
        if _OURS.search(place) and shown:
            break
        if _NOT_THEIRS.match(frame["function"]) or _OURS.search(place):
            continue
        at = f" at {place.rpartition('/')[2]}" if frame["at"] else f" in {place.rpartition('/')[2]}" if place else ""
        shown.append(frame["function"] + at)
        if len(shown) == FRAMES:
            break
    return ", called by ".join(shown)
