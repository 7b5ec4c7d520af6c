"""What is known of the nodes on the bus and their endpoints, and until when it holds."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nros_backends.can.messages import EXPIRED_MS, Endpoint, Heartbeat
from nros_backends.can.policies import CAPACITY
from nros_backends.can.transfers import Assembly, Numbering
from nros_conformance.rmw.clock import MS, NEVER
from nros_conformance.rmw.qos import Liveliness

if TYPE_CHECKING:
    from nros_backends.can.subscription import CanSubscription

_ASSEMBLY = CAPACITY + 256
"""The longest transfer with its CRC, its length and padding."""

_ROUNDS = 256

_SLACK_NS = 5 * MS
"""An announcement tells the moment of an assertion in milliseconds, and may itself have waited."""


class Port:
    """One subject of one node: its transfers on the way, and their numbers."""

    __slots__ = ("assembly", "lifespan_ms", "numbering", "readers", "subject", "synchronised")

    def __init__(self, subject: int, count: int | None) -> None:
        self.subject = subject
        self.assembly = Assembly(_ASSEMBLY)
        self.numbering = Numbering(count)
        self.synchronised: set[int] = set()
        """The subscriptions that have had a sample from here: what is missing from now on, they have lost."""
        self.readers: list[CanSubscription] | None = None
        """The subscriptions that it is for; None until found out."""
        self.lifespan_ms = 0
        """Of the publishers behind it, 0 for ever."""


class Remote:
    """An endpoint of a node."""

    __slots__ = ("alive", "asserted_ns", "info", "key", "round")

    def __init__(self, node: int, incarnation: int, info: Endpoint, at_ns: int) -> None:
        self.key = (node, incarnation, info.number)
        self.info = info
        self.round = info.round
        self.alive = True
        self.asserted_ns = at_ns - _silent_ns(info)

    def heard(self, info: Endpoint, at_ns: int) -> None:
        """It was announced again; a manual one says how long it has been silent, which is no assertion."""
        self.round = info.round
        self.info = info
        asserted_ns = at_ns - _silent_ns(info)
        if asserted_ns > self.asserted_ns + _SLACK_NS:
            self.asserted_ns = asserted_ns  # its last sign did not arrive

    def due_ns(self, heard_ns: int) -> int:
        """When it is not alive any more, if its node was heard at ``heard_ns`` and nothing follows."""
        info = self.info
        node_due = heard_ns + info.node_lease_ms * MS
        if not info.lease_ms or info.liveliness is Liveliness.NONE:
            return node_due
        begin = self.asserted_ns if info.liveliness.is_manual else heard_ns
        return min(begin + info.lease_ms * MS, node_due)


def _silent_ns(info: Endpoint) -> int:
    return (info.lease_ms if info.silent_ms == EXPIRED_MS else info.silent_ms) * MS


class Peer:
    """A node that sends heartbeats; also this session itself."""

    def __init__(self, node: int, heartbeat: Heartbeat, at_ns: int) -> None:
        self.node = node
        self.incarnation = heartbeat.incarnation
        self.uptime_s = heartbeat.uptime_s
        self.heard_ns = at_ns
        self.remotes: dict[int, Remote] = {}
        self.ports: dict[int, Port] = {}
        self.management: dict[int, Assembly] = {}
        """For the adapter's own subjects."""

    def restarted(self, heartbeat: Heartbeat) -> bool:
        """Whether this heartbeat comes from another life of the node."""
        return heartbeat.uptime_s < self.uptime_s or heartbeat.incarnation != self.incarnation

    def port(self, subject: int, count: int) -> Port:
        """The port of this subject, which has sent ``count`` transfers before."""
        if subject not in self.ports:
            self.ports[subject] = Port(subject, count)
        return self.ports[subject]

    def stale(self, round_: int) -> list[Remote]:
        """Those that were missing in this round of announcements and in the one before."""
        recent = (round_, (round_ - 1) % _ROUNDS)
        return [remote for remote in self.remotes.values() if remote.round not in recent]

    def next_due_ns(self) -> int:
        """When the first of those that are alive is due."""
        return min((remote.due_ns(self.heard_ns) for remote in self.remotes.values() if remote.alive), default=NEVER)
