"""Delivery opportunities: when calls of drive_io of one session ended.

What was due at d is late only if it is still undelivered at the end of a call that ended at or after
d + late. Nothing is late because nobody drove.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence

from nros_conformance.judge.intervals import INF
from nros_conformance.trace.records import Spin

LAST = INF
"""Position of something that comes after all records."""


class Drives:
    """The spins of a session with their positions in the trace.

    A session is driven by one thread, which writes its records in the order in which things happened,
    so the position decides what was before what, however wide the intervals are.
    """

    def __init__(self, spins: Sequence[tuple[int, Spin]] = ()) -> None:
        self._positions = [position for position, _ in spins]
        self._ends = [spin.end for _, spin in spins]
        self._sures = [min(spin.sure, spin.end) for _, spin in spins]
        self.spins = [spin for _, spin in spins]

    def surely(self, position: int = LAST, when: int = INF, limit: int = INF, after: int = -1) -> int:
        """A moment at or after which a call certainly ended: the latest, -INF if there is none.

        Only calls that ended before the record at ``position`` (something that happened at ``when`` or
        later) and before ``limit``, and that are recorded behind position ``after``.
        """
        index = min(bisect_left(self._positions, position), bisect_left(self._ends, limit))
        best = self._sures[index - 1] if index and self._positions[index - 1] > after else -INF
        if index < len(self.spins) and self._positions[index] > after:
            # A record of several calls that goes on beyond the border: the last call that ended before it.
            spin = self.spins[index]
            border = limit if self._positions[index] < position else min(limit, when)
            if spin.calls > 1 and spin.longest and spin.begin + spin.longest < border:
                best = max(best, spin.begin, min(border, spin.end) - spin.gap - spin.longest - spin.wait)
        return best

    def maybe(self, position: int = LAST, when: int = INF, limit: int = INF, after: int = -1) -> int:
        """The latest moment at which such a call can have ended, -INF if there is none."""
        index = min(bisect_left(self._positions, position), bisect_left(self._sures, limit))
        best = min(self._ends[index - 1], limit) if index and self._positions[index - 1] > after else -INF
        if index < len(self.spins) and self._positions[index] > after:
            spin = self.spins[index]
            border = limit if self._positions[index] < position else min(limit, when)
            if spin.calls > 1 and spin.begin < border:
                best = max(best, min(border, spin.end))
        return best

    def read_by(self, t: int) -> int:
        """By when a call that began at ``t`` or later had ended, INF if there is none."""
        for spin in self.spins:
            many = spin.calls > 1 and spin.longest
            if spin.begin >= t:
                return min(spin.end, spin.begin + spin.longest) if many else spin.end
            if many and t + spin.gap + 2 * spin.longest <= spin.end:
                return t + spin.gap + 2 * spin.longest
        return INF

    def between(self, after: int, position: int) -> list[Spin]:
        """The spins recorded behind position ``after`` and before ``position``."""
        return self.spins[bisect_left(self._positions, after + 1) : bisect_left(self._positions, position)]

    def holding(self, position: int, before: int) -> Spin | None:
        """The spin that what is recorded at ``position`` happened in, if it is recorded before ``before``."""
        index = bisect_left(self._positions, position)
        return self.spins[index] if index < len(self.spins) and self._positions[index] < before else None
