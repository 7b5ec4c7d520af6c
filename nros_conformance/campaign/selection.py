"""Which scenarios a run plays on a backend, and why it leaves out the rest."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from types import MappingProxyType
from typing import Literal

from nros_conformance.formats.places import nearest
from nros_conformance.rmw.declaration import Declaration
from nros_conformance.suite.injections import injectable
from nros_conformance.suite.kinds import claims_needed, faults_needed
from nros_conformance.suite.loader import Loaded, Suites
from nros_conformance.suite.policies import unsupported
from nros_conformance.suite.schema import PROFILES, Profile, Scenario, Session
from nros_conformance.suite.walk import expectations, session_of


class SelectionError(Exception):
    """A name on the command line that nothing has."""


@dataclasses.dataclass(frozen=True, slots=True)
class Selection:
    """What the command line asks for; empty tuples mean everything."""

    profile: Profile = "standard"
    suites: tuple[str, ...] = ()
    scenarios: tuple[str, ...] = ()
    """Ids or keys, with ``*`` as in file names."""
    requirements: tuple[str, ...] = ()
    keys: frozenset[str] | None = None
    """Exactly these scenarios, whatever else is said."""

    @property
    def narrowed(self) -> bool:
        """Whether anything but the profile limits it."""
        return bool(self.suites or self.scenarios or self.requirements) or self.keys is not None

    @property
    def by_name(self) -> bool:
        """Whether it was narrowed by somebody, and not into the shares of one run."""
        return self.narrowed and self.keys is None

    def choose(self, suites: Suites) -> list[Loaded]:
        """The selected scenarios. Raises `SelectionError` for a name that fits nothing."""
        everything = suites.scenarios
        _known(self.suites, sorted({one.suite for one in everything}), "suite")
        _known(self.requirements, [one.id for one in suites.requirements], "requirement")
        for pattern in self.scenarios:
            if not any(_fits(one, pattern) for one in everything):
                raise SelectionError(_unknown(pattern, sorted({one.scenario.id for one in everything}), "scenario"))
        return [one for one in everything if self._chosen(one)]

    def _chosen(self, one: Loaded) -> bool:
        if self.keys is not None:
            return one.key in self.keys
        if self.scenarios:  # somebody who names a scenario means it, whatever its profile
            return any(_fits(one, pattern) for pattern in self.scenarios)
        return (
            PROFILES.index(one.scenario.profile) <= PROFILES.index(self.profile)
            and (not self.suites or one.suite in self.suites)
            and (not self.requirements or bool(set(self.requirements) & set(proven(one))))
        )


@dataclasses.dataclass(frozen=True, slots=True)
class Decision:
    """Whether a scenario is played on a backend, and the reason if not."""

    status: Literal["play", "not-applicable", "untested"]
    reason: str = ""


PLAY = Decision("play")


def decide(one: Loaded, declaration: Declaration, unavailable: Mapping[str, str] = MappingProxyType({})) -> Decision:
    """By the declaration, before anything runs. ``unavailable``: what host and options lack, by fault, and why."""
    scenario = one.scenario
    claims = declaration.claims()
    if scenario.refusal is not None and claims[scenario.refusal] != "no":
        return Decision("not-applicable", f"{scenario.refusal} is claimed")
    unclaimed = sorted(kind for kind in claims_needed(scenario) if claims[kind] == "no" and kind != scenario.refusal)
    if unclaimed:
        return Decision(
            "not-applicable", f"{', '.join(unclaimed)} {'is' if len(unclaimed) == 1 else 'are'} not claimed"
        )
    capabilities = declaration.capabilities()
    for name, value in scenario.needs.declares.items():
        if name not in capabilities:
            return Decision("untested", f"needs {name}, which no declaration can have")
        if not _declares(capabilities[name], value):
            return Decision("not-applicable", f"needs {name} = {_show(value)}; declared is {_show(capabilities[name])}")
    for name, entity in scenario.entities.items():
        lacking = [] if entity.may_fail else unsupported(entity.qos, declaration.qos.unsupported)
        if lacking:
            return Decision("not-applicable", f"{name} asks for {lacking[0]}, which is declared unsupported")
    if scenario.needs.clock not in ("any", declaration.behaviour.clock):
        return Decision("not-applicable", f"needs the {scenario.needs.clock} clock")
    together = _sessions(scenario)
    if together > 1 and declaration.behaviour.two_sessions == "second_fails":
        return Decision("untested", f"needs {together} sessions in one process, where a second one fails")
    missing = sorted(fault for fault in faults_needed(scenario) if not injectable(fault, declaration.faults))
    if missing:
        return Decision("untested", f"the fault {missing[0]} cannot be injected here")
    lost = sorted(faults_needed(scenario) & set(unavailable)) if declaration.behaviour.clock == "real" else []
    if lost:
        return Decision("untested", f"the fault {lost[0]} cannot be injected here: {unavailable[lost[0]]}")
    return PLAY


def proven(one: Loaded) -> tuple[str, ...]:
    """The requirements that its expectations name, in order, once each."""
    ids = (id_ for _, expectation in expectations(one.scenario) for id_ in expectation.requirements)
    return tuple(dict.fromkeys(ids))


def _sessions(scenario: Scenario) -> int:
    """How many share the process of the play."""
    named = {*scenario.sessions, *(session_of(entity) for entity in scenario.entities.values())}
    return sum(scenario.sessions.get(name, Session()).process != "own" for name in named)


def _declares(declared: object, wanted: object) -> bool:
    if isinstance(wanted, list):
        return any(_declares(declared, one) for one in wanted)
    return wanted in declared if isinstance(declared, list) else declared == wanted


def _show(value: object) -> str:
    if isinstance(value, list):
        return " or ".join(map(_show, value))
    return str(value).lower() if isinstance(value, bool) else str(value)


def _fits(one: Loaded, pattern: str) -> bool:
    plain = pattern.replace("[", "[[]")  # brackets are part of keys, not character classes
    return fnmatchcase(one.scenario.id, plain) or fnmatchcase(one.key, plain)


def _known(names: Iterable[str], known: Sequence[str], what: str) -> None:
    for name in names:
        if name not in known:
            raise SelectionError(_unknown(name, known, what))


def _unknown(name: str, known: Sequence[str], what: str) -> str:
    hint = nearest(name, known)
    return f"no {what} {name!r}" + (
        f"; {hint}" if hint.startswith("did you mean") else f"; see: nros-conformance list {what}s"
    )
