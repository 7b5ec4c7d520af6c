from __future__ import annotations

from datetime import timedelta

from nros_conformance.node import Context, Executor, Publisher, Subscription
from nros_conformance.rmw.qos import DEFAULT, Liveliness, QosProfile

TYPE = "std_msgs/msg/String"
TOPIC = "/chatter"
MANUAL = QosProfile(liveliness=Liveliness.MANUAL_BY_TOPIC, lease_ms=100)


def ms(number: float) -> timedelta:
    return timedelta(milliseconds=number)


class Pair:
    """A talker and a listener, each on a node of its own, and one executor that drives both."""

    def __init__(self, context: Context) -> None:
        self.clock = context.clock
        self.talker = context.create_node("talker")
        self.listener = context.create_node("listener")
        self.executor = Executor(self.listener, self.talker)

    def publisher(self, qos: QosProfile = DEFAULT) -> Publisher:
        return self.talker.create_publisher(TYPE, TOPIC, qos)

    def subscription(self, qos: QosProfile = DEFAULT) -> Subscription:
        return self.listener.create_subscription(TYPE, TOPIC, qos=qos)
