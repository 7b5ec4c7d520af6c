"""Searches for a timeline that a backend plays otherwise than the model, and shrinks it."""

from __future__ import annotations

import contextlib
import dataclasses
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from nros_conformance.campaign.plans import Row, make_plan
from nros_conformance.explore.timelines import VERBS, Action, Timeline, scenario
from nros_conformance.judge.judge import judge
from nros_conformance.judge.results import Verdict
from nros_conformance.play.player import play
from nros_conformance.rmw.backend import Backend
from nros_conformance.rmw.clock import MS, Deadlock, MonotonicClock, VirtualClock
from nros_conformance.rmw.events import EventKind
from nros_conformance.suite.loader import Loaded, Suites, typed
from nros_conformance.trace.records import AnyRecord, End, Header, Trace

if TYPE_CHECKING:
    from hypothesis.strategies import SearchStrategy

SLACK_NS = {"virtual": 30 * MS, "real": 45 * MS}
"""By how much a play may be behind its timeline: creating four entities and pausing, each up to a drive of 5 ms; on
the real clock as much again as the judge allows for, and a drive."""

COMPOSED = "x.explored"
_PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9_.-]*( [-+] [0-9.]+T)?|[0-9.]+(T|ms)")


class HypothesisMissing(Exception):
    """The optional package is not installed; the text says how to install it."""

    def __init__(self) -> None:
        super().__init__('explore needs hypothesis; install it: pip install "nros-conformance[explore]"')


class _Violation(Exception):
    """Tells Hypothesis that an example fails."""


@dataclasses.dataclass(frozen=True, slots=True)
class Deviation:
    """The shortest timeline that was found, its scenario, and what the judge says."""

    timeline: Timeline
    scenario: dict[str, Any]
    verdict: Verdict


@dataclasses.dataclass(slots=True)
class Search:
    """What came of it. ``played`` counts the shrinking too."""

    played: int = 0
    found: Deviation | None = None


class Stand:
    """A backend on which timelines are played."""

    def __init__(self, row: Row, adapter: type[Backend], suites: Suites) -> None:
        self.row = row
        self.adapter = adapter
        self.suites = suites
        declaration = row.declaration
        self.kinds = tuple(kind for kind in EventKind if declaration.claims()[kind.label] != "no")
        self.verbs = tuple(
            verb for verb in VERBS
            if (verb != "lose" or "lose" in declaration.faults)
            and (verb != "assert" or declaration.event(EventKind.LIVELINESS_LOST).manual)
        )  # fmt: skip
        self.slack_ns = SLACK_NS["virtual" if row.virtual else "real"]

    def compose(self, timeline: Timeline) -> dict[str, Any]:
        """The scenario of a timeline."""
        return scenario(timeline, slack_ns=self.slack_ns)

    def play(self, timeline: Timeline) -> Verdict:
        """Play and judge it."""
        raw = self.compose(timeline)
        one = Loaded(COMPOSED, typed(raw), raw, "explored", "", {})
        plan = make_plan(one, self.row, self.suites, Path())
        records: list[Header | AnyRecord] = []
        if self.row.virtual:
            clock = VirtualClock()
            try:
                clock.run(lambda: play(plan, self.adapter, clock, records.append))
            except Deadlock as deadlock:
                records.append(End(outcome="hang", t=clock.now_ns(), detail=str(deadlock)))
        else:
            play(plan, self.adapter, MonotonicClock(), records.append)
        header, *rest = records
        assert isinstance(header, Header)
        return judge(Trace(header, tuple(rest)))  # type: ignore[arg-type]


def explore(stand: Stand, examples: int, seed: int, watch: Callable[[int], None] = lambda played: None) -> Search:
    """Play so many generated timelines, or until one fails; that one is shrunk. The same seed, the same search.

    Raises `HypothesisMissing`.
    """
    search = Search()

    def one(timeline: Timeline) -> None:
        timeline = timeline.sensible()
        search.played += 1
        watch(search.played)
        verdict = stand.play(timeline)
        if verdict.verdict == "fail":
            search.found = Deviation(timeline, stand.compose(timeline), verdict)
            raise _Violation

    with contextlib.suppress(_Violation):
        _run(one, stand.kinds, stand.verbs, examples, seed)
    return search


def compare(first: Stand, second: Stand, examples: int, seed: int) -> dict[str, tuple[int, int, Timeline]]:
    """The same timelines on two backends: how often each failed on a requirement where the other one did not.

    With the shortest timeline that shows it. Only what both claim and can do is played.
    """
    differences: dict[str, tuple[int, int, Timeline]] = {}

    def one(timeline: Timeline) -> None:
        timeline = timeline.sensible()
        failed = [_failed(stand.play(timeline)) for stand in (first, second)]
        for requirement in failed[0] ^ failed[1]:
            here, there, shortest = differences.get(requirement, (0, 0, timeline))
            shortest = min(shortest, timeline, key=lambda one: len(one.actions))
            fails = [requirement in one for one in failed]
            differences[requirement] = here + fails[0], there + fails[1], shortest

    kinds = tuple(kind for kind in first.kinds if kind in second.kinds)
    _run(one, kinds, tuple(verb for verb in first.verbs if verb in second.verbs), examples, seed)
    return dict(sorted(differences.items()))


def _failed(verdict: Verdict) -> frozenset[str]:
    return frozenset(id_ for finding in verdict.failed() for id_ in finding.proves)


def _run(
    one: Callable[[Timeline], None], kinds: Sequence[EventKind], verbs: Sequence[str], examples: int, seed: int
) -> None:
    try:
        import hypothesis
    except ImportError:
        raise HypothesisMissing from None
    settings = hypothesis.settings(
        max_examples=examples, database=None, deadline=None, print_blob=False,
        phases=(hypothesis.Phase.generate, hypothesis.Phase.shrink), report_multiple_bugs=False,
        suppress_health_check=tuple(hypothesis.HealthCheck), verbosity=hypothesis.Verbosity.quiet,
    )  # fmt: skip
    hypothesis.seed(seed)(settings(hypothesis.given(_timelines(kinds, verbs))(one)))()


def _timelines(kinds: Sequence[EventKind], verbs: Sequence[str]) -> SearchStrategy[Timeline]:
    from hypothesis import strategies

    most = {"drive": 6, "idle": 8, "publish": 6, "lose": 4}
    what = [(verb, subject) for verb in verbs for subject in VERBS[verb]]
    what += [one for one in what if one[0] in ("drive", "idle", "publish", "lose")] * 2  # what most is about
    actions = strategies.sampled_from(what).flatmap(
        lambda one: strategies.builds(
            Action, strategies.just(one[0]), strategies.just(one[1]), strategies.integers(1, most.get(one[0], 1))
        )
    )
    together = tuple(kinds)
    registered = strategies.sampled_from([together, *((kind,) for kind in kinds), *[together] * len(kinds)])
    length = strategies.sampled_from([0, 6])  # left alone, most lists are very short
    return strategies.builds(
        Timeline,
        length.flatmap(lambda least: strategies.lists(actions, min_size=least, max_size=14)).map(tuple),
        registered,
    )


def as_suite(deviation: Deviation) -> str:
    """A suite file with the one scenario, ready to be played."""
    raw = deviation.scenario
    lines = [
        "suite: explored", "title: What exploring has found", "scenarios:", f"  - id: {raw['id']}",
        f"    title: {raw['title']}", f"    scale: {_flow(raw['scale'])}", f"    sessions: {_flow(raw['sessions'])}",
        "    entities:",
    ]  # fmt: skip
    lines += [f"      {name}: {_flow(entity)}" for name, entity in raw["entities"].items()]
    for part in ("script", "expect"):
        lines += [f"    {part}:", *(f"      - {_flow(step)}" for step in raw[part])]
    return "\n".join(lines) + "\n"


def _flow(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    if isinstance(value, str) and _PLAIN.fullmatch(value):
        return value
    return msgspec.json.encode(value).decode()
