"""The parts of a typed scenario, with the path at which each one stands."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

from nros_conformance.formats.places import Path_
from nros_conformance.suite.moments import Moment
from nros_conformance.suite.schema import (
    AnyOf,
    Base,
    Cycle,
    Entity,
    Expectation,
    Parallel,
    Reaction,
    Repeat,
    Scenario,
    Step,
)


def steps(scenario: Scenario) -> Iterator[tuple[Path_, Step]]:
    """All steps, those of branches and repeats after the step that they belong to, those of reactions last."""
    yield from _steps(scenario.script, ("script",))
    for _, _, path, step in reaction_steps(scenario):
        yield path, step


def step_labels(scenario: Scenario) -> list[str]:
    """The label of each of `steps`: what ``as`` says, else its position, ``#3``."""
    return [step.as_ or f"#{number}" for number, (_, step) in enumerate(steps(scenario), 1)]


def reaction_steps(scenario: Scenario) -> Iterator[tuple[Path_, Reaction, Path_, Step]]:
    """The steps of reactions: path and reaction, path and step."""
    for index, reaction in enumerate(scenario.react):
        here = ("react", index)
        for path, step in _steps(reaction.script, (*here, "script")):
            yield here, reaction, path, step


def _steps(script: Sequence[Step], path: Path_) -> Iterator[tuple[Path_, Step]]:
    for index, step in enumerate(script):
        yield (*path, index), step
        if isinstance(step, Parallel):
            for number, branch in enumerate(step.parallel):
                yield from _steps(branch, (*path, index, "parallel", number))
        if isinstance(step, Cycle | Repeat):
            yield from _steps(step.script, (*path, index, "script"))


def givens(scenario: Scenario) -> Iterator[tuple[Path_, Base]]:
    """All givens."""
    return ((("given", index), given) for index, given in enumerate(scenario.given))


def expectations(scenario: Scenario) -> Iterator[tuple[Path_, Expectation]]:
    """All expectations, those of the groups of an ``any_of`` after the one that they belong to."""
    return _expectations(scenario.expect, ("expect",))


def _expectations(expect: Sequence[Expectation], path: Path_) -> Iterator[tuple[Path_, Expectation]]:
    for index, expectation in enumerate(expect):
        yield (*path, index), expectation
        if isinstance(expectation, AnyOf):
            for number, group in enumerate(expectation.any_of):
                yield from _expectations(group, (*path, index, "any_of", number))


def parts(scenario: Scenario) -> Iterator[tuple[Path_, Base]]:
    """All steps, givens and expectations."""
    return itertools.chain(steps(scenario), givens(scenario), expectations(scenario))


def fields(part: Base) -> Iterator[tuple[str, Any]]:
    """The fields of a part with their names in the suite."""
    for name, attribute in zip(part.__struct_encode_fields__, part.__struct_fields__, strict=True):
        yield name, getattr(part, attribute)


def moments(part: Base) -> Iterator[tuple[str, Moment]]:
    """The fields of a part that are moments."""
    return ((name, value) for name, value in fields(part) if isinstance(value, Moment))


def session_of(entity: Entity) -> str:
    """The session of an entity, the default filled in."""
    return entity.session or ("pub" if entity.publisher is not None else "sub")


def base_name(name: str) -> str:
    """The entity that ``crowd[2]`` belongs to: ``crowd``."""
    return name.split("[", 1)[0]


def members(name: str, entity: Entity) -> tuple[str, ...]:
    """The names of the entities that one entry stands for: itself, or with a count ``crowd[0]``..."""
    return (name,) if entity.count == 1 else tuple(f"{name}[{index}]" for index in range(entity.count))
