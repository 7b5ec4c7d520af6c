from __future__ import annotations

import pytest

from nros_conformance.rmw.clock import MS, NEVER, VirtualClock
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import CountTracker
from nros_conformance.rmw.dispatch import ReadyQueue
from nros_conformance.rmw.ends import ClockedEnd
from nros_conformance.rmw.events import EventKind, EventStatus
from nros_conformance.rmw.qos import INFINITE_MS, QosProfile

MISSED, LOST = EventKind.REQUESTED_DEADLINE_MISSED, EventKind.MESSAGE_LOST


class End(ClockedEnd):
    missed_kind: EventKind | None = MISSED

    def __init__(self, **qos: int) -> None:
        self.clock, self.ready, self.losses = VirtualClock(0), ReadyQueue(), CountTracker()
        profile = QosProfile(**qos)  # type: ignore[arg-type]
        super().__init__(self.clock, self.ready, "/topic", "Type", profile, {LOST: self.losses})
        self.seen: list[EventStatus] = []

    def destroy(self) -> int:
        self.registry.close()
        return ReturnCode.OK

    def listen(self, kind: int = MISSED, deadline_ms: int = 0) -> int:
        return self.register_event(kind, deadline_ms, lambda _, status, __: self.seen.append(status), None)

    def look(self, at_ms: int) -> list[EventStatus]:
        """What is reported up to that moment."""
        self.clock.wait(None, at_ms * MS)
        self.poll(self.clock.now_ns())
        self.ready.drain()
        seen, self.seen = self.seen, []
        return seen


class Deaf(End):
    missed_kind = None


def test_a_registered_deadline_counts_from_the_last_sample_of_before_it() -> None:
    end = End()
    end.moved(0)
    end.clock.wait(None, 50 * MS)
    assert end.listen(deadline_ms=20) == ReturnCode.OK
    assert end.next_due_ns() == 60 * MS  # the two periods before the registration do not count (RDM-008)
    assert (end.look(59), end.look(60)) == ([], [(1, 1)])


def test_nothing_is_due_without_a_deadline_or_a_sample() -> None:
    end = End()
    end.moved(0)
    assert (end.next_due_ns(), end.look(500)) == (NEVER, [])
    silent = End()
    silent.listen(deadline_ms=20)
    assert (silent.next_due_ns(), silent.look(500)) == (NEVER, [])


@pytest.mark.parametrize(("later", "due"), [(50, 70), (10, 30)])
def test_a_later_registration_brings_its_own_period_and_the_total_goes_on(later: int, due: int) -> None:
    end = End()
    end.listen(deadline_ms=20)
    end.moved(0)
    assert end.look(20) == [(1, 1)]
    end.moved(20 * MS)
    assert end.listen(deadline_ms=later) == ReturnCode.OK
    assert (end.look(due - 1), end.look(due)) == ([], [(2, 1)])


def test_what_was_missed_before_a_later_registration_is_reported_to_it() -> None:
    end = End()
    end.listen(deadline_ms=20)
    end.moved(0)
    end.clock.wait(None, 65 * MS)
    end.listen(deadline_ms=1000)
    assert end.look(66) == [(3, 3)]


def test_a_deadline_of_the_qos_is_not_changed_by_a_registration() -> None:
    end = End(deadline_ms=20)
    assert end.listen(deadline_ms=500) == ReturnCode.OK
    assert end.deadline is None  # the adapter, or its middleware, watches over that of the QoS


@pytest.mark.parametrize("deadline_ms", [-1, INFINITE_MS + 1, 0.5, None])
def test_a_deadline_that_the_abi_cannot_carry_is_refused(deadline_ms: int) -> None:
    end = End()
    assert end.listen(deadline_ms=deadline_ms) == ReturnCode.INVALID_ARGUMENT
    assert end.next_due_ns() == NEVER


def test_a_refused_registration_starts_no_clock() -> None:
    end = End()
    end.moved(0)
    assert end.register_event(MISSED, 20, None, None) == ReturnCode.INVALID_ARGUMENT
    assert end.listen(LOST, deadline_ms=20) == ReturnCode.OK
    assert end.next_due_ns() == NEVER


def test_an_end_without_missed_deadlines_refuses_them_and_reports_its_other_events() -> None:
    end = Deaf()
    assert (end.supports_event(MISSED), end.supports_event(LOST)) == (False, True)
    assert end.listen(deadline_ms=20) == ReturnCode.UNSUPPORTED
    end.listen(LOST)
    end.losses.add(2, 0)
    assert end.look(1) == [(2, 2)]


def test_after_its_end_it_is_closed() -> None:
    end = End()
    end.destroy()
    assert (end.closed, end.supports_event(MISSED)) == (True, False)
    assert end.listen(deadline_ms=20) == ReturnCode.INVALID_ARGUMENT
