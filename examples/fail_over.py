"""Drone bridge: fail over when the commander falls silent, and back when it returns.

The pattern "Drone-bridge fail-over on liveliness loss" of the nano-ros book, ``status-events.md``. A
backend that does not report LivelinessChanged gets the fallback that the book asks for: the
application watches the data itself. Exit code 0: failed over and back; 1: it did not.

    python examples/fail_over.py [--backend cyclone]
"""

import argparse
import os
import sys
from collections.abc import Callable
from datetime import timedelta

from nros_conformance.node import Context, Executor, Node, Publisher
from nros_conformance.rmw.backend import Host
from nros_conformance.rmw.clock import MS, MonotonicClock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import EventKind, LivelinessChangedStatus
from nros_conformance.rmw.qos import Liveliness, QosProfile

TYPE, TOPIC = "px4_msgs/msg/VehicleAttitude", "/vehicle_attitude"
EVERY = timedelta(milliseconds=20)
LEASE_MS = 300  # as long as that the commander may be silent
PATIENCE_MS = 650  # as long as that each act may take


class Bridge:
    """Runs on the companion computer, and acts when the flight controller does not."""

    def __init__(self, node: Node, say: Callable[[str], object]) -> None:
        self.clock = node.clock
        self.say = say
        self.commander_alive = False
        self.requested = self.cleared = 0
        self.heard_ns = 0
        subscription = node.create_subscription(TYPE, TOPIC, self.on_attitude)
        self.watches_data = not subscription.supports_event(EventKind.LIVELINESS_CHANGED)
        if self.watches_data:
            say(f"LivelinessChanged: unsupported, the bridge watches the data (no sample for {LEASE_MS} ms)")
        else:
            say("LivelinessChanged: supported, the middleware watches the commander")
            subscription.on_liveliness_changed(self.on_liveliness_changed)

    def on_liveliness_changed(self, status: LivelinessChangedStatus) -> None:
        if status.alive_count == 0:
            self.fail_over("alive_count 0")
        elif status.alive_count_change > 0:
            self.clear(f"alive_count {status.alive_count}")

    def on_attitude(self, data: bytes) -> None:
        self.heard_ns = self.clock.now_ns()
        if self.watches_data and not self.commander_alive:
            self.clear("a sample")

    def look(self) -> None:
        """The fallback, to be called regularly."""
        silent = self.clock.now_ns() - self.heard_ns > LEASE_MS * MS
        if self.watches_data and self.commander_alive and silent:
            self.fail_over(f"no sample for {LEASE_MS} ms")

    def fail_over(self, reason: str) -> None:
        self.commander_alive = False
        self.requested += 1
        self.say(f"bridge: minimum risk manoeuvre requested ({reason})")

    def clear(self, reason: str) -> None:
        self.commander_alive = True
        if self.requested > self.cleared:
            self.cleared = self.requested
            self.say(f"bridge: fail-over cleared ({reason})")
        else:
            self.say(f"bridge: commander is there ({reason})")


class Commander:
    """Stands in for PX4's commander. Publishing says that it is alive; silence is the loss."""

    def __init__(self, node: Node, say: Callable[[str], object]) -> None:
        self.node = node
        self.qos = QosProfile(liveliness=Liveliness.MANUAL_BY_TOPIC, lease_ms=LEASE_MS)
        try:
            self.publisher: Publisher | None = node.create_publisher(TYPE, TOPIC, self.qos)
        except RmwError as error:
            if error.code is not ReturnCode.INCOMPATIBLE_QOS:
                raise
            say("MANUAL_BY_TOPIC: refused, the commander leaves in place of falling silent")
            self.qos = QosProfile()
            self.publisher = node.create_publisher(TYPE, TOPIC, self.qos)

    def publish(self) -> None:
        if self.publisher is None:
            self.publisher = self.node.create_publisher(TYPE, TOPIC, self.qos)
        self.publisher.publish(b"attitude")

    def fall_silent(self) -> None:
        if self.publisher is not None and not self.qos.liveliness.is_manual:
            self.publisher.destroy()
            self.publisher = None


def run(context: Context, say: Callable[[str], object]) -> bool:
    """Play it; whether the bridge failed over and back."""
    bridge = Bridge(bridge_node := context.create_node("bridge"), say)
    commander = Commander(commander_node := context.create_node("commander"), say)
    # One thread drives both, so that this runs by itself. In earnest they are on two machines.
    executor = Executor(bridge_node, commander_node)

    def act(publishing: bool, done: Callable[[], bool]) -> bool:
        limit = context.clock.now_ns() + PATIENCE_MS * MS
        while not done() and context.clock.now_ns() < limit:
            if publishing:
                commander.publish()
            executor.spin(EVERY)
            bridge.look()
        return done()

    say("commander: publishes every 20 ms")
    worked = act(True, lambda: bridge.commander_alive)
    say("commander: falls silent")
    commander.fall_silent()
    worked = act(False, lambda: bridge.requested > 0) and worked
    say("commander: publishes again")
    worked = act(True, lambda: 0 < bridge.requested == bridge.cleared) and worked
    say(f"{'worked' if worked else 'failed'}: requested {bridge.requested}, cleared {bridge.cleared}")
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
