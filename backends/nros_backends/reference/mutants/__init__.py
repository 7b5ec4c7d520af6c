"""The reference with one defect each: what the suites have to expose."""

from __future__ import annotations

from nros_backends.reference.mutants import (
    connection,
    counters,
    deadlines,
    dispatch,
    liveliness_changed,
    liveliness_lost,
    losses,
    misuse,
    registration,
    removal,
)
from nros_conformance.rmw.mutants import Mutant

_SUBJECTS = (
    registration, dispatch, counters, deadlines, liveliness_changed, liveliness_lost, losses, misuse, connection,
    removal,
)  # fmt: skip


def all_mutants() -> tuple[Mutant, ...]:
    """All of them, in the order of subjects."""
    return tuple(mutant for subject in _SUBJECTS for mutant in subject.mutants())
