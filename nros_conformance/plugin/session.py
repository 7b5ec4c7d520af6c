"""From the names that pytest was given to a campaign, and from its verdicts to pytest's report and exit code."""

from __future__ import annotations

import shutil
import uuid
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

import pytest

from nros_conformance.campaign.merge import publish
from nros_conformance.campaign.rows import find_rows, rows_of, with_known
from nros_conformance.campaign.selection import Selection
from nros_conformance.formats.places import FormatError
from nros_conformance.plugin.background import Background, NotPlayed, Share, gather
from nros_conformance.plugin.items import ScenarioItem, Subject, SubjectFile, select, tables_of
from nros_conformance.rmw.discovery import BackendNotFound, Found
from nros_conformance.suite.loader import Suites, load_suites

NOTHING, UNCLEAR = 5, 8
"""Exit codes of the command: a backend is not available here, more scenarios stay unclear than is allowed."""

_RUN_ID = "nros_conformance_run"

MARKERS = (
    "nros: a scenario of nros-conformance, or the declaration of a backend",
    "suite(name): the suite that a scenario belongs to",
    "requirement(id, level): a requirement that a scenario proves: -m 'requirement(id=\"RDM-003\")'",
    "level(name): must, should or may, of a requirement that a scenario proves: -m 'level(name=\"must\")'",
)


def begin(config: pytest.Config, names: Sequence[str], *, explicit: bool) -> None:
    """Register the plugin for these backends; ``explicit``: they were named on the command line.

    Raises `pytest.UsageError` for what cannot be used; exits with 5 when a backend is not available here.
    """
    try:
        plugin = Conformance(config, names)
    except (FormatError, BackendNotFound) as error:
        raise pytest.UsageError(f"nros-conformance: {error}") from None
    config.pluginmanager.register(plugin, "nros-conformance-session")
    for line in MARKERS:
        config.addinivalue_line("markers", line)
    if explicit or config.args_source is not pytest.Config.ArgsSource.ARGS:
        config.args += [str(one.file) for one in plugin.subjects if not _named(config, one.file)]


def _named(config: pytest.Config, file: Path) -> bool:
    """Whether an argument is this file, or something in it."""
    paths = (config.invocation_params.dir / argument.partition("::")[0] for argument in config.args)
    return any(path.resolve() == file for path in paths)


class Conformance:
    """The hooks. One object for the life of a session, in each process of it."""

    def __init__(self, config: pytest.Config, names: Sequence[str]) -> None:
        self.config = config
        root = config.invocation_params.dir
        where = config.getoption("--nros-suites")
        self.suites: Suites = load_suites(None if where is None else root / where)
        self.profile = config.getoption("--nros-profile") or config.getini("nros_profile")
        self.results: Path = root / config.getoption("--nros-results")
        worker: dict[str, Any] | None = getattr(config, "workerinput", None)
        self.is_worker = worker is not None
        self.share = Share()
        self.run_id = uuid.uuid4().hex
        if worker is not None:
            self.run_id = worker[_RUN_ID]
            name = worker["workerid"]
            self.share = Share(name, int(name.removeprefix("gw")), worker["workercount"])
        self.shared = self.results / f".pytest-{self.run_id}"
        self.background = Background(self.suites, self.profile, self.shared, self.share)
        chosen = tuple(Selection(self.profile).choose(self.suites))
        known = config.getoption("--nros-known") or config.getini("nros_known")
        if known and len(names) != 1:
            raise FormatError(known, None, "a list of known failures is about one backend", "name one")
        self.subjects = [
            self._subject(find_rows(name), name, chosen, root / known if known else None) for name in names
        ]

    def _subject(self, found: Found, name: str, chosen: Any, known: Path | None) -> Subject:
        if found.error is not None:
            raise found.error
        declaration = found.declaration
        assert declaration is not None
        lacking = found.unavailable()
        if lacking is not None:
            pytest.exit(f"{found.name} missing: {lacking}", NOTHING)
        if known is not None:
            declaration = with_known(declaration, known, self.suites)
        rows = tuple(rows_of(found, declaration, name if ":" in name else ""))
        file = Path(found.origin).resolve()
        return Subject(file, rows, chosen, self.suites, self.background, tables_of(file))

    @pytest.hookimpl(optionalhook=True)
    def pytest_configure_node(self, node: Any) -> None:
        """Of pytest-xdist: what a worker is told."""
        node.workerinput[_RUN_ID] = self.run_id

    # Collecting.

    def pytest_collect_file(self, file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
        """The ``backend.toml`` of a backend that was asked for."""
        for subject in self.subjects:
            if file_path.name == subject.file.name and file_path.resolve() == subject.file:
                file: SubjectFile = SubjectFile.from_parent(parent, path=file_path)
                file.subject = subject
                return file
        return None

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Begin to play what is left after all selection; the items then wait for it."""
        selected = select(session.items)
        if selected and not self.config.option.collectonly:
            self.background.start(selected)

    # Reporting.

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item, call: pytest.CallInfo[None]
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        """Durations are those of the plays, and unclear ones are told from what was skipped."""
        report = yield
        if isinstance(item, ScenarioItem) and call.when == "call":
            report.duration = item.seconds
            if item.unclear:
                report.nros_unclear = item.unclear  # type: ignore[attr-defined]  # survives the way from a worker
        return report

    def pytest_report_teststatus(self, report: pytest.TestReport) -> tuple[str, str, Any] | None:
        """Unclear is an outcome of its own."""
        if getattr(report, "nros_unclear", False):
            return "unclear", "?", ("UNCLEAR", {"yellow": True})
        return None

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """End the campaign; the first process writes the reports, and adjusts the exit code."""
        self.background.stop()
        if self.is_worker:
            return
        self.written = self._publish()
        reporter = self.config.pluginmanager.get_plugin("terminalreporter")
        unclear = len(reporter.stats.get("unclear", ())) if reporter is not None else 0
        if session.exitstatus == pytest.ExitCode.OK and unclear > self.config.getoption("--nros-max-unclear"):
            session.exitstatus = UNCLEAR

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """The unclear ones with their reasons, the control, and where the rest is."""
        written: list[str] = getattr(self, "written", [])
        unclear = terminalreporter.stats.get("unclear", [])
        if not written and not unclear:
            return
        terminalreporter.section("nros-conformance")
        for report in unclear:
            reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else ""
            terminalreporter.line(
                f"UNCLEAR {report.nodeid}: {reason.removeprefix('Skipped: ').removeprefix('unclear: ')}"
            )
        for line in written:
            terminalreporter.line(line)

    def _publish(self) -> list[str]:
        """Put what was played where the command leaves it; lines that say so."""
        lines: list[str] = []
        for subject in self.subjects:
            for row in subject.rows:
                try:
                    report = gather(self.shared, row.name, self.suites)
                except NotPlayed:
                    continue
                publish(report, self.shared, self.results)
                if report.control is not None and not lines:
                    planted = f"; {report.control.planted}" if report.control.planted else ""
                    lines.append(f"control  reference {report.control.reference}{planted}")
                lines.append(f"written  {self.results / row.name}   {report.why_partial}".rstrip())
        shutil.rmtree(self.shared, ignore_errors=True)
        return lines
