"""What a worker is told to play, and how long it should take."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from msgspec import Struct

from nros_conformance.rmw.clock import MS
from nros_conformance.suite import schema
from nros_conformance.trace.records import Header

HANG_NS = 5_000 * MS
"""Generous: the slowest call that a busy host delayed in our measurements took 0.4 s, and a hang costs
the run only this wait."""


CYCLE_NS = 20 * MS
"""What the calls of a cycle may take, several times what a Cyclone session takes to come and go (6 ms)."""
_PATIENCE = 16
"""What waits for an answer rarely lasts as long as it may: with a sixteenth the plays of every row add up to what they
took. The watchdog of a play allows four times of all, and a minute."""


class Plan(Struct, frozen=True, kw_only=True):
    """One play: a header to complete, an adapter, a place in the host's network, a file for the trace."""

    key: str
    adapter: str
    header: Header
    trace: str
    network: int = 0
    ports: tuple[int, int] = (0, 0)
    options: dict[str, str] = {}
    expected_ns: int = 0
    hang_ns: int = HANG_NS
    """How long after its time a call may return before it counts as hanging."""


def expected_ns(steps: Iterable[object], quantities: Mapping[str, int]) -> int:
    """How long the script takes when nothing is late, ns; the branches of a parallel side by side."""
    total = 0
    for step in steps:
        match step:
            case schema.Drive(drive=duration) | schema.Idle(idle=duration) | schema.Phase(phase=duration):
                total += duration.ns(quantities)
            case schema.Cycle(cycle=times, script=script):
                total += times * (expected_ns(script, quantities) + CYCLE_NS)
            case schema.Until(limit=limit):
                total += limit.ns(quantities) // _PATIENCE
            case schema.Repeat(repeat=times, script=script):
                total += times * expected_ns(script, quantities)
            case schema.Ping():
                waits = step.attempts * step.timeout.ns(quantities) // _PATIENCE
                total += step.times * max(step.every.ns(quantities), waits)
            case schema.Parallel(parallel=branches):
                total += max((expected_ns(branch, quantities) for branch in branches), default=0)
            case schema.Call() | schema.Spin():
                total += step.times * max(step.every.ns(quantities), step.timeout.ns(quantities))
            case schema.Repeated():
                total += (step.times - 1) * step.every.ns(quantities)
    return total
