"""The bus that the sessions of one domain share, with its lock and the names on it."""

from __future__ import annotations

import contextlib
import random
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

    def disturb(self, chance: random.Random, count: int) -> None:
        """The fault ``inject``: ``count`` attempts of a foreign module that are none of instance 0 of any topic.

        Memory has no packets to malform: what can be wrong are the size of a publication, the definition
        of a topic, and the instance, all of which the bus refuses or keeps apart.
        """
        with self.lock:
            topics = list(self._types)
            for number in range(count if topics else 0):
                topic, noise = chance.choice(topics), chance.randbytes(chance.randrange(64))
                first = self._bus.advertise(topic)
                match number % 5:
                    case 0:  # -EIO: larger than the slot
                        first.publish(bytes(CAPACITY + 1 + chance.randrange(2 * SLOT)))
                    case 1:  # another definition of a known topic
                        with contextlib.suppress(ValueError):
                            self._bus.define(Metadata(topic, len(noise)))
                    case 2:  # an instance that cannot exist
                        self._bus.subscribe(topic, chance.choice((-1, self._bus.rules.instances, SLOT)))
                    case 3:  # other instances, which a subscription of the first does not hear
                        other = self._bus.advertise_multi(topic)
                        if other is not None:
                            other.publish(noise)
                    case _:  # a topic of nearly that name
                        with contextlib.suppress(ValueError):
                            self._bus.define(Metadata(f"{topic}~", len(noise)))
                            self._bus.advertise(f"{topic}~", noise)

    def _define(self, topic: str, type_name: str) -> None:
        if not isinstance(topic, str) or len(topic) > _TOPIC_MAX or not _TOPIC.fullmatch(topic):
            raise RmwError(ReturnCode.TOPIC_NAME_INVALID, f"{topic!r} is not a topic name")
        if not isinstance(type_name, str) or not type_name:
            raise RmwError(ReturnCode.INVALID_ARGUMENT, f"{type_name!r} is not a type name")
        known = self._types.setdefault(topic, type_name)
        if known != type_name:
            raise RmwError(ReturnCode.TOPIC_NAME_INVALID, f"topic {topic!r} has the type {known!r}, not {type_name!r}")
        self._bus.define(Metadata(topic, SLOT, QUEUE, framed=True))
