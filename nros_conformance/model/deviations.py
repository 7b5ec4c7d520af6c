"""Deviations that real middleware has from the reference semantics, each as the smallest change of the model.

A ``[[known]]`` entry of a declaration names one (``model = ...``), so that generated timelines can tell a known
deviation from a new one: what the deviating model does too is known, and nothing else.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from nros_conformance.model.world import Id, Occurrence, World


class ExpiredLeaseIgnoresAssertions(World):
    """A publisher whose lease has expired is alive again when it publishes, not when it asserts."""

    def assert_liveliness(self, id_: Id, at_ns: int) -> list[Occurrence]:
        found = list(self.advance(at_ns - 1))
        return found + (self._assert(id_, at_ns) if self._publishers[id_].alive else [])


DEVIATIONS: Mapping[str, type[World]] = MappingProxyType(
    {"expired_lease_ignores_assertions": ExpiredLeaseIgnoresAssertions}
)
"""By the name that declarations use."""


def deviating(names: Iterable[str]) -> type[World]:
    """The model with all of these deviations. Raises KeyError for a name that does not exist."""
    bases = tuple(DEVIATIONS[name] for name in dict.fromkeys(names))
    return type("Deviating", bases, {}) if bases else World
