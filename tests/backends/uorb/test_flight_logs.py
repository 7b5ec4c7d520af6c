"""Real publication times of sensor_combined (PX4/pyulog test data), replayed on the virtual clock."""

from __future__ import annotations

import json
from collections import deque
from pathlib import Path
from typing import Any

import pytest

from nros_backends.uorb import UorbBackend
from nros_conformance.rmw.backend import Host, SessionOptions
from nros_conformance.rmw.clock import MS, VirtualClock
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import DeadlineClock
from nros_conformance.rmw.events import CountStatus
from nros_conformance.rmw.qos import DEFAULT, QosProfile

VECTORS = Path(__file__).parents[2] / "vectors" / "uorb"

DEADLINES = [  # log, deadline in ms, periods missed, gaps that miss
    ("auav_x21", 5, 43, 8),
    ("auav_x21", 8, 27, 8),
    ("auav_x21", 10, 21, 8),
    ("auav_x21", 20, 8, 6),
    ("auav_x21", 30, 5, 4),
    ("cubeorange", 5, 32, 1),
    ("cubeorange", 30, 5, 1),
    ("fmu_v4pro", 5, 4, 2),
    ("fmu_v4pro", 10, 1, 1),
    ("sitl", 5, 0, 0),
]


def _gaps(log: str) -> list[int]:
    """Nanoseconds between consecutive samples."""
    topics = json.loads((VECTORS / f"px4_log_{log}.json").read_text(encoding="utf-8"))["topics"]
    (topic,) = (topic for topic in topics if topic["topic"] == "sensor_combined")
    assert len(topic["dt_us"]) == topic["n"] - 1
    return [gap * 1000 for gap in topic["dt_us"]]


@pytest.mark.parametrize(("log", "period_ms", "missed", "late_gaps"), DEADLINES)
def test_deadlines_missed_in_a_flight(log: str, period_ms: int, missed: int, late_gaps: int) -> None:
    gaps, period = _gaps(log), period_ms * MS
    clock, deadline = VirtualClock(), DeadlineClock(period)
    deadline.restart(clock.now_ns())
    reports: list[CountStatus] = []
    for gap in gaps:
        clock.wait(None, clock.now_ns() + gap)
        deadline.restart(clock.now_ns())
        status = deadline.misses.take()
        if status is not None:
            reports.append(status)
    assert sum(status.total_count_change for status in reports) == missed
    assert sum(-(-gap // period) - 1 for gap in gaps) == missed
    assert len(reports) == late_gaps


def _consumer(gaps: list[int], depth: int, every: int) -> tuple[int, int]:
    """Received and lost by a reader that takes everything each ``every`` ns, first principles."""
    times = [0]
    for gap in gaps:
        times.append(times[-1] + gap)
    received = lost = 0
    pending: deque[int] = deque(times)
    for look in range(every, times[-1] + 2 * every, every):
        arrived = 0
        while pending and pending[0] < look:
            pending.popleft()
            arrived += 1
        received += min(arrived, depth)
        lost += max(arrived - depth, 0)
    return received, lost


@pytest.mark.parametrize(
    ("depth", "every_ms", "received", "lost"),
    [(1, 20, 3441, 13629), (4, 20, 13737, 3333), (5, 20, 17012, 58), (10, 50, 13748, 3322)],
)
def test_a_slow_consumer_of_a_flight_loses_what_it_does_not_read(
    depth: int, every_ms: int, received: int, lost: int
) -> None:
    gaps, every = _gaps("auav_x21"), every_ms * MS
    clock = VirtualClock()
    session = UorbBackend(Host(clock)).create_session(SessionOptions())
    publisher = session.create_publisher("/sensor_combined", "SensorCombined", DEFAULT)
    subscription = session.create_subscription("/sensor_combined", "SensorCombined", QosProfile(depth=depth))
    reports: list[Any] = []
    subscription.register_event(2, 0, lambda kind, status, context: reports.append(status), None)
    taken: list[int] = []

    def fly() -> None:
        for number in range(len(gaps) + 1):
            assert publisher.publish_raw(number.to_bytes(4, "big")) == ReturnCode.OK
            if number < len(gaps):
                clock.wait(None, clock.now_ns() + gaps[number])

    def consume() -> None:
        start = clock.now_ns()
        flight = clock.spawn("flight", fly)
        look = start + every
        while True:
            clock.wait(None, look)
            over = flight.done.is_set()
            session.drive_io(0)
            while isinstance(sample := subscription.try_recv_raw(4), bytes):
                taken.append(int.from_bytes(sample, "big"))
            if over:
                assert flight.error is None
                return
            look += every

    clock.run(consume)
    assert taken == sorted(set(taken))
    assert len(taken) + reports[-1].total_count == 17070
    assert (len(taken), reports[-1].total_count) == _consumer(gaps, depth, every) == (received, lost)
