"""PX4's message bus as a model: topics, instances, generations, queues. No time, no threads, no I/O.

Source of the semantics: PX4-Autopilot, ``platforms/common/uORB`` at 0148665 (2026), and for
``unadvertise`` bf90fdf. Held to 9,192 recorded results of ShawnFeng0/uorb (``tests/vectors/uorb``),
whose bookkeeping differs in three places: see `Rules`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

WRAP = 2**32
"""The generation counter is unsigned, 32 bits: at 1 kHz it wraps after 49 days."""

PREFIX = 2
"""Bytes of the length in front of a framed sample: u16, as ``o_size`` is."""


@dataclasses.dataclass(frozen=True, slots=True)
class Metadata:
    """A topic as its message definition fixes it (``struct orb_metadata``).

    ``size`` (``o_size``): bytes of a slot, at most 65,535. ``queue`` (``o_queue``): slots, 1 to 255; PX4
    documents that it must be a power of two, and a queue of another length loses its order when the
    generation wraps (pull request 15709). ``framed``: a slot carries serialized bytes of any length
    behind their length, and not a struct of exactly this size; the padding is not stored here.
    """

    name: str
    size: int
    queue: int = 1
    framed: bool = False

    def fits(self, length: int) -> bool:
        """Whether a sample of ``length`` bytes can be published; PX4 answers -EIO when not."""
        return length + PREFIX <= self.size if self.framed else length == self.size


@dataclasses.dataclass(frozen=True, slots=True)
class Rules:
    """Where implementations of uORB differ. The defaults are PX4's.

    ``instances``: of one topic; PX4 has 4 on boards with constrained memory. ``rounding_limit``: 0
    takes the queue length as it is defined (PX4 since pull request 22815), else it is rounded up to a
    power of two, at most this one. ``unadvertise_hides``: any one unadvertise makes the instance
    unreadable until somebody advertises again, whoever else still publishes on it (pull request 16084,
    which counts publishers, is closed); otherwise publishers are counted and data stays readable.
    """

    instances: int = 10
    rounding_limit: int = 0
    unadvertise_hides: bool = True

    def queue_length(self, requested: int) -> int:
        """Slots in force for a requested queue length."""
        if not self.rounding_limit:
            return requested
        return min(1 << max(requested - 1, 0).bit_length(), self.rounding_limit)


PX4 = Rules()


class Node:
    """One instance of a topic (``uORB::DeviceNode``). It is never deleted; its generation lives on."""

    def __init__(self, meta: Metadata, instance: int, rules: Rules) -> None:
        self.meta = meta
        self.instance = instance
        self.queue = rules.queue_length(meta.queue)
        self.generation = 0
        self.publishers = 0
        """How many advertise it; with ``unadvertise_hides`` only whether there is one means anything."""
        self.subscriptions: list[Subscription] = []
        self.callbacks: list[Callable[[], None]] = []
        """Called by `publish`, in the publisher's context (``SubscriptionCallback``)."""
        self._rules = rules
        self._slots: list[bytes] = []  # allocated by the first publication
        self._data_valid = False

    @property
    def advertised(self) -> bool:
        """``orb_exists``."""
        return self.publishers > 0

    @property
    def readable(self) -> bool:
        """Whether subscriptions can reach what is stored."""
        return self.publishers > 0 or not self._rules.unadvertise_hides

    @property
    def initial_generation(self) -> int:
        """What a new subscription starts from: one publication back, whatever the queue length."""
        return (self.generation - self._data_valid) % WRAP

    def advertise(self) -> None:
        """One more publisher."""
        self.publishers += 1

    def unadvertise(self) -> None:
        """One publisher less; in PX4 the flag that all of them share."""
        self.publishers = 0 if self._rules.unadvertise_hides else max(self.publishers - 1, 0)

    def publish(self, data: bytes) -> bool:
        """Store a sample and call the callbacks; False (-EIO) when it does not fit the slot."""
        if not self.meta.fits(len(data)):
            return False
        if not self._slots:
            self._slots = [b""] * self.queue
        self._slots[self.generation % self.queue] = data
        self.generation = (self.generation + 1) % WRAP
        for callback in tuple(self.callbacks):
            callback()
        self._data_valid = True  # PX4 sets it after the callbacks
        return True

    def fetch(self, last: int) -> tuple[bytes, int] | None:
        """The sample for a subscription at generation ``last``, and its new generation.

        The oldest unread one that is still stored; the latest one again when nothing is unread; None
        while nothing has ever been published.
        """
        if not self._slots:
            return None
        if self.queue == 1:
            return self._slots[0], self.generation
        behind = (self.generation - last) % WRAP
        position = (self.generation - min(max(behind, 1), self.queue)) % WRAP
        return self._slots[position % self.queue], (position + 1) % WRAP

    def preset(self, generation: int) -> None:
        """Move the counter, and with it all that is stored and every subscription.

        Nothing is lost or read twice by it. A test hook: waiting for the wrap takes 49 days.
        """
        shift = generation - self.generation
        if self._slots:
            moved = [b""] * self.queue
            for back in range(1, self.queue + 1):
                stored = self._slots[(self.generation - back) % WRAP % self.queue]
                moved[(generation - back) % WRAP % self.queue] = stored
            self._slots = moved
        self.generation = generation % WRAP
        for subscription in self.subscriptions:
            subscription.last = (subscription.last + shift) % WRAP


class Subscription:
    """One reader (``uORB::Subscription``). ``last`` is the generation that it has read up to.

    It creates no node: it attaches at the first use after the node exists, so that what was published
    before is neither seen nor lost.
    """

    def __init__(self, bus: Bus, name: str, instance: int = 0) -> None:
        self.name = name
        self.instance = instance
        self.node: Node | None = None
        self.last = 0
        self._bus = bus

    def attach(self) -> Node | None:
        """The node, if it exists by now."""
        if self.node is None:
            node = self._bus.find(self.name, self.instance)
            if node is not None:
                self.node = node
                self.last = node.initial_generation
                node.subscriptions.append(self)
        return self.node

    def detach(self) -> None:
        """``unsubscribe``; using it again attaches anew."""
        if self.node is not None:
            self.node.subscriptions.remove(self)
            self.node = None
            self.last = 0

    @property
    def unread(self) -> int:
        """Publications since ``last``, stored or not (``updates_available``)."""
        node = self.attach()
        return (node.generation - self.last) % WRAP if node is not None and node.readable else 0

    @property
    def advertised(self) -> bool:
        """Whether somebody advertises the instance."""
        node = self.attach()
        return node is not None and node.advertised

    def updated(self) -> bool:
        """``orb_check``."""
        return self.unread > 0

    def copy(self) -> bytes | None:
        """``orb_copy``: see `Node.fetch`. What it jumps over, unread - queue when positive, is lost."""
        node = self.attach()
        if node is None or not node.readable:
            return None
        found = node.fetch(self.last)
        if found is None:
            return None
        data, self.last = found
        return data

    def update(self) -> bytes | None:
        """`copy` if there is something new."""
        return self.copy() if self.updated() else None

    def trim(self, depth: int) -> int:
        """Skip what lies further back than ``depth`` publications; returns how many are skipped.

        Done after each publication it finds a loss when it happens. With ``depth`` equal to the queue
        the total is the same as that of the jumps of `copy`.
        """
        skipped = max(self.unread - depth, 0)
        self.last = (self.last + skipped) % WRAP
        return skipped


class Bus:
    """All topics (``uORB::Manager`` and ``uORB::DeviceMaster``)."""

    def __init__(self, rules: Rules = PX4) -> None:
        self.rules = rules
        self._topics: dict[str, Metadata] = {}
        self._nodes: dict[tuple[str, int], Node] = {}

    def define(self, meta: Metadata) -> None:
        """Make a topic known. Raises ValueError when it is known with another definition."""
        if self._topics.setdefault(meta.name, meta) != meta:
            raise ValueError(f"topic {meta.name!r} is defined as {self._topics[meta.name]}")

    def find(self, name: str, instance: int = 0) -> Node | None:
        """The node, if it has been created."""
        return self._nodes.get((name, instance))

    def advertise(self, name: str, data: bytes | None = None) -> Node:
        """``orb_advertise``: instance 0, shared by any number of publishers; ``data`` is published at once."""
        return self._advertised(self._node(name, 0), data)

    def advertise_multi(self, name: str, data: bytes | None = None) -> Node | None:
        """``orb_advertise_multi``: the first instance that nobody advertises; None when all are taken."""
        for instance in range(self.rules.instances):
            node = self._node(name, instance)
            if not node.advertised:
                return self._advertised(node, data)
        return None

    def subscribe(self, name: str, instance: int = 0) -> Subscription | None:
        """``orb_subscribe_multi``: creates the node if need be; None when there is no such instance."""
        if not 0 <= instance < self.rules.instances:
            return None
        self._node(name, instance)
        subscription = Subscription(self, name, instance)
        subscription.attach()
        return subscription

    def exists(self, name: str, instance: int) -> bool:
        """``orb_exists``: somebody advertises this instance."""
        node = self.find(name, instance)
        return node is not None and node.advertised

    def group_count(self, name: str) -> int:
        """``orb_group_count``: instances that somebody advertises."""
        return sum(self.exists(name, instance) for instance in range(self.rules.instances))

    def _node(self, name: str, instance: int) -> Node:
        key = name, instance
        if key not in self._nodes:
            self._nodes[key] = Node(self._topics[name], instance, self.rules)
        return self._nodes[key]

    def _advertised(self, node: Node, data: bytes | None) -> Node:
        node.advertise()
        if data is not None:
            node.publish(data)
        return node
