"""Runs the survey of a library in a process that it may crash or hang as it pleases."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
from collections.abc import Collection, Sequence
from pathlib import PurePath

import msgspec

from nros_backends.native.options import Options
from nros_backends.native.survey import Answers, Job, Line, Refusal, Step
from nros_conformance.rmw.backtraces import find_debugger, innermost, under_debugger
from nros_conformance.rmw.loading import LibraryError

LIMIT_S = 30.0
"""For all the questions together; they take well under a second, two when samples do not arrive."""

_LINE: msgspec.json.Decoder[Line] = msgspec.json.Decoder(Line)


def survey(options: Options, *, limit_s: float = LIMIT_S) -> tuple[Answers, tuple[str, ...]]:
    """What the library answers, and which questions it did not survive, in words. Raises `LibraryError`.

    Only loading it and creating a session have to work: all else is for the suites to judge.
    """
    file = PurePath(options.library).name
    crashes: dict[str, str] = {}
    while True:
        lines, code, _ = _run(options, crashes, [], limit_s)
        last = lines[-1] if lines else Step("starting")
        if isinstance(last, Answers):
            return last, tuple(f"{doing}: {how}" for doing, how in crashes.items())
        if isinstance(last, Refusal):
            raise LibraryError(last.text, broken=last.broken)
        if code is None:
            how = f"it has not returned after {limit_s:g} s"
        else:
            death = f"died of {signal.Signals(-code).name}" if code < 0 else f"exited with code {code}"
            where = _where(options, crashes, limit_s)
            how = f"the process {death}" + (f", in {where}" if where else "")
        if last.needed:
            raise LibraryError(f"{file}: {last.doing}: {how}", broken=True)
        crashes[last.doing] = how


def _where(options: Options, without: Collection[str], limit_s: float) -> str:
    debugger = find_debugger()
    return innermost(_run(options, without, [debugger], limit_s)[2]) if debugger else ""


def _run(
    options: Options, without: Collection[str], debugger: Sequence[str], limit_s: float
) -> tuple[list[Line], int | None, str]:
    """What it said, its exit code (None when it had to be killed), and what it printed."""
    job = msgspec.json.encode(Job(options.texts(), tuple(without)))
    reader, writer = os.pipe()
    command = [sys.executable, "-m", "nros_backends.native.survey", str(writer)]
    with os.fdopen(reader, "rb") as told:
        process = subprocess.Popen(
            under_debugger(debugger[0], command) if debugger else command,
            pass_fds=[writer], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        os.close(writer)
        code: int | None
        try:
            printed, _ = process.communicate(job, timeout=limit_s)
            code = process.returncode
        except subprocess.TimeoutExpired:
            process.kill()
            printed, _ = process.communicate()
            code = None
        lines = [_LINE.decode(line) for line in told.read().split(b"\n") if line]
    return lines, code, printed.decode(errors="replace")


def supported(answers: Answers, options: Options) -> Options:
    """The options with which workers play it: the name is known now, and so is what is supported."""
    kinds = frozenset(kind for kind, code in enumerate(answers.registering.values()) if code == 0)
    return dataclasses.replace(options, name=answers.name, supports=kinds)
