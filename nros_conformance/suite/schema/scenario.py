"""A scenario, and a file of them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import Meta

from nros_conformance.formats.durations import Duration
from nros_conformance.suite.schema.cast import Entity, Session
from nros_conformance.suite.schema.steps import Reaction
from nros_conformance.suite.schema.words import Base, Identifier, KindName, Profile, ScenarioId


class Needs(Base, frozen=True, kw_only=True):
    """What a backend must have for this scenario to apply, or to be playable."""

    claims: list[KindName] = []
    """Events that it must claim; those of the expectations are added by themselves."""
    declares: dict[str, Any] = {}
    """Fields of the declaration and the value that they must have, such as ``callback_cap: true``."""
    clock: Literal["any", "real", "virtual"] = "any"
    process: Literal["shared", "alone", "own"] = "shared"
    """``alone``: nothing else plays in its process meanwhile, because it times calls; ``own``: a process of its own,
    before and after too, because it counts what a process has."""


class Scale(Base, frozen=True, kw_only=True):
    """The unit that durations are multiples of."""

    T: Duration = Duration.parse("130ms")


class Scenario(Base, frozen=True, kw_only=True):
    """One scenario, its parameters already put in."""

    id: ScenarioId
    title: str
    profile: Profile = "standard"
    scale: Scale = Scale()
    needs: Needs = Needs()
    canonical: KindName | None = None
    """This scenario is the stimulus that decides whether a claimed event works at all."""
    refusal: KindName | None = None
    """This scenario is the proof that an event which is not claimed is absent. Plays only then."""
    peer: Literal["present", "absent"] = "present"
    """``absent``: the agent, router or broker is not there until a ``start`` step. Sessions without a
    reconnector are then created together with the first entity that is created on them."""
    sessions: dict[Identifier, Session] = {}
    entities: dict[Identifier, Entity]
    script: list[Any]
    react: list[Reaction] = []
    given: list[Any] = []
    expect: list[Any]


class SuiteFile(Base, frozen=True, kw_only=True):
    """A file of ``suites/``."""

    suite: Annotated[str, Meta(pattern=r"^[a-z_]+$")]
    title: str
    scenarios: list[Any]
