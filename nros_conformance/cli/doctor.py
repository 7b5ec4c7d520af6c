"""``nros-conformance doctor``: what this machine lacks, which evidence that costs, and what brings it."""

from __future__ import annotations

import argparse
import platform
import tempfile
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from nros_conformance import __version__
from nros_conformance.campaign.checks import Check, Probes, host_checks
from nros_conformance.cli.codes import ExitCode
from nros_conformance.formats.places import FormatError
from nros_conformance.play.leases import lease_ports
from nros_conformance.report.results import FILE, ReportError, read_report
from nros_conformance.rmw.backend import Host
from nros_conformance.rmw.clock import MonotonicClock
from nros_conformance.rmw.codes import RmwError
from nros_conformance.rmw.declaration import Declaration
from nros_conformance.rmw.discovery import Found, find_backend, find_backends
from nros_conformance.suite.loader import Suites, load_suites

WIDTH = 96
_NAME = 14
_INDENT = " " * 11


def run(options: argparse.Namespace) -> ExitCode:
    """Look at everything once, print it, and tell by the exit code whether the named backends are there."""
    suites = load_suites(options.suites)
    found = [find_backend(name) for name in options.backend] or list(find_backends().values())
    text, code = diagnose(suites, found, options.results, named=bool(options.backend), probes=Probes())
    print(text)
    return code


def diagnose(
    suites: Suites, found: Sequence[Found], results: Path, *, named: bool, probes: Probes
) -> tuple[str, ExitCode]:
    """The whole text and the exit code. ``named``: somebody asked for these backends by name."""
    backends = [check_backend(one) for one in found]
    ready = [one for one, check in zip(found, backends, strict=True) if check.state == "ready"]
    rows = [one.declaration for one in ready if one.declaration is not None and not one.declaration.control]
    host = probes.lateness()
    lines = [
        f"nros-conformance {__version__}   Python {platform.python_version()}   suites {suites.version}: "
        f"{len(suites.scenarios)} scenarios, {len(suites.requirements)} requirements",
        "",
        f"host     {_counted(host.cores, 'core')}",
        *_shown(host_checks(host, suites, rows, probes)),
        "",
        "backends",
        *(_shown(backends) if backends else ["  none is installed; run: pip install -e ."]),
        "",
        *_wrapped(f"results  {results}: {', '.join(stored(results, suites)) or 'none yet'}", " " * 9),
        "",
        *_wrapped(_next(found, backends, named=named), "  "),
    ]
    lacking = [check.name for check in backends if check.state != "ready"]
    code = ExitCode.NOTHING if named and lacking else ExitCode.OK
    return "\n".join([*lines, _exit(lacking, named=named)]), code


def check_backend(found: Found) -> Check:
    """Whether a backend can be played here: its declaration is read, its adapter imported and created."""
    if found.declaration is None:
        return Check(found.name, "broken", costs=str(found.error))
    lacking = None
    try:
        lacking = found.unavailable()
        if lacking is None:
            versions = found.versions(Host(clock=MonotonicClock()))
            peerless = check_peers(found, found.declaration)
    except FormatError as error:
        return Check(found.name, "broken", costs=str(error))
    except Exception as error:  # a backend may fail as it likes; the others are looked at all the same
        return Check(found.name, "broken", costs=f"{found.adapter}: {type(error).__name__}: {error}")
    if lacking is not None:
        return Check(found.name, "missing", costs=f"no row of it: {lacking.reason}", remedy=(lacking.install,))
    if peerless:
        return Check(
            found.name, "missing", costs=f"no row of it: {peerless}", remedy=(found.declaration.subject.install,)
        )  # fmt: skip
    subject, clock = found.declaration.subject, f"{found.declaration.behaviour.clock} clock"
    if found.declaration.control:
        return Check(found.name, "ready", f"the control of every run, {clock}")
    tested = ", ".join(f"{name} {version}" for name, version in versions.items())
    says = ", ".join(filter(None, (tested, subject.kind, clock)))
    version, pin = versions.get(subject.package, ""), subject.pinned
    if pin is not None and version and pin.version != version:
        says += f" ({pin.by} pins {pin.version}: cells speak for {version})"
    return Check(found.name, "ready", says)


def check_peers(found: Found, declaration: Declaration) -> str:
    """Why the agent, router or broker of a default variant does not come up here; empty if all do."""
    adapter = found.load()
    variants = [name for name, facts in declaration.variants.items() if facts.get("default", True)]
    with lease_ports() as ports, tempfile.TemporaryDirectory() as scratch:
        for variant in variants or [""]:
            host = Host(clock=MonotonicClock(), variant=variant, ports=ports, scratch=Path(scratch) / "play.d")
            backend = adapter(host)
            try:
                environment = backend.environment()
                environment.start()
                environment.stop()
            except RmwError as error:
                return f"{variant}: {error.detail}" if variant else error.detail
            finally:
                backend.close()
    return ""


def stored(results: Path, suites: Suites) -> list[str]:
    """The rows of a results directory, and whether they would merge with these suites."""
    texts = []
    for file in sorted(results.glob(f"*/{FILE}")):
        try:
            report = read_report(file)
        except ReportError:
            texts.append(f"{file.parent.name} (cannot be read: play it again)")
            continue
        if report.digest == suites.digest:
            why = f"suites {report.suites_version}" + (", partial" if report.partial else "")
        else:
            other = "other suites" if report.suites_version == suites.version else "suites"
            why = f"{other} {report.suites_version}: will not merge"
        texts.append(f"{report.row} ({why})")
    return texts


def _shown(checks: Iterable[Check]) -> Iterator[str]:
    """The lines of checks. A group is one line for those that are all right, at the place of its first."""
    everything = list(checks)
    joined: set[str] = set()
    for check in everything:
        if check.group and check.state == "ok":
            if check.group not in joined:
                joined.add(check.group)
                members = [one.says for one in everything if one.group == check.group and one.state == "ok"]
                yield from _wrapped(f"  {check.state:<9}{check.group}: {', '.join(members)}", _INDENT)
        elif check.state == "ok":
            yield from _wrapped(f"  {check.state:<9}{check.says}", _INDENT)
        else:
            indent = _INDENT + " " * _NAME
            yield from _wrapped(f"  {check.state:<9}{check.name:<{_NAME - 2}}  {check.costs or check.says}", indent)
            for line in check.remedy:
                yield from _wrapped(indent + line, indent)


def _next(found: Sequence[Found], backends: Sequence[Check], *, named: bool) -> str:
    ready = [check.name for check in backends if check.state == "ready"]
    controls = {one.name for one in found if one.declaration is not None and one.declaration.control}
    playable = [name for name in ready if name not in controls]
    verb = "is" if 1 in (len(ready), len(backends)) else "are"
    text = f"{len(ready)} of {_counted(len(backends), 'backend')} {verb} ready."
    if not playable:
        return text
    names = "".join(f"--backend {name} " for name in playable) if named else ""
    return f"{text} Next:  nros-conformance run {names}--profile smoke"


def _exit(lacking: Sequence[str], *, named: bool) -> str:
    if not named:
        aside = f" (doctor --backend {lacking[0]} would exit 5)" if lacking else ""
        return f"exit 0: nothing was asked for by name{aside}"
    if not lacking:
        return "exit 0"
    return f"exit 5: not available: {', '.join(lacking)}"


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _wrapped(text: str, indent: str) -> list[str]:
    return textwrap.wrap(
        text, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False, drop_whitespace=True
    )  # fmt: skip
