"""Which samples to deliver, and how many are missing between them, by their publishers' numbers."""

from __future__ import annotations

import dataclasses

from nros_backends.zenoh.attachment import Attachment
from nros_conformance.rmw.clock import MS, NEVER
from nros_conformance.rmw.detection import CountTracker, GapTracker

HOLD_NS = 25 * MS
"""A gap counts as loss when it has stayed open for so long: what was overtaken on the way comes within it."""

_EARLY = 64
"""How far before the first sample of a publisher one may come that was overtaken by it."""

_MODULUS = 2**64


@dataclasses.dataclass(slots=True)
class _Publisher:
    last: int
    source_ns: int
    """Source time of the newest sample."""


@dataclasses.dataclass(slots=True)
class _Gap:
    gid: bytes
    numbers: range
    due_ns: int
    counts: bool
    filled: set[int] = dataclasses.field(default_factory=set)


class Numbers:
    """The bookkeeping of one subscription. Duplicates are not delivered; reordering is neither that nor loss."""

    def __init__(self) -> None:
        self.losses = CountTracker()
        self._gaps = GapTracker(_MODULUS)
        self._publishers: dict[bytes, _Publisher] = {}
        self._open: list[_Gap] = []

    def accept(self, sample: Attachment, at_ns: int, *, history: bool = False) -> bool:
        """Note a sample that came at ``at_ns``; whether it is to be delivered.

        ``history``: its publisher had kept it. What is older than the first of those had no place there.
        """
        gid, number = sample.gid, sample.number
        known = self._publishers.get(gid)
        if known is None:
            self._publishers[gid] = _Publisher(number, sample.source_ns)
            self._gaps.sample(gid, number % _MODULUS, at_ns)
            if not history:
                self._leave_open(gid, range(number - _EARLY, number), at_ns, counts=False)
            return True
        if number <= known.last:
            if self._fill(gid, number):
                return True
            begins_again = number < known.last or number == 1
            if not begins_again or sample.source_ns <= known.source_ns:
                return False  # a duplicate, or too late: it has been counted
            self._gaps.forget(gid)
            self._open = [gap for gap in self._open if gap.gid != gid or self._count(gap)]
        lost = self._gaps.sample(gid, number % _MODULUS, at_ns)
        if lost:
            self._leave_open(gid, range(number - lost, number), at_ns, counts=True)
        known.last, known.source_ns = number, max(sample.source_ns, known.source_ns)
        return True

    def resume(self, gid: bytes) -> None:
        """The publisher is out of sight: what it sends meanwhile is not lost, what it repeats then is no news."""
        self._gaps.forget(gid)

    def forget(self, gid: bytes) -> None:
        """The publisher has gone, and its samples cannot come again."""
        self._gaps.forget(gid)
        self._publishers.pop(gid, None)

    def preset(self, gid: bytes, number: int) -> None:
        """As if ``number`` had been the last one."""
        if gid in self._publishers:
            self._publishers[gid].last = number
            self._gaps.forget(gid)
            self._gaps.sample(gid, number % _MODULUS, 0)

    def update(self, now_ns: int) -> None:
        """Count the gaps that have stayed open."""
        if self._open and now_ns >= self.next_due_ns:
            self._open = [gap for gap in self._open if now_ns < gap.due_ns or self._count(gap)]

    @property
    def next_due_ns(self) -> int:
        """When the next gap becomes a loss."""
        return min((gap.due_ns for gap in self._open), default=NEVER)

    def _leave_open(self, gid: bytes, numbers: range, at_ns: int, *, counts: bool) -> None:
        self._open.append(_Gap(gid, numbers, at_ns + HOLD_NS, counts))

    def _fill(self, gid: bytes, number: int) -> bool:
        for gap in self._open:
            if gap.gid == gid and number in gap.numbers and number not in gap.filled:
                gap.filled.add(number)
                return True
        return False

    def _count(self, gap: _Gap) -> bool:
        """Count what it still lacks. False, so that it closes."""
        if gap.counts:
            self.losses.add(len(gap.numbers) - len(gap.filled), gap.due_ns - HOLD_NS)
        return False
