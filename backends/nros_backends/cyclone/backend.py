"""The Cyclone DDS adapter: the PyPI package ``cyclonedds`` on loopback.

What it decides, where DDS or its Python binding leave something open:

- **No listeners.** The binding calls C holding the GIL while Cyclone's threads wait for the GIL in a
  listener, which deadlocks (eclipse-cyclonedds/cyclonedds-python#208). Statuses are polled inside
  `drive_io`, which waits on a wait set that they trigger; everything runs on the driving thread.
- **Deadlines** of the QoS are DDS' own. One that only the registration states cannot be: the deadline
  of a live reader cannot be changed, and asking for one that the writer does not offer prevents the
  match. The shim's clock counts those, on the publisher from each successful write, on the
  subscription from reception.
- **Reception** (RDM-005, C31). DDS tells when a sample was sent, by the wall clock (RDM-006 rules that
  out), not when it came. Taken in `drive_io` it would look as late as the application is, and 3 periods
  without a drive would count as none. So a subscription with such a deadline has its samples taken by a
  thread that sleeps in DDS until one comes (`receiver`); its reception is when that thread has taken it,
  never early, and late by a thread switch. Nothing is ``receives_only_in_drive_io``.
- **MessageLost** is the shim's: DDS reports no loss on the wire and no replaced sample. Every writer
  numbers what it has written (`envelope`), a gap between delivered samples is what the wire lost, and
  the receive queue counts what it pushes out. History from before the subscription is never lost.
- **Depth of a subscription and lifespan** are the shim's too, so that its books balance (`policies`).
- **Types** match by structure in DDS, so the type name goes into the structure (`envelope`). A topic in
  use with another type, here or at a discovered peer, is refused at creation.
- **Order.** Samples and statuses found in one look are queued in the order in which they became ready:
  a sample when it was sent, a missed deadline when it was due, a publisher's coming before its samples.
- **A sample larger than the caller's buffer** is dropped and counted as lost.

What Cyclone does and the adapter does not hide: a publisher whose lease has expired is alive again when
it publishes, not when it asserts, and an AUTOMATIC one that was frozen for longer than its lease not
before it publishes; a volatile subscription that matches together with a transient-local one of its
session gets the history of that, too.
"""

from __future__ import annotations

import importlib.metadata
import weakref
from collections.abc import Mapping
from typing import Any

from nros_backends.cyclone.faults import inject
from nros_backends.cyclone.native import Native
from nros_backends.cyclone.network import DOMAINS, LEASE_MAX_MS, LEASE_MS, Network
from nros_backends.cyclone.publisher import CyclonePublisher
from nros_backends.cyclone.session import CycloneSession
from nros_backends.cyclone.subscription import CycloneSubscription
from nros_conformance.rmw.backend import Backend, Entity, Host, Publisher, Session, SessionOptions, Subscription
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
        domain, participant, ear = self._network.join(
            options.domain_id, options.node_name, options.connection_lease_ms or LEASE_MS,
            hears="inject" in self.host.faults,
        )  # fmt: skip
        session = CycloneSession(self.host.clock, self._native, domain, participant, ear)
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
        while not (subscription.guid in publisher.met() and publisher.guid in subscription.met()):
            now = clock.now_ns()
            if now >= until_ns:
                return False
            clock.wait(None, min(now + MS, until_ns))
        if not publisher.send_heartbeat():
            clock.wait(None, clock.now_ns() + _HANDSHAKE_NS)
        return True

    def matched(self, entity: Entity) -> int | None:
        """Counted by DDS; a writer has its readers see a heartbeat, as in `await_matched`."""
        if not isinstance(entity, CyclonePublisher | CycloneSubscription):
            return None
        count = entity.matched()
        if count and isinstance(entity, CyclonePublisher) and not entity.send_heartbeat():
            self.host.clock.wait(None, self.host.clock.now_ns() + _HANDSHAKE_NS)
        return count

    def inject(self, fault: str, **arguments: Any) -> int:
        """See `faults`."""
        return inject(fault, arguments)

    def versions(self) -> Mapping[str, str]:
        return {"cyclonedds": importlib.metadata.version("cyclonedds")}
