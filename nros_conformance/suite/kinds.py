"""What a scenario asks of a backend: event kinds to register and to claim, faults to inject."""

from __future__ import annotations

from collections.abc import Iterator

from nros_conformance.rmw.events import EventKind
from nros_conformance.suite.schema import (
    Conserved,
    Cycles,
    Expectation,
    Fault,
    Inside,
    Level,
    Never,
    Periodic,
    Scenario,
    Total,
)
from nros_conformance.suite.walk import base_name, expectations, moments, parts, steps


def claims_needed(scenario: Scenario) -> frozenset[str]:
    """The kinds that a backend must claim for this scenario to apply.

    Those that a positive expectation (periodic, total, level, inside), a reaction or a moment names,
    and ``needs.claims``.
    """
    named = {kind for kind, _, positive in _named(scenario) if positive}
    return frozenset(named | set(scenario.needs.claims))


def registered_kinds(scenario: Scenario, entity: str) -> list[str]:
    """The kinds that ``register: expected`` registers on an entity, in the order of their values.

    Those that expectations, reactions and moments name for it; ``conserved`` names MessageLost. ``ANY`` and
    ``of: ALL`` add nothing. For one of several, ``crowd[1]``, what names ``crowd`` counts too.
    """
    named = {kind for kind, name, _ in _named(scenario) if name == entity or base_name(entity) == name}
    if base_name(entity) == entity:
        named |= {kind for kind, name, _ in _named(scenario) if base_name(name) == entity}
    return [kind.label for kind in EventKind if kind.label in named]


def faults_needed(scenario: Scenario) -> frozenset[str]:
    """The faults that the script injects, also in parallel branches."""
    return frozenset(step.fault for _, step in steps(scenario) if isinstance(step, Fault))


def expected_kinds(expectation: Expectation) -> tuple[str, ...]:
    """The kinds that one expectation is about, without those of its moments; ``ANY`` is none of them."""
    if isinstance(expectation, Never):
        kinds = [expectation.never] if isinstance(expectation.never, str) else expectation.never
        return tuple(kind for kind in kinds if kind != "ANY")
    if isinstance(expectation, Periodic):
        return (expectation.periodic,)
    if isinstance(expectation, Total):
        return (expectation.total,)
    if isinstance(expectation, Inside):
        return (expectation.event,)
    if isinstance(expectation, Cycles) and expectation.event is not None:
        return (expectation.event,)
    if isinstance(expectation, Level):
        return (EventKind.LIVELINESS_CHANGED.label,)
    if isinstance(expectation, Conserved):
        return (EventKind.MESSAGE_LOST.label,)
    return ()


def expected_entities(expectation: Expectation) -> tuple[str, ...]:
    """The entities that `expected_kinds` are expected of; ``ALL`` is none of them."""
    if isinstance(expectation, (Never, Level)):
        names = [expectation.of] if isinstance(expectation.of, str) else expectation.of
        return tuple(name for name in names if name != "ALL")
    if isinstance(expectation, (Periodic, Total, Inside)):
        return (expectation.of,)
    if isinstance(expectation, Cycles) and expectation.of is not None:
        return (expectation.of,)
    if isinstance(expectation, Conserved):
        return (expectation.conserved,)
    return ()


def _named(scenario: Scenario) -> Iterator[tuple[str, str, bool]]:
    """Kind, entity, and whether the scenario is void unless it fires."""
    for _, expectation in expectations(scenario):
        positive = isinstance(expectation, (Periodic, Total, Level, Inside, Cycles))
        for kind in expected_kinds(expectation):
            for entity in expected_entities(expectation):
                yield kind, entity, positive
    for reaction in scenario.react:
        yield reaction.to, reaction.of, True
    for _, part in parts(scenario):
        for _, moment in moments(part):
            if moment.kind is not None:
                yield moment.kind, moment.label, True
