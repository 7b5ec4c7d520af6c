"""100 Hz sensor with a deadline alarm at 15 ms: every late sample is counted, and nothing else.

The pattern "100 Hz sensor with deadline alarm" of the nano-ros book, ``status-events.md``, at its true
scale. A backend that does not report RequestedDeadlineMissed gets the fallback that the book asks for:
the application watches the time itself. Exit code 0: the total is that of the gaps between the samples;
1: it is not.

    python examples/deadline_alarm.py [--backend cyclone]
"""

import argparse
import itertools
import os
import sys
from collections.abc import Callable
from datetime import timedelta

from nros_conformance.node import Context, Executor, Node
from nros_conformance.rmw.backend import Host
from nros_conformance.rmw.clock import MS, MonotonicClock
from nros_conformance.rmw.codes import RmwError
from nros_conformance.rmw.events import CountStatus, EventKind

TYPE, TOPIC = "sensor_msgs/msg/Imu", "/imu"
DEADLINE = timedelta(milliseconds=15)
DEADLINE_NS = 15 * MS
PERIOD_NS = 10 * MS
STALL_NS = 100 * MS
SAMPLES = 30  # before the stall, and after it
JITTER_NS = 4 * MS  # between sending and receiving; with more, 10 ms could look like 15
PATIENCE_NS = 1_000 * MS


class Alarm:
    """The controller's side: counts what is late."""

    def __init__(self, node: Node, say: Callable[[str], object]) -> None:
        self.clock = node.clock
        self.say = say
        self.total = 0
        self.first: int | None = None  # number of the first sample that came
        self.last_ns: int | None = None
        self.counted = 0  # periods since then
        subscription = node.create_subscription(TYPE, TOPIC, self.on_sample)
        self.watches_time = not subscription.supports_event(EventKind.REQUESTED_DEADLINE_MISSED)
        if self.watches_time:
            say("RequestedDeadlineMissed: unsupported, the alarm watches the time")
        else:
            say("RequestedDeadlineMissed: supported, the middleware watches the time")
            subscription.on_requested_deadline_missed(DEADLINE, self.on_deadline_missed)

    def on_deadline_missed(self, status: CountStatus) -> None:
        if status.total_count_change > 0:
            self.late(status.total_count_change)

    def on_sample(self, data: bytes) -> None:
        if self.first is None:
            self.first = int.from_bytes(data, "little")
        self.look()
        self.last_ns, self.counted = self.clock.now_ns(), 0

    def look(self) -> None:
        """The fallback, to be called regularly."""
        if self.watches_time and self.last_ns is not None:
            elapsed = (self.clock.now_ns() - self.last_ns) // DEADLINE_NS
            if elapsed > self.counted:
                self.late(elapsed - self.counted)
                self.counted = elapsed

    def late(self, change: int) -> None:
        self.total += change
        self.say(f"IMU late: {change} missed deadlines (total {self.total})")


def run(context: Context, say: Callable[[str], object]) -> bool:
    """Play it; whether the total is right."""
    clock = context.clock
    alarm = Alarm(controller := context.create_node("controller"), say)
    publisher = (sensor := context.create_node("sensor")).create_publisher(TYPE, TOPIC)
    executor = Executor(controller, sensor)
    sent_ns: list[int] = []

    def publish() -> None:
        sent_ns.append(clock.now_ns())
        publisher.publish((len(sent_ns) - 1).to_bytes(4, "little"))

    def spin_until(when: int) -> None:
        while (left_ms := (when - clock.now_ns()) // MS) > 0:
            executor.spin_once(min(left_ms, 5))
            alarm.look()
        clock.wait(None, when)  # less than a millisecond

    begin = clock.now_ns()
    while alarm.first is None and clock.now_ns() < begin + PATIENCE_NS:
        publish()
        spin_until(sent_ns[-1] + PERIOD_NS)
    for act in ("IMU publishes every 10 ms", "IMU publishes every 10 ms again"):
        say(act)
        begin = clock.now_ns()
        for number in range(SAMPLES):
            spin_until(begin + number * PERIOD_NS)
            publish()
        if not act.endswith("again"):
            say("IMU stalls for 100 ms")
            spin_until(sent_ns[-1] + STALL_NS)
    spin_until(sent_ns[-1] + PERIOD_NS // 2)

    # Late are the periods that fit between two samples, and after the last one.
    moments = [*sent_ns[alarm.first or 0 :], clock.now_ns()]
    gaps = [later - earlier for earlier, later in itertools.pairwise(moments)]
    least = sum(max(gap - JITTER_NS, 0) // DEADLINE_NS for gap in gaps)
    most = sum((gap + JITTER_NS) // DEADLINE_NS for gap in gaps)
    worked = alarm.first is not None and least <= alarm.total <= most
    say(f"{'worked' if worked else 'failed'}: total {alarm.total}, the gaps between samples say {least} to {most}")
    return worked


def main() -> int:
    """Run it on the backend named on the command line; the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--backend", default="reference", help="an installed one, or module:Class (default: reference)")
    name = parser.parse_args().backend
    try:
        # A network of its own, so that two runs on one host do not meet.
        with Context(name, Host(MonotonicClock(), network=os.getpid())) as context:
            return 0 if run(context, print) else 1
    except RmwError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    sys.exit(main())
