"""Detection pieces that adapters compose: counters, a deadline clock, gap and liveliness trackers.

Each is plain bookkeeping over times and identities that the adapter hands in. A *source* is one of
them seen by the ready queue: `take` yields the status for the next callback, or None when nothing
has changed since the last one, so that several occurrences coalesce into one callback (CNT-006).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from typing import NamedTuple, Protocol

from nros_conformance.rmw.clock import NEVER
from nros_conformance.rmw.events import CountStatus, EventStatus, LivelinessChangedStatus

U16, U32 = 2**16, 2**32

_GAPS = 64
"""Gaps of a publisher that late samples may fill; older ones stay losses."""


class Source(Protocol):
    """What can become an event."""

    @property
    def ready_ns(self) -> int | None:
        """Since when an unreported occurrence waits; None when there is none."""

    def take(self) -> EventStatus | None:
        """The status to report now; afterwards nothing is pending."""


class CountTracker:
    """A cumulative total and what of it has been reported (CNT-001, CNT-002).

    At the limit of u32 it saturates; the change stays true (CNT-007).
    """

    def __init__(self) -> None:
        self.total = 0
        self.reports = 0
        """How often `take` has reported something."""
        self._reported = 0
        self._since: int | None = None

    def add(self, count: int, at_ns: int) -> None:
        """Note ``count`` occurrences, the first of them at ``at_ns``."""
        if count <= 0:
            return
        self.total += count
        if self._since is None:
            self._since = at_ns

    def retract(self, count: int) -> None:
        """Take back ``count`` occurrences that have not been reported; what was reported stays (CNT-001)."""
        self.total -= min(count, self.total - self._reported)
        if self.total == self._reported:
            self._since = None

    def preset(self, total: int) -> None:
        """The fault ``preset``: a total as if so much had been counted; what is pending stays pending."""
        self.total, self._reported = total, self._reported + total - self.total

    @property
    def ready_ns(self) -> int | None:
        return self._since

    def take(self) -> CountStatus | None:
        if self._since is None:
            return None
        change, self._reported, self._since = self.total - self._reported, self.total, None
        self.reports += 1
        return CountStatus(min(self.total, U32 - 1), min(change, U32 - 1))


class DeadlineClock:
    """Counts the periods that have elapsed since a sample; exact, however rarely it is looked at.

    Not armed before the first `restart` (C03: ``first_sample``), so nothing is missed before it.
    """

    def __init__(self, period_ns: int) -> None:
        self.period_ns = period_ns
        self.misses = CountTracker()
        self._anchor: int | None = None
        self._counted = 0

    def restart(self, at_ns: int) -> None:
        """A sample came (or went) at ``at_ns``: misses before it are counted, then a new period begins.

        A sample at the very moment of the deadline is in time.
        """
        self.update(at_ns - 1)
        self._anchor, self._counted = at_ns, 0

    def update(self, now_ns: int) -> None:
        """Count the periods that have elapsed by ``now_ns``."""
        if self._anchor is None:
            return
        elapsed = (now_ns - self._anchor) // self.period_ns
        if elapsed > self._counted:
            self.misses.add(elapsed - self._counted, self.next_due_ns)
            self._counted = elapsed

    @property
    def next_due_ns(self) -> int:
        """When the next miss falls due; `NEVER` while not armed."""
        if self._anchor is None:
            return NEVER
        return self._anchor + (self._counted + 1) * self.period_ns


class _Gap(NamedTuple):
    """Samples counted as lost, as long as `CountTracker.reports` stays the same."""

    first: int
    length: int
    reports: int


class GapTracker:
    """Samples lost between delivered ones, by per-publisher sequence number (MSL-003).

    The first sample of a publisher synchronises; duplicates and reordering are not loss (MSL-004): the loss of a
    sample that comes after all is taken back as long as it was not reported. Reported it stays, since totals
    never decrease (CNT-001); where samples are often overtaken, hold gaps back for a while before counting them.
    """

    def __init__(self, modulus: int = U32) -> None:
        self.losses = CountTracker()
        self._modulus = modulus
        self._last: dict[Hashable, int] = {}
        self._gaps: dict[Hashable, deque[_Gap]] = {}

    def sample(self, publisher: Hashable, sequence: int, at_ns: int) -> int:
        """Note a received sample; by how much it changes what is lost: -1 when it was counted and comes after all."""
        last = self._last.get(publisher)
        step = 1 if last is None else (sequence - last) % self._modulus
        if step == 0:
            return 0  # a duplicate
        if step > self._modulus // 2:
            return -self._fill(publisher, sequence)
        self._last[publisher] = sequence
        if step > 1:
            gaps = self._gaps.setdefault(publisher, deque(maxlen=_GAPS))
            gaps.append(_Gap((sequence - step + 1) % self._modulus, step - 1, self.losses.reports))
            self.losses.add(step - 1, at_ns)
        return step - 1

    def forget(self, publisher: Hashable) -> None:
        """The publisher is gone or has restarted: its next sample synchronises again, what is lost stays lost."""
        self._last.pop(publisher, None)
        self._gaps.pop(publisher, None)

    def _fill(self, publisher: Hashable, sequence: int) -> int:
        """1 when this older sample was counted as lost and not reported yet."""
        gaps = self._gaps.get(publisher, ())
        for index, gap in enumerate(gaps):
            offset = (sequence - gap.first) % self._modulus
            if offset < gap.length and gap.reports == self.losses.reports:
                self.losses.retract(1)
                rest = _Gap((sequence + 1) % self._modulus, gap.length - offset - 1, gap.reports)
                parts = [part for part in (gap._replace(length=offset), rest) if part.length]
                kept = [*gaps]
                kept[index : index + 1] = parts
                self._gaps[publisher] = deque(kept, maxlen=_GAPS)
                return 1
        return 0


def _i16(change: int) -> int:
    return max(-U16 // 2, min(change, U16 // 2 - 1))


class LivelinessTally:
    """Numbers of alive and not alive publishers, and what of them has been reported (CNT-004).

    The change fields are differences against the last report, so transitions that cancel out
    between two reports leave no callback (CNT-003). At the limits of u16 and i16 they saturate; a
    publisher that comes still shows in the change (CNT-007).
    """

    def __init__(self) -> None:
        self.alive = 0
        self.not_alive = 0
        self._reported = (0, 0)
        self._since: int | None = None

    def add(self, alive: int, not_alive: int, at_ns: int) -> None:
        """Note a transition: how either number changed at ``at_ns``."""
        self.set(self.alive + alive, self.not_alive + not_alive, at_ns)

    def set(self, alive: int, not_alive: int, at_ns: int) -> None:
        """Note the numbers as they are, for middleware that reports them."""
        self.alive, self.not_alive = alive, not_alive
        if (alive, not_alive) == self._reported:
            self._since = None
        elif self._since is None:
            self._since = at_ns

    def preset(self, alive: int) -> None:
        """The fault ``preset``: an alive_count as if so many had come; what is pending stays pending."""
        reported, not_alive = self._reported
        self.alive, self._reported = alive, (reported + alive - self.alive, not_alive)

    @property
    def ready_ns(self) -> int | None:
        return self._since

    def take(self) -> LivelinessChangedStatus | None:
        if self._since is None:
            return None
        alive, not_alive = self._reported
        self._reported, self._since = (self.alive, self.not_alive), None
        return LivelinessChangedStatus(
            min(self.alive, U16 - 1),
            min(self.not_alive, U16 - 1),
            _i16(self.alive - alive),
            _i16(self.not_alive - not_alive),
        )


class LivelinessCounter(LivelinessTally):
    """A tally kept per publisher, for middleware that reports identities (LVC-006).

    Stale and duplicate notifications change nothing (LVC-009).
    """

    def __init__(self) -> None:
        super().__init__()
        self._state: dict[Hashable, bool] = {}

    def came(self, publisher: Hashable, at_ns: int) -> None:
        """The publisher is known and alive, or alive again."""
        self._move(publisher, True, at_ns)

    def fell_silent(self, publisher: Hashable, at_ns: int) -> None:
        """The lease of a known publisher has expired."""
        if publisher in self._state:
            self._move(publisher, False, at_ns)

    def left(self, publisher: Hashable, at_ns: int) -> None:
        """The publisher was destroyed in an orderly way (LVC-003)."""
        self._move(publisher, None, at_ns)

    def _move(self, publisher: Hashable, alive: bool | None, at_ns: int) -> None:
        before = self._state.get(publisher)
        if alive is None:
            self._state.pop(publisher, None)
        else:
            self._state[publisher] = alive
        self.add((alive is True) - (before is True), (alive is False) - (before is False), at_ns)
