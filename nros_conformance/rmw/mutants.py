"""Mutants: backends with one named defect each, which the suites have to expose.

Found through entry points of the group ``nros_conformance.mutants``; each names a function without arguments
that returns mutants of the backend whose name the entry point has.
"""

from __future__ import annotations

import dataclasses
import importlib.metadata
from collections.abc import Callable, Sequence

from nros_conformance.rmw.backend import Backend

GROUP = "nros_conformance.mutants"


@dataclasses.dataclass(frozen=True, slots=True)
class Mutant:
    """One defect. ``defect`` is its id in the list of defects, empty for one of our own invention."""

    name: str
    defect: str
    violates: str
    """The requirement that an expectation has to fail on."""
    says: str
    adapter: type[Backend]


def find_mutants() -> dict[str, tuple[Mutant, ...]]:
    """The mutants that are installed, by the name of the backend that they are derived from."""
    found = {}
    for entry in sorted(importlib.metadata.entry_points(group=GROUP), key=lambda entry: entry.name):
        make: Callable[[], Sequence[Mutant]] = entry.load()
        found[entry.name] = tuple(make())
    return found
