"""Reconnection: an application that outlives its agent, however often and however fast that restarts.

The pattern "Reconnections and liveliness" of the micro-ROS documents: WAITING_AGENT, AGENT_AVAILABLE,
AGENT_CONNECTED, AGENT_DISCONNECTED, and again. `Reconnector` is the state machine; the application says what
to create. The agent here is one that the backend brings along, so that this runs by itself.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from datetime import timedelta

from nros_conformance.node import Context, LinkState, Node, Pace, Publisher, Reconnector
from nros_conformance.rmw.backend import Host, SessionOptions
from nros_conformance.rmw.clock import MonotonicClock
from nros_conformance.rmw.codes import ReturnCode, RmwError

TOPIC, TYPE = "/counter", "std_msgs/msg/Int32"
PACE = Pace(
    ping_timeout=timedelta(milliseconds=100), attempts=2,
    waiting=timedelta(milliseconds=100), connected=timedelta(milliseconds=100),
)  # fmt: skip
PATIENCE = timedelta(seconds=10)


class Counter:
    """Publishes numbers as long as it is connected, and hears its own."""

    def __init__(self, say: Callable[[str], object]) -> None:
        self.say = say
        self.sent = 0
        self.heard = 0
        self.publisher: Publisher | None = None

    def create(self, node: Node) -> None:
        self.publisher = node.create_publisher(TYPE, TOPIC)
        node.create_subscription(TYPE, TOPIC, self.take)

    def forget(self) -> None:
        self.publisher = None

    def take(self, data: bytes) -> None:
        self.heard = int.from_bytes(data, "little")

    def publish(self) -> None:
        if self.publisher is not None:
            self.sent += 1
            self.publisher.publish(self.sent.to_bytes(4, "little"))


def run(context: Context, say: Callable[[str], object]) -> bool:
    """Play it; whether data flowed after every restart."""
    agent = context.backend.environment()
    agent.start()
    options = SessionOptions(locator=agent.endpoint())
    if context.ping(100, options=options) == ReturnCode.UNSUPPORTED:
        agent.stop()
        say("ping: unsupported, this backend has no agent to lose")
        return False
    agent.stop()
    counter = Counter(say)
    link = Reconnector(
        context, "counter", counter.create, destroy=counter.forget, options=options, pace=PACE,
        changed=lambda change: say(f"client: {change.state.value}"),
    )  # fmt: skip

    def flows() -> bool:
        """Whether a number that is published from now on comes back."""
        first = counter.sent + 1

        def step() -> bool:
            if link.state is LinkState.AGENT_CONNECTED:
                try:
                    counter.publish()
                except RmwError as error:
                    link.failed(error)
            return counter.heard >= first

        return link.spin(PATIENCE, until=step)

    try:
        say("client: there is no agent")
        worked = not link.spin(timedelta(milliseconds=300), until=lambda: link.state is LinkState.AGENT_CONNECTED)
        for how in ("starts", "restarts at once", "restarts after half a second"):
            say(f"agent: {how}")
            agent.stop(kill=True)
            if how.endswith("second"):
                link.spin(timedelta(milliseconds=500))
            agent.start()
            worked = flows() and worked
            say("client: data flows" if worked else "client: no data")
        say(f"{'worked' if worked else 'failed'}: connected {link.connections} times")
        return worked
    finally:
        link.close()
        agent.stop()


def main() -> int:
    """Run it on the backend named on the command line; the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--backend", default="reference", help="an installed one, or module:Class (default: reference)")
    name = parser.parse_args().backend
    try:
        with Context(name, Host(MonotonicClock(), network=os.getpid())) as context:
            return 0 if run(context, print) else 1
    except RmwError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    sys.exit(main())
