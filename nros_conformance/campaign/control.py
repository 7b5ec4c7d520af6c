"""The control of every run: the reference passes, and a planted defect is caught on this host."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from nros_conformance.campaign.plans import ATTEMPTS, Row, make_plan
from nros_conformance.campaign.selection import Selection, decide
from nros_conformance.judge.judge import judge
from nros_conformance.play.adapters import load_adapter
from nros_conformance.play.player import play_virtually
from nros_conformance.play.pool import Ended, Pool
from nros_conformance.report.results import Control
from nros_conformance.rmw.declaration import Declaration
from nros_conformance.rmw.discovery import Found, find_backends
from nros_conformance.suite.loader import Loaded, Suites, load_suites
from nros_conformance.trace.files import read_trace
from nros_conformance.trace.records import Header, Starved, Trace

_ATTEMPTS = 2 * ATTEMPTS
"""More than for a backend: without the control nothing is played at all."""


class ControlFailed(Exception):
    """The harness cannot be believed on this host: the text says what went wrong."""


@dataclasses.dataclass(frozen=True, slots=True)
class ControlFailure:
    """A scenario that the reference does not pass."""

    key: str
    reason: str


def find_control() -> Found:
    """The installed backend that is declared as the control. Raises `ControlFailed`."""
    for found in find_backends().values():
        if found.declaration is not None and found.declaration.control:
            return found
    raise ControlFailed("no control backend is installed (declared with control = true); run: pip install -e .")


def run_control(suites: Suites, selection: Selection, results: Path) -> Control:
    """Play the selected scenarios on the reference, and the planted defects in real time."""
    found = find_control()
    assert found.declaration is not None
    failures, played = play_reference(found, suites, selection)
    if failures:
        first = failures[0]
        return Control(
            reference=f"passes {played - len(failures)} of {played}; {first.key}: {first.reason}", planted="", ok=False
        )
    caught = [_planted(found.declaration, index, suites, results) for index in range(len(found.declaration.planted))]
    return Control(
        reference=f"passes {played} of {played}",
        planted="; ".join(text for text, _ in caught),
        ok=all(ok for _, ok in caught),
    )


def play_reference(found: Found, suites: Suites, selection: Selection) -> tuple[list[ControlFailure], int]:
    """All selected scenarios that apply, in virtual time; which did not pass, and how many were played."""
    assert found.declaration is not None
    adapter = load_adapter(found.adapter)
    row = Row(found.declaration, found.adapter)
    failures, played = [], 0
    for one in selection.choose(suites):
        if decide(one, found.declaration).status != "play":
            continue
        played += 1
        header, *records = play_virtually(make_plan(one, row, suites, Path()), adapter)
        assert isinstance(header, Header)
        verdict = judge(Trace(header, tuple(records)))  # type: ignore[arg-type]
        if verdict.verdict != "pass":
            failures.append(ControlFailure(one.key, verdict.reason or verdict.verdict))
    return failures, played


def _planted(declaration: Declaration, index: int, suites: Suites, results: Path) -> tuple[str, bool]:
    """Play one planted defect on the real clock; it has to fail on the requirement that it violates."""
    planted = declaration.planted[index]
    one = _scenario(suites, planted.scenario)
    if one is None:  # somebody's own suites; the defect is planted for ours
        suites = load_suites()
        one = _scenario(suites, planted.scenario)
    if one is None:
        raise ControlFailed(
            f"{declaration.name}: planted defect {planted.says!r}: there is no scenario {planted.scenario!r}"
        )
    row = Row(declaration, planted.adapter, clock="real")
    folder = results / ".control"
    folder.mkdir(parents=True, exist_ok=True)
    ended: list[Ended] = []
    pool = Pool(folder / "worker.log", virtual=False, ended=ended.append, casualty=lambda _: None)
    for number in range(1, _ATTEMPTS + 1):  # as any other play: what is unclear on a busy host is played again
        stretch = min(2 ** (number - 1), 2 ** (ATTEMPTS - 1))
        pool.play([make_plan(one, row, suites, folder, attempt=number, stretch=stretch)], 1)
        verdict = judge(_without_excuse(read_trace(Path(ended[-1].plan.trace))))
        if verdict.verdict != "inconclusive":
            break
    else:
        return f'planted defect "{planted.says}" stayed unclear in {_ATTEMPTS} attempts: {verdict.reason}', False
    caught = any(planted.requirement in finding.proves for finding in verdict.failed())
    return f'planted defect "{planted.says}" is {"caught" if caught else "NOT caught"}', caught


def _without_excuse(trace: Trace) -> Trace:
    """The reference has no threads of its own that a busy host could have run late."""
    return Trace(trace.header, tuple(one for one in trace.records if not isinstance(one, Starved)))


def _scenario(suites: Suites, id_: str) -> Loaded | None:
    return next((one for one in suites.scenarios if one.scenario.id == id_), None)
