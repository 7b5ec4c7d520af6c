"""The Cyclone DDS adapter: the PyPI package ``cyclonedds`` on loopback."""

from __future__ import annotations

import importlib.metadata
import weakref
from collections.abc import Mapping

from nros_backends.cyclone.native import Native
from nros_backends.cyclone.network import DOMAINS, LEASE_MAX_MS, LEASE_MS, Network
from nros_backends.cyclone.publisher import CyclonePublisher
from nros_backends.cyclone.session import CycloneSession
from nros_backends.cyclone.subscription import CycloneSubscription
from nros_conformance.rmw.backend import Backend, Host, Publisher, Session, SessionOptions, Subscription
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode, RmwError

_HANDSHAKE_NS = 10 * MS
"""What a reader's request for the first heartbeat took at most, 5 ms on an idle and a busy host, twice."""


class CycloneBackend(Backend):
    """Eclipse Cyclone DDS."""

    def __init__(self, host: Host) -> None:
        super().__init__(host)
        self._network = Network(host.network, host.ports)
        self._native = Native()
        self._sessions: weakref.WeakSet[CycloneSession] = weakref.WeakSet()

    def create_session(self, options: SessionOptions) -> Session:
        """Raises `RmwError` INVALID_ARGUMENT, INVALID_CONFIG for options that need a peer, CONNECTION_FAILED."""
        if not options.node_name or not 0 <= options.domain_id < DOMAINS:
            raise RmwError(
                ReturnCode.INVALID_ARGUMENT, f"node {options.node_name!r} in domain {options.domain_id} cannot exist"
            )
        if not 0 <= options.connection_lease_ms <= LEASE_MAX_MS:
            raise RmwError(ReturnCode.INVALID_ARGUMENT, f"lease {options.connection_lease_ms} ms is not 0 to an hour")
        if options.locator:
            raise RmwError(ReturnCode.INVALID_CONFIG, f"locator {options.locator!r}: DDS discovers its peers")
        if options.hard_liveliness_ms:
            raise RmwError(ReturnCode.INVALID_CONFIG, "hard liveliness: there is no agent that could check it")
        domain, participant = self._network.join(
            options.domain_id, options.node_name, options.connection_lease_ms or LEASE_MS
        )
        session = CycloneSession(self.host.clock, self._native, domain, participant)
        self._sessions.add(session)
        return session

    def close(self) -> None:
        for session in tuple(self._sessions):
            session.destroy()
        self._sessions.clear()

    def await_matched(self, publisher: Publisher, subscription: Subscription, until_ns: int) -> bool | None:
        """Until discovery has matched both ends with each other, looked at every millisecond.

        A reliable reader drops samples until it has seen a heartbeat, and gets the first one 0.1 s late
        if that was published at once (one match in ten, measured). So the writer sends a heartbeat,
        which asserts nothing when the liveliness is not manual; else the reader's own request is awaited.
        """
        if not isinstance(publisher, CyclonePublisher) or not isinstance(subscription, CycloneSubscription):
            return None
        clock = self.host.clock
        while not (publisher.knows(subscription.guid) and subscription.knows(publisher.guid)):
            now = clock.now_ns()
            if now >= until_ns:
                return False
            clock.wait(None, min(now + MS, until_ns))
        if not publisher.send_heartbeat():
            clock.wait(None, clock.now_ns() + _HANDSHAKE_NS)
        return True

    def versions(self) -> Mapping[str, str]:
        return {"cyclonedds": importlib.metadata.version("cyclonedds")}
