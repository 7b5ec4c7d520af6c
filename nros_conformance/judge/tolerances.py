"""The judge's tolerances: the one place that sets their numbers."""

from __future__ import annotations

from typing import Literal

from nros_conformance.rmw.clock import MS

LATE_SHARE, LATE_FLOOR_NS = (3, 10), 30 * MS
"""0.3 T. The floor: with a fixed 20 ms a correct backend failed in 9 % of the runs on a busy host."""

EARLY_SHARE, EARLY_FLOOR_NS = (1, 20), 2 * MS
"""0.05 T. The floor: the ABI counts whole milliseconds, so either end of a period may be rounded by one."""

SMALLEST_T_NS = 100 * MS
"""Below this the floor of ``late`` would be a large part of a period."""


def tolerances(clock: Literal["real", "virtual"], T_ns: int) -> tuple[int, int]:  # noqa: N803 - T is the scale's name
    """(late, early) for a scale of ``T_ns``, both in ns; 0 on the virtual clock, where nothing disturbs.

    >>> tolerances("real", 130 * MS)
    (39000000, 6500000)
    """
    if clock == "virtual":
        return 0, 0
    return (
        max(T_ns * LATE_SHARE[0] // LATE_SHARE[1], LATE_FLOOR_NS),
        max(T_ns * EARLY_SHARE[0] // EARLY_SHARE[1], EARLY_FLOOR_NS),
    )


def smallest_T(clock: Literal["real", "virtual"], declared_minimum_ns: int) -> int:  # noqa: N802
    """The smallest scale to play with, ns; ``declared_minimum_ns`` is the shortest period that the backend takes."""
    return declared_minimum_ns if clock == "virtual" else max(SMALLEST_T_NS, declared_minimum_ns)
