"""The CAN adapter: a thin layer of Cyphal/CAN v1 messages on any bus of python-can.

What it decides, where Cyphal or the contract leave something open:

- **Samples** are plain Cyphal messages of opaque bytes, on a subject that is hashed from the topic or
  fixed by hand. Publishers announce their subject, and subscriptions listen to what is announced for
  their topic, so that topics whose hashes collide are never mixed. CAN FD pads frames, so there a
  sample carries its length in front.
- **No thread.** Everything happens in `drive_io`; reception is timed by the driver's time stamps, so
  samples that wait for a drive are not late.
- **Liveliness.** AUTOMATIC is the node's heartbeat, which goes out while the session is driven, as in
  nano-ros: a session that nobody drives for a lease is not alive to others. MANUAL ones send signs.
- **MessageLost.** Transfer-ids have five bits: up to 30 samples lost in a row show with the next one. What
  is more shows with the count that publishers send every 16 samples, with heartbeats, and once a second.
- **LivelinessLost** of an AUTOMATIC publisher: no heartbeat could be sent for its lease (bus off).
- **RELIABLE** is CAN's own acknowledgement by at least one node, and its repetition of frames.
- **Node ids** are leased, from the option ``node`` on if it is given, as it has to be on a bus with nodes of
  other processes; a node that hears its own id from somebody else says INVALID_CONFIG.
"""

from __future__ import annotations

import importlib.metadata
from collections.abc import Mapping
from typing import Any

import can

from nros_backends.can.buses import DOMAINS, Buses, subject_table
from nros_backends.can.ends import End, topic_digest
from nros_backends.can.faults import inject
from nros_backends.can.nodes import NodeIds
from nros_backends.can.policies import MIN_LEASE_MS
from nros_backends.can.session import LEASE_MAX_MS, LEASE_MS, CanSession
from nros_conformance.rmw.backend import Backend, Entity, Host, Publisher, Session, SessionOptions, Subscription
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode, RmwError


class CanBackend(Backend):
    """A CAN bus. ``bus``: a ready-made python-can bus for the first session, which then owns it."""

    option_names = None  # python-can's buses have many

    def __init__(self, host: Host, bus: can.BusABC | None = None) -> None:
        super().__init__(host)
        self._buses = Buses(host, bus)
        self._nodes = NodeIds(self._buses.scratch, NodeIds.first(host.options.get("node", "")))
        self._subjects = {topic_digest(topic): subject for topic, subject in subject_table(host.options).items()}
        self._sessions: dict[tuple[int, int], CanSession] = {}
        """Those that are open, by domain and node id, which they keep until they are destroyed."""

    def create_session(self, options: SessionOptions) -> Session:
        """Raises `RmwError` INVALID_ARGUMENT, INVALID_CONFIG for options that need a peer, CONNECTION_FAILED."""
        if not options.node_name or not 0 <= options.domain_id < DOMAINS:
            raise RmwError(
                ReturnCode.INVALID_ARGUMENT, f"node {options.node_name!r} in domain {options.domain_id} cannot exist"
            )
        lease_ms = options.connection_lease_ms or LEASE_MS
        if not MIN_LEASE_MS <= lease_ms <= LEASE_MAX_MS:
            raise RmwError(ReturnCode.INVALID_ARGUMENT, f"lease {lease_ms} ms is not {MIN_LEASE_MS} ms to an hour")
        if options.locator:
            raise RmwError(ReturnCode.INVALID_CONFIG, f"locator {options.locator!r}: a bus has no address")
        if options.hard_liveliness_ms:
            raise RmwError(ReturnCode.INVALID_CONFIG, "hard liveliness: there is no agent that could check it")
        domain = options.domain_id
        node = self._nodes.lease(domain)
        try:
            wiring = self._buses.open(domain)
        except RmwError:
            self._nodes.release(domain, node)
            raise
        session = CanSession(
            self.host.clock, wiring, node, lease_ms, self._subjects, lambda: self._closed(domain, node)
        )
        self._sessions[domain, node] = session
        return session

    def close(self) -> None:
        for session in tuple(self._sessions.values()):
            session.destroy()

    def _closed(self, domain: int, node: int) -> None:
        del self._sessions[domain, node]
        self._nodes.release(domain, node)

    def await_matched(self, publisher: Publisher, subscription: Subscription, until_ns: int) -> bool | None:
        """Until each has been told of the other, looked at every millisecond."""
        if not isinstance(publisher, End) or not isinstance(subscription, End):
            return None
        clock = self.host.clock
        while not (publisher.knows(subscription) and subscription.knows(publisher)):
            now = clock.now_ns()
            if now >= until_ns:
                return False
            clock.wait(None, min(now + MS, until_ns))
        return True

    def matched(self, entity: Entity) -> int | None:
        if not isinstance(entity, End):
            return None
        with entity.session.lock:
            return len(entity.met())

    def inject(self, fault: str, **arguments: Any) -> int:
        """See `faults`."""
        return inject(fault, arguments)

    def versions(self) -> Mapping[str, str]:
        """Raises `RmwError` CONNECTION_FAILED when the bus that the options name is not there."""
        self._buses.check()
        return {"python-can": importlib.metadata.version("python-can")}
