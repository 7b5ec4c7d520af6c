"""The bus that the sessions of one domain share, with its lock and the names on it."""

from __future__ import annotations

import re
import threading

from nros_backends.uorb.bus import PREFIX, Bus, Metadata, Node, Subscription
from nros_backends.uorb.qos import QUEUE
from nros_conformance.rmw.codes import ReturnCode, RmwError

SLOT = 2**16 - 1
"""Bytes of a slot: the largest ``o_size``, u16."""

CAPACITY = SLOT - PREFIX
"""Bytes of the largest sample."""

_TOPIC = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z_][A-Za-z0-9_]*)*", re.ASCII)
_TOPIC_MAX = 255


class Domain:
    """One bus. All topics share one message definition: raw bytes behind their length.

    ``lock`` guards the bus and what publishers note in subscriptions, as the node lock does in PX4.
    """

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self._bus = Bus()
        self._types: dict[str, str] = {}

    def advertise(self, topic: str, type_name: str) -> Node:
        """Instance 0 of the topic, for a publisher. Raises as `subscribe` does."""
        with self.lock:
            self._define(topic, type_name)
            return self._bus.advertise(topic)

    def subscribe(self, topic: str, type_name: str) -> Subscription:
        """A reader of instance 0.

        Raises `RmwError` TOPIC_NAME_INVALID for a name that is none in ROS 2, and for a topic that
        has another type (C24); INVALID_ARGUMENT without a type.
        """
        with self.lock:
            self._define(topic, type_name)
            # orb_subscribe, which creates the node: nothing that is published from now on is missed.
            subscription = self._bus.subscribe(topic)
            assert subscription is not None  # instance 0 always exists
            return subscription

    def _define(self, topic: str, type_name: str) -> None:
        if not isinstance(topic, str) or len(topic) > _TOPIC_MAX or not _TOPIC.fullmatch(topic):
            raise RmwError(ReturnCode.TOPIC_NAME_INVALID, f"{topic!r} is not a topic name")
        if not isinstance(type_name, str) or not type_name:
            raise RmwError(ReturnCode.INVALID_ARGUMENT, f"{type_name!r} is not a type name")
        known = self._types.setdefault(topic, type_name)
        if known != type_name:
            raise RmwError(ReturnCode.TOPIC_NAME_INVALID, f"topic {topic!r} has the type {known!r}, not {type_name!r}")
        self._bus.define(Metadata(topic, SLOT, QUEUE, framed=True))
