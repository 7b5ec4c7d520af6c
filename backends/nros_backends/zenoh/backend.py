"""The zenoh adapter: the PyPI package ``eclipse-zenoh`` on loopback.

zenoh carries bytes and tokens; all status events are the shim's, over what zenoh reports:

- **Keys, tokens and attachments** are those of rmw_zenoh and nano-ros (`keys`, `attachment`), so that both ends
  may be a foreign one. A type has no hash here (``TypeHashNotSupported``); subscriptions take any.
- **LivelinessChanged** counts tokens, which are unique to their publishers: the set of keys, never the
  notifications, of which zenoh repeats some. A token that goes does not say why, so every publisher that goes
  leaves both counts: not_alive_count is always 0.
- **AUTOMATIC liveliness** is the transport's lease. The token of a publisher whose lease is shorter than the
  session's is on a transport of its own with that lease; of a MANUAL one too, because a frozen process withdraws
  nothing.
- **MANUAL liveliness**: the publisher's session withdraws the token when the lease has passed without an
  assertion, and declares it again with the next. A thread sees to it also when nobody calls `drive_io`.
  LivelinessLost counts the same moment. Publishing asserts.
- **Deadlines** run on the shim's clock, from reception (on zenoh's thread) and from a successful publication.
- **MessageLost** counts gaps in the numbers of each publisher, once they have stayed open for 25 ms, and what the
  receive queue pushes out. A sample without a valid attachment belongs to no publisher and is dropped.
- **A sample larger than the caller's buffer** is dropped and counted as lost.
- **Ends are matched by their tokens** as DDS matches them; what does not match is neither delivered nor counted.
- **No callback of the application** runs on a thread of zenoh: those only fill a queue that `drive_io` works off.
"""

from __future__ import annotations

import importlib.metadata
import weakref
from collections.abc import Mapping
from typing import Any

from nros_backends.zenoh.config import LEASE_MS
from nros_backends.zenoh.ends import End
from nros_backends.zenoh.environment import GivenRouter, OwnRouter
from nros_backends.zenoh.faults import WIRE_FAULTS, Faults
from nros_backends.zenoh.network import Network
from nros_backends.zenoh.ping import ping_before_session
from nros_backends.zenoh.policies import is_node_name
from nros_backends.zenoh.publisher import ZenohPublisher
from nros_backends.zenoh.session import ZenohSession
from nros_backends.zenoh.subscription import ZenohSubscription
from nros_conformance.rmw.backend import (
    Backend,
    Entity,
    Environment,
    Host,
    Publisher,
    Session,
    SessionOptions,
    Subscription,
)
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode, RmwError

DOMAINS = 2
"""A scenario's own domain and its neighbour."""

ROUTER = "router"
"""The variant in which sessions are clients of a router; without it they are peers."""

_LEASE_MAX_MS = 3_600_000

_PORTS_EACH = 8
"""Leased ports from which a scenario takes the first that is free: so those that live at once differ."""


class ZenohBackend(Backend):
    """Eclipse zenoh."""

    option_names = ("locator",)

    def __init__(self, host: Host) -> None:
        super().__init__(host)
        self._network = Network(host.scratch, processes=host.processes, proxies=bool(host.faults & WIRE_FAULTS))
        self._sessions: weakref.WeakSet[ZenohSession] = weakref.WeakSet()
        self._faults = Faults(self._network, lambda: list(self._sessions))
        clients = host.variant == ROUTER
        given = host.options.get("locator", "") if clients else ""
        self._own: OwnRouter | None = None
        if clients and not given:
            first = host.network * _PORTS_EACH
            self._own = OwnRouter(host.ports, first, host.launch, untouched=host.peer_untouched)
        self._environment: Environment = GivenRouter(given) if given else self._own or Environment()

    def create_session(self, options: SessionOptions) -> Session:
        """Raises `RmwError` INVALID_ARGUMENT, INVALID_CONFIG, CONNECTION_FAILED when no router answers."""
        if not is_node_name(options.node_name) or not 0 <= options.domain_id < DOMAINS:
            raise RmwError(
                ReturnCode.INVALID_ARGUMENT, f"node {options.node_name!r} in domain {options.domain_id} cannot exist"
            )
        if not 0 <= options.connection_lease_ms <= _LEASE_MAX_MS:
            raise RmwError(ReturnCode.INVALID_ARGUMENT, f"lease {options.connection_lease_ms} ms is not 0 to an hour")
        if options.hard_liveliness_ms:
            raise RmwError(ReturnCode.INVALID_CONFIG, "hard liveliness: a router checks nobody")
        session = ZenohSession(
            self.host.clock,
            self._network,
            self._locator(options),
            self.host.network * DOMAINS + options.domain_id,
            options.node_name,
            options.connection_lease_ms or LEASE_MS,
        )
        self._sessions.add(session)
        return session

    def ping(self, options: SessionOptions, timeout_ms: int, attempts: int = 1) -> int:
        if not isinstance(timeout_ms, int) or not isinstance(attempts, int) or attempts < 1:
            return ReturnCode.INVALID_ARGUMENT
        locator = options.locator or self._environment.endpoint()
        if not locator:
            return ReturnCode.UNSUPPORTED
        return ping_before_session(locator, max(timeout_ms, 0), attempts)

    def close(self) -> None:
        for session in tuple(self._sessions):
            session.destroy()
        self._sessions.clear()
        if self._own is not None:
            self._own.stop()

    def environment(self) -> Environment:
        """The same one each time: the router process of the variant ``router``, or the one that was named."""
        return self._environment

    def await_matched(self, publisher: Publisher, subscription: Subscription, until_ns: int) -> bool | None:
        """Until each session has seen the other end's token, and zenoh somebody to send to.

        A subscription's token comes after its declaration, so that samples get through to whoever was seen.
        """
        if not isinstance(publisher, ZenohPublisher) or not isinstance(subscription, ZenohSubscription):
            return None
        if not publisher.meets(subscription.token):
            return False
        clock = self.host.clock
        while not (
            publisher.session.sees(subscription.token)
            and publisher.matching
            and subscription.session.sees(publisher.token)
        ):
            now = clock.now_ns()
            if now >= until_ns:
                return False
            clock.wait(None, min(now + MS // 2, until_ns))
        return True

    def matched(self, entity: Entity) -> int | None:
        return entity.session.counterparts(entity) if isinstance(entity, End) else None

    def inject(self, fault: str, **arguments: Any) -> int:
        """See `faults`."""
        return self._faults.inject(fault, arguments)

    def lacking(self) -> Mapping[str, str]:
        if not isinstance(self._environment, GivenRouter):
            return {}
        return dict.fromkeys(("stop", "start"), self._environment.not_ours)

    def versions(self) -> Mapping[str, str]:
        return {"eclipse-zenoh": importlib.metadata.version("eclipse-zenoh")}

    def _locator(self, options: SessionOptions) -> str:
        """Which router a session shall use; empty for peers. Our own is started for who has not been told one."""
        if self._own is not None and not options.locator:
            self._own.start()
        return options.locator or self._environment.endpoint()
