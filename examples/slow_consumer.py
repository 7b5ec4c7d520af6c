"""Slow consumer: what was dropped is logged, and received + lost = sent.

The pattern "Slow-consumer logging" of the nano-ros book, ``status-events.md``. A backend that does not
report MessageLost gets the fallback that the book asks for: the application numbers its frames and
counts the gaps. Exit code 0: the sum is right; 1: it is not.

    python examples/slow_consumer.py [--backend cyclone]
"""

import argparse
import os
import sys
from collections.abc import Callable

from nros_conformance.node import Context, Executor, Node
from nros_conformance.rmw.backend import Host
from nros_conformance.rmw.clock import MS, MonotonicClock
from nros_conformance.rmw.codes import RmwError
from nros_conformance.rmw.events import CountStatus, EventKind
from nros_conformance.rmw.qos import QosProfile

TYPE, TOPIC = "sensor_msgs/msg/PointCloud2", "/lidar"
FRAMES = 40
PERIOD_NS = 5 * MS
WORK_NS = 20 * MS  # for one frame: four more come meanwhile
DEPTH = 5
PATIENCE_NS = 500 * MS


class Consumer:
    """Takes a frame when it has time for it."""

    def __init__(self, node: Node, say: Callable[[str], object]) -> None:
        self.say = say
        self.received = self.lost = 0
        self.first = self.last = -1  # numbers of frames
        self.subscription = node.create_subscription(TYPE, TOPIC, qos=QosProfile(depth=DEPTH))
        self.counts_gaps = not self.subscription.supports_event(EventKind.MESSAGE_LOST)
        if self.counts_gaps:
            say("MessageLost: unsupported, the consumer counts the gaps between frames")
        else:
            say("MessageLost: supported, the middleware counts")
            self.subscription.on_message_lost(self.on_message_lost)

    def on_message_lost(self, status: CountStatus) -> None:
        self.dropped(status.total_count_change, status.total_count)

    def take(self) -> bool:
        """Take one frame, if there is one."""
        data = self.subscription.try_recv()
        if data is None:
            return False
        number = int.from_bytes(data, "little")
        if self.received == 0:
            self.first = number
        elif self.counts_gaps and number > self.last + 1:
            gap = number - self.last - 1
            self.dropped(gap, self.lost + gap)
        self.received += 1
        self.last = number
        return True

    def dropped(self, change: int, total: int) -> None:
        self.lost = total
        self.say(f"dropped {change} pointcloud frames (total: {total})")


def run(context: Context, say: Callable[[str], object]) -> bool:
    """Play it; whether no frame is unaccounted for."""
    clock = context.clock
    consumer = Consumer(mapper := context.create_node("mapper"), say)
    publisher = (lidar := context.create_node("lidar")).create_publisher(TYPE, TOPIC)
    executor = Executor(mapper, lidar)
    published = 0

    def publish() -> None:
        nonlocal published
        publisher.publish(published.to_bytes(4, "little"))
        published += 1

    # Until the first frame arrives nobody knows whether the two have met; what counts begins with it.
    begin = clock.now_ns()
    while consumer.received == 0 and clock.now_ns() < begin + PATIENCE_NS:
        publish()
        executor.spin(WORK_NS // MS, until=consumer.take)
    say(f"lidar: {FRAMES} frames, one every 5 ms; consumer: one every 20 ms, with room for {DEPTH}")
    begin = clock.now_ns()
    for number in range(FRAMES):
        clock.wait(None, begin + number * PERIOD_NS)  # the consumer works, and spins when it has finished
        publish()
        if (number + 1) * PERIOD_NS % WORK_NS == 0:
            executor.spin_once(1)
            consumer.take()
    say("lidar: stops; consumer: takes what is left")

    def accounted_for() -> bool:
        while consumer.take():
            pass
        return consumer.received + consumer.lost == published - consumer.first

    worked = executor.spin(PATIENCE_NS // MS, until=accounted_for) and consumer.received > 0 < consumer.lost
    sent = published - max(consumer.first, 0)
    say(
        f"{'worked' if worked else 'failed'}: received {consumer.received} + lost {consumer.lost}"
        f" = {consumer.received + consumer.lost}, sent {sent}"
    )
    return worked


def main() -> int:
    """Run it on the backend named on the command line; the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--backend", default="uorb", help="an installed one, or module:Class (default: uorb)")
    name = parser.parse_args().backend
    try:
        # A network of its own, so that two runs on one host do not meet.
        with Context(name, Host(MonotonicClock(), network=os.getpid())) as context:
            return 0 if run(context, print) else 1
    except RmwError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    sys.exit(main())
