"""``nros-conformance run``."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import shlex
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from nros_conformance import __version__
from nros_conformance.campaign.control import ControlFailed, run_control
from nros_conformance.campaign.host import check_host
from nros_conformance.campaign.plans import Row
from nros_conformance.campaign.rows import find_rows, rows_of, with_known
from nros_conformance.campaign.run import Progress, RowRun, share_out
from nros_conformance.campaign.selection import Selection, SelectionError
from nros_conformance.cli import native
from nros_conformance.cli.codes import ExitCode, repeated, strongest
from nros_conformance.cli.declare import refused
from nros_conformance.cli.progress import ProgressLine
from nros_conformance.formats.places import FormatError, nearest
from nros_conformance.play.launch import Launch
from nros_conformance.play.leases import lease_ports
from nros_conformance.report import terminal
from nros_conformance.report.evidence import evidence, failures
from nros_conformance.report.explain import failure
from nros_conformance.report.junit import junit
from nros_conformance.report.results import Control, Report, encode_report
from nros_conformance.rmw.backtraces import find_debugger
from nros_conformance.rmw.codes import RmwError
from nros_conformance.rmw.discovery import Found, find_backends
from nros_conformance.rmw.loading import LibraryError
from nros_conformance.suite.loader import Suites, load_suites


def run(options: argparse.Namespace) -> ExitCode:
    """Play, judge, report."""
    suites = load_suites(options.suites)
    selection = Selection(
        options.profile, tuple(options.suite), tuple(options.scenario), tuple(options.requirement)
    )  # fmt: skip
    chosen = selection.choose(suites)
    if options.known is not None and len(options.backend) + bool(options.native) != 1:
        raise SelectionError("a list of known failures is about one backend; name it: --backend NAME --known FILE")
    hints, launch = repeated(options), _launch(options)
    if launch.debug:
        options.results = Path(tempfile.mkdtemp(prefix="nros-conformance-debug-"))
    backends, codes = _backends(options.backend) if options.backend or not options.native else ([], [])
    library = None
    if options.native:
        try:
            library = native.load(options)
        except LibraryError as error:
            codes.append(refused(error))
        else:
            backends.append(library.found)
    if not backends:
        return strongest([*codes, ExitCode.NOTHING])
    _check_options(options, backends)
    rows = [row for found in backends for row in _rows(found, suites, options)]
    say = _say if not options.json else _silent
    say(terminal.opening(__version__, suites, selection, len(chosen)))
    say(f"host     {check_host()}")
    try:
        control = _control(suites, selection, options, say)
    except ControlFailed as error:
        print(f"nros-conformance: {error}", file=sys.stderr)
        return ExitCode.INTERNAL
    if not control.ok:
        say(f"\n{terminal.without_control(control)}")
        return ExitCode.INTERNAL
    for line in library.says if library is not None else ():
        say(f"{'native':<8} {line}")
    with contextlib.ExitStack() as stack:
        runs = [
            RowRun(
                row, suites, selection, options.results, ports=stack.enter_context(lease_ports()), control=control,
                watch=lambda progress: None, launch=_for(row, launch),
            )
            for row in rows
        ]  # fmt: skip
        share_out(runs)
        width = max(len(row.name) for row in rows)
        for one in runs:
            row = one.row
            say(terminal.row_line(row.name, row.declaration, row.versions, row.virtual, one.total, len(chosen), width))
        reports, interrupted = _play(runs, suites, say, hints)
    if interrupted:
        codes.append(ExitCode.INTERRUPTED)
    if options.json:
        print("[" + ",".join(encode_report(report).decode() for report in reports) + "]")
    for report in reports:
        codes += judge_codes(report, suites.levels, options.max_unclear)
    if not any(result.attempts for report in reports for result in report.results):
        codes.append(ExitCode.NOTHING)
    if options.junit is not None:
        options.junit.parent.mkdir(parents=True, exist_ok=True)
        options.junit.write_bytes(junit(reports, {one.id: one for one in suites.requirements}))
    apart = [one.row.name for one in runs if one.results != options.results]
    say(terminal.closing(reports, suites.levels, options.results, selection, apart, hints))
    if launch.wrap and not launch.debug:
        say("wrapped  " + ", ".join(f"{one.folder}/worker.log" for one in runs))
    code = strongest(codes)
    say(f"\nexit {int(code)}{terminal.meaning(int(code), reports)}")
    return code


def judge_codes(report: Report, levels: Mapping[str, str], max_unclear: int) -> list[ExitCode]:
    """The exit codes that one row asks for."""
    codes = []
    if not report.available:
        codes.append(ExitCode.NOTHING)
    played = [result for result in report.results if result.attempts]
    if any(result.verdict == "error" for result in played):
        codes.append(ExitCode.INTERNAL)
    unknown = report.available and failures(evidence(report, levels).values())
    lost = any(result.verdict == "fail" and not result.known for result in played)
    if unknown or lost or report.differences or any(not incident.reproduced for incident in report.incidents):
        codes.append(ExitCode.FAILED)
    if sum(result.verdict == "inconclusive" for result in played) > max_unclear:
        codes.append(ExitCode.UNCLEAR)
    return codes


def _backends(names: Sequence[str]) -> tuple[list[Found], list[ExitCode]]:
    """The backends to play. A missing one is said with the command that installs it."""
    found = [find_rows(name) for name in names] if names else list(find_backends().values())
    usable, codes = [], []
    for one in found:
        if one.error is not None:
            print(f"nros-conformance: {one.error}", file=sys.stderr)
            codes.append(ExitCode.USAGE)
            continue
        assert one.declaration is not None
        if one.declaration.control and not names:
            continue
        try:
            lacking = one.unavailable()
        except FormatError as error:  # one broken adapter is no reason to leave out the others
            print(f"nros-conformance: {error}", file=sys.stderr)
            codes.append(ExitCode.USAGE)
            continue
        if lacking is not None:
            print(f"{one.name:<8} missing: {lacking}", file=sys.stderr)
            if names:
                codes.append(ExitCode.NOTHING)
            continue
        usable.append(one)
    return usable, codes


def _rows(found: Found, suites: Suites, options: argparse.Namespace) -> list[Row]:
    declaration = found.declaration
    assert declaration is not None
    if options.known is not None:
        declaration = with_known(declaration, options.known, suites)
    asked = found.adapter if found.adapter in options.backend else ""
    if found.options:
        asked = native.spelled(options)
    try:
        return rows_of(found, declaration, asked, host_options(options))
    except RmwError as error:
        raise FormatError("--option", None, error.detail) from error


def host_options(options: argparse.Namespace) -> dict[str, str]:
    """What ``--option`` and ``--agent`` say. Raises `FormatError`."""
    given = [*options.option, *([f"agent={options.agent}"] if options.agent is not None else [])]
    for one in given:
        if "=" not in one:
            raise FormatError("--option", None, f"{one!r} is not NAME=VALUE", "write --option agent=127.0.0.1:8888")
    return dict(one.split("=", 1) for one in given)


def _check_options(options: argparse.Namespace, backends: Sequence[Found]) -> None:
    """Refuse an option that no backend takes: it would be a typing error that nobody notices."""
    given = host_options(options)
    if not given:
        return
    named = {found.name: found.load().option_names for found in backends}
    if options.backend and None in named.values():
        return
    known = sorted({name for names in named.values() for name in names or ()})
    for name in given:
        if name not in known:
            raise FormatError(
                "--option", None, f"{', '.join(named)} {'takes' if len(named) == 1 else 'take'} no option {name!r}",
                nearest(name, known),
            )  # fmt: skip


def _launch(options: argparse.Namespace) -> Launch:
    launch = Launch(wrap=tuple(shlex.split(options.wrap)), debug=options.debug, group=options.group)
    return dataclasses.replace(launch, debug=launch.debug or launch.interactive)


def _for(row: Row, launch: Launch) -> Launch:
    """Where a compiled backend crashed is worth a second look; whoever wraps it looks for himself."""
    looks = row.declaration.subject.kind == "compiled" and not launch.wrap and not launch.debug
    return dataclasses.replace(launch, debugger=find_debugger()) if looks else launch


def _control(suites: Suites, selection: Selection, options: argparse.Namespace, say: terminal.Say) -> Control:
    begun = time.monotonic()
    control = run_control(suites, selection, options.results)
    planted = f"; {control.planted}" if control.planted else ""
    say(f"control  reference {control.reference}{planted}   {time.monotonic() - begun:.1f} s")
    return control


def _play(runs: Sequence[RowRun], suites: Suites, say: terminal.Say, hints: str) -> tuple[list[Report], bool]:
    """All rows side by side, each in a worker process of its own."""
    line = ProgressLine(sys.stderr)
    requirements = {one.id: one for one in suites.requirements}
    lock = threading.Lock()

    def watch(progress: Progress) -> None:
        with lock:
            line.update(
                progress.row.name,
                progress.done,
                progress.total,
                failed=progress.result.verdict == "fail" and not progress.result.known,
            )
            if progress.result.verdict in ("fail", "error") and not progress.result.known:
                line.clear()
                say("\n" + failure(one_report[progress.row.name].report(), progress.result, requirements, hints))

    one_report = {one.row.name: one for one in runs}
    for one in runs:
        one.watch = watch
    reports: dict[str, Report] = {}

    broken: list[Exception] = []

    def play(one: RowRun) -> None:
        try:
            reports[one.row.name] = one.play()
        except Exception as error:  # ours; the other rows go on, and what was judged is written
            broken.append(error)

    threads = [threading.Thread(target=play, args=(one,), name=one.row.name, daemon=True) for one in runs]
    interrupted = False
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            while thread.is_alive():
                thread.join(0.2)
    except KeyboardInterrupt:
        interrupted = True
        for one in runs:
            one.stop()
        for thread in threads:
            thread.join(5)
    line.clear()
    if broken:
        raise broken[0]
    return [reports.get(one.row.name) or one.report() for one in runs], interrupted


def _say(text: str) -> None:
    print(text, flush=True)


def _silent(_text: str) -> None:
    pass
