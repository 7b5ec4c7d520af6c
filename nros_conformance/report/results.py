"""What one run of one backend showed: ``DIR/<row>/report.json``. It stands on its own for the matrix."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, TypeAlias

import msgspec
from msgspec import Struct

from nros_conformance.judge.results import Verdict, VerdictName
from nros_conformance.rmw.declaration import Declaration
from nros_conformance.suite.schema import KindName, Profile

FORMAT = 1
NARROWED = "narrowed"
"""Folder of a results directory: what `folder_for` keeps apart."""

FILE = "report.json"

Status: TypeAlias = Literal["played", "not-applicable", "untested"]
Case: TypeAlias = Literal[
    "", "right side", "wrong side", "unknown kind", "no callback", "no deadline", "destroyed", "reachable", "silent",
]  # fmt: skip


class ReportError(Exception):
    """Reports that cannot be read or merged. The text is for the user."""


class _Part(Struct, frozen=True, kw_only=True, omit_defaults=True):
    pass


class Attempt(_Part, frozen=True, kw_only=True):
    """One play of a scenario. ``trace`` is relative to the report's folder, ``seconds`` the time it took."""

    number: int
    T_ns: int
    trace: str
    verdict: Verdict
    seconds: float


class ScenarioResult(_Part, frozen=True, kw_only=True):
    """One scenario, played or not. Of several attempts all but the last were inconclusive."""

    key: str
    """The id and, in brackets, the parameters: ``reg.wrong-side[kind=3]``."""
    id: str
    suite: str
    source: str = ""
    """``suites/registration.yaml:40``."""
    title: str = ""
    profile: Profile = "standard"
    parameters: dict[str, Any] = {}
    canonical: KindName | None = None
    refusal: KindName | None = None
    needs: tuple[str, ...] = ()
    """The events that it can only be played with."""
    proves: tuple[str, ...] = ()
    """The requirements that its expectations name."""
    status: Status
    reason: str = ""
    """Why it was not played."""
    verdict: VerdictName | None = None
    """Of the last attempt; None when it was not played."""
    known: str = ""
    """Key of the ``[[known]]`` entry that covers its failure."""
    attempts: tuple[Attempt, ...] = ()
    fired: dict[int, int] = {}
    """Callbacks of the last attempt by kind (`observations.fired`)."""

    @property
    def last(self) -> Verdict | None:
        """The verdict that counts, with its findings."""
        return self.attempts[-1].verdict if self.attempts else None


class Observation(_Part, frozen=True, kw_only=True):
    """How often a call was answered with a code. ``supports_event`` answers 1 (true) or 0 (false)."""

    call: str
    """``register``, ``supports``, ``create``, ``destroy``, ``ping``."""
    side: Literal["publisher", "subscription", "session"]
    kind: int | None = None
    case: Case = ""
    code: int
    count: int = 1


class Incident(_Part, frozen=True, kw_only=True):
    """A crash or hang of the backend, and the scenarios that were in flight."""

    what: str
    detail: str = ""
    scenarios: tuple[str, ...] = ()
    reproduced: bool = False


class Difference(_Part, frozen=True, kw_only=True):
    """Declaration and behaviour differ. The text names the section of ``backend.toml``."""

    text: str


class Control(_Part, frozen=True, kw_only=True):
    """Whether this run could fail: the reference, and a planted defect."""

    reference: str
    """``passes 40 of 40``."""
    planted: str
    """``"fires late" is caught``."""
    ok: bool


class Report(_Part, frozen=True, kw_only=True):
    """One row of the matrix."""

    format: int
    tool: str
    """Version of nros-conformance."""
    suites_version: str
    digest: str
    """Of the suites, ``sha256:...``: reports on different suites do not merge."""
    profile: Profile
    partial: bool = False
    narrowed: bool = False
    """Of scenarios, suites or requirements that were asked for by name."""
    why_partial: str = ""
    """``12 of 148 scenarios left out``."""
    row: str
    """The backend's name, or name-variant."""
    backend: str
    variant: str = ""
    asked: str = ""
    """The name by which the command finds the backend again, if not its own: ``module:Class``."""
    available: bool = True
    unavailable_reason: str = ""
    declaration: Declaration
    clock: Literal["real", "virtual"] = "real"
    versions: dict[str, str] = {}
    """Of what was tested, by package; ``python`` is printed apart."""
    results: tuple[ScenarioResult, ...] = ()
    observations: tuple[Observation, ...] = ()
    incidents: tuple[Incident, ...] = ()
    differences: tuple[Difference, ...] = ()
    control: Control | None = None
    seconds: float = 0.0
    host: dict[str, Any] = {}


class _Head(Struct, frozen=True):
    """What every format of ours has."""

    format: int
    tool: str
    suites_version: str
    digest: str


def encode_report(report: Report) -> bytes:
    """The text of ``report.json``."""
    return msgspec.json.format(msgspec.json.encode(report, enc_hook=str), indent=1) + b"\n"


def decode_report(data: bytes, file: Path | str) -> Report:
    """A report from its text. Raises `ReportError`, which names ``file``."""
    try:
        head = msgspec.json.decode(data, type=_Head)
    except msgspec.ValidationError:
        raise ReportError(f"{file}: not a report of nros-conformance") from None
    except msgspec.DecodeError:
        raise ReportError(f"{file}: not a report of nros-conformance, or cut short; run again") from None
    if head.format != FORMAT:
        raise ReportError(
            f"{file}: report format {head.format}, written by nros-conformance {head.tool}; "
            f"this one reads format {FORMAT}: run again"
        )
    try:
        return msgspec.json.decode(data, type=Report, dec_hook=_parse)
    except msgspec.ValidationError as error:
        raise ReportError(
            f"{file}: damaged, or written by another nros-conformance ({head.tool}): {error}; run again"
        ) from None


def read_report(path: Path) -> Report:
    """Read a ``report.json``, or the one in a folder. Raises `ReportError`."""
    file = path / FILE if path.is_dir() else path
    try:
        return decode_report(file.read_bytes(), file)
    except FileNotFoundError:
        raise ReportError(f"{file}: there is no report") from None


def read_reports(directory: Path) -> tuple[Report, ...]:
    """All ``DIR/<row>/report.json``. Raises `ReportError`, also when there is none."""
    files = sorted(directory.glob(f"*/{FILE}"))
    if not files:
        raise ReportError(f"{directory}: no reports here; run: nros-conformance run")
    reports: dict[str, tuple[Path, Report]] = {}
    for file in files:
        report = read_report(file)
        if report.row in reports:
            raise ReportError(f"two reports on {report.row}: {reports[report.row][0]} and {file}; remove one of them")
        reports[report.row] = file, report
    return tuple(report for _, report in reports.values())


def folder_for(directory: Path, row: str, *, narrowed: bool) -> Path:
    """The results directory for a run of this row: a narrowed run does not replace the results of a whole one."""
    if not narrowed:
        return directory
    try:
        kept = not read_report(directory / row).narrowed
    except ReportError:
        kept = False
    return directory / NARROWED if kept else directory


def read_latest(directory: Path) -> tuple[tuple[Path, Report], ...]:
    """All reports with the results directory each stands in; those of narrowed runs first, if they are the later ones.

    Raises `ReportError`, also when there is none.
    """
    whole = [(directory, report) for report in read_reports(directory)]
    narrowed = directory / NARROWED
    later = []
    for _, report in whole:
        file = narrowed / report.row / FILE
        if file.is_file() and file.stat().st_mtime_ns > (directory / report.row / FILE).stat().st_mtime_ns:
            later.append((narrowed, read_report(file)))
    return (*later, *whole)


def write_report(directory: Path, report: Report) -> Path:
    """Write ``DIR/<row>/report.json``, whole or not at all; the file."""
    file = directory / report.row / FILE
    file.parent.mkdir(parents=True, exist_ok=True)
    handle, unfinished = tempfile.mkstemp(dir=file.parent, prefix=f".{FILE}.")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(encode_report(report))
        Path(unfinished).chmod(0o644)
        Path(unfinished).replace(file)
    except BaseException:
        Path(unfinished).unlink(missing_ok=True)
        raise
    return file


def same_suites(reports: Mapping[str, Report]) -> None:
    """Refuse reports on different suites. Keys say where each comes from. Raises `ReportError`."""
    first: tuple[str, Report] | None = None
    for name, report in sorted(reports.items()):
        if first is None:
            first = (name, report)
        elif report.digest != first[1].digest:
            raise ReportError(
                f"these do not merge: {first[0]} is on suites {first[1].suites_version} ({first[1].digest}), "
                f"{name} on suites {report.suites_version} ({report.digest}); run one of them again"
            )


def _parse(type_: type[Any], value: Any) -> Any:
    return type_.parse(value)
