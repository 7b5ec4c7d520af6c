"""A node: one session with the middleware, and the entities on it."""

from __future__ import annotations

from collections.abc import Callable

from nros_conformance.node.dispatcher import MAX_SAMPLE, DataCallback, Dispatcher
from nros_conformance.node.entities import Publisher, Subscription
from nros_conformance.node.errors import raise_for
from nros_conformance.rmw.backend import Session
from nros_conformance.rmw.clock import Clock
from nros_conformance.rmw.qos import DEFAULT, QosProfile


class Node:
    """Made by `Context.create_node`. To be used from the thread that spins it, and from callbacks."""

    def __init__(
        self, session: Session, name: str, clock: Clock, forget: Callable[[Node], object] = lambda node: None
    ) -> None:  # fmt: skip
        self.session = session
        self.name = name
        self.clock = clock
        self.dispatcher = Dispatcher(session)
        self._entities: set[Publisher | Subscription] = set()
        self._forget = forget
        self._destroyed = False

    def create_subscription(
        self, type_name: str, topic: str, callback: DataCallback | None = None, qos: QosProfile = DEFAULT,
        max_size: int = MAX_SAMPLE,
    ) -> Subscription:  # fmt: skip
        """A subscription; ``callback(data)`` is called for each sample from inside a spin.

        Without a callback, samples are taken with `Subscription.try_recv`. ``max_size``: room for one
        sample, bytes. Raises `RmwError` INCOMPATIBLE_QOS for a policy that the backend cannot honour
        (QOS-001), TOPIC_NAME_INVALID, INVALID_ARGUMENT, CONNECTION_FAILED.
        """
        handle = self.session.create_subscription(topic, type_name, qos)
        subscription = Subscription(handle, self.dispatcher, self._entities.discard, callback, max_size)
        self._entities.add(subscription)
        return subscription

    def create_publisher(self, type_name: str, topic: str, qos: QosProfile = DEFAULT) -> Publisher:
        """A publisher. Raises as `create_subscription` does."""
        handle = self.session.create_publisher(topic, type_name, qos)
        publisher = Publisher(handle, self.dispatcher, self._entities.discard)
        self._entities.add(publisher)
        return publisher

    def destroy(self) -> None:
        """Leave the middleware, with all entities; awaits end. A second call is harmless."""
        if self._destroyed:
            return
        self._destroyed = True
        code = self.session.destroy()
        for entity in self._entities:
            entity.abandon()
        self._entities.clear()
        self._forget(self)
        raise_for(int(code), f"destroying the node {self.name}")
