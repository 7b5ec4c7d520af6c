"""The XRCE adapter: this project's DDS-XRCE client and agent over UDP on loopback.

What it decides, where the protocol leaves something open:

- **Single-threaded**, as eProsima's client is: datagrams are read inside `drive_io`, `publish_raw`,
  `ping` and the calls that create and destroy; callbacks run in `drive_io` alone.
- **Deadlines** are the client's own: a clock per entity, looked at inside `drive_io`, because the agent
  reports none. A sample counts from when the kernel received it (`client.transport`), so one that waits
  in the socket is not late; but of a reliable stream no more than 16 messages come to a client that
  does not drive.
- **LivelinessChanged, LivelinessLost** and **MessageLost** are refused: nothing in the protocol tells a
  client of any, and gaps in a best-effort stream are those of the session, not of a topic. What a
  subscription itself drops is counted in `XrceSubscription.dropped` and ``too_large``.
- **A lost agent** is noticed within the connection lease, 1 s by default, as long as the session is
  driven, published on or pinged: after a quarter of it without a word a probe asks the agent whether it
  knows the session; after half of it with none answered, or at once when the answer is no, `drive_io`
  and `publish_raw` answer CONNECTION_FAILED. When a silent agent speaks again all is well again; one
  that has forgotten the session needs a new one.
- **Payloads** go as they are. eProsima's own clients leave the CDR encapsulation out, and its agent puts
  one in front.
- **Entities** are created in the binary representation and answered for by the agent before the call
  returns; a subscription when the agent has taken its READ_DATA.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from typing import Any

from nros_backends.xrce.client.client import LEASE_NS, ping_agent
from nros_backends.xrce.client.core import LIVELINESS_MAX_MS, Config
from nros_backends.xrce.environment import EmbeddedAgent, OwnAgent, UserAgent
from nros_backends.xrce.external_agent import ExternalAgent
from nros_backends.xrce.faults import inject
from nros_backends.xrce.link import Link
from nros_backends.xrce.policies import compatible
from nros_backends.xrce.publisher import XrcePublisher
from nros_backends.xrce.session import XrceSession
from nros_backends.xrce.subscription import XrceSubscription
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

DOMAIN_IDS = 200
"""DDS domains to choose from; what DDS' port mapping has room for, and a little less."""

LEASE_MIN_MS, LEASE_MAX_MS = 20, 3_600_000


class XrceBackend(Backend):
    """DDS-XRCE. The option ``agent`` (HOST:PORT) names an agent of the user's, for any variant."""

    option_names = ("agent",)

    def __init__(self, host: Host) -> None:
        super().__init__(host)
        self._sessions: set[XrceSession] = set()
        self._links: dict[tuple[str, tuple[str, int]], Link] = {}
        self._environment = self._choose()

    def _choose(self) -> OwnAgent | UserAgent:
        named = self.host.options.get("agent")
        if named:
            return UserAgent(_address(named), self.host.clock)
        if self.host.variant == "external":
            host = self.host
            return ExternalAgent(host.ports, host.network, host.launch, untouched=host.peer_untouched)
        return EmbeddedAgent(self.host.ports, self.host.network)

    def create_session(self, options: SessionOptions) -> Session:
        """Raises `RmwError` INVALID_ARGUMENT, INVALID_CONFIG (locator, mode), CONNECTION_FAILED.

        Without a locator it goes to this backend's own agent, which is started when nobody ever did.
        """
        link = self._link(options)
        if not 0 <= options.hard_liveliness_ms <= LIVELINESS_MAX_MS:
            raise RmwError(
                ReturnCode.INVALID_ARGUMENT, f"hard liveliness {options.hard_liveliness_ms} ms is not six digits"
            )
        config = Config(key=int.from_bytes(os.urandom(4), "big") or 1, hard_liveliness_ms=options.hard_liveliness_ms)
        domain = (self.host.network * DOMAINS + options.domain_id) % DOMAIN_IDS
        try:
            attachment = link.open()
        except OSError as error:
            raise RmwError(ReturnCode.CONNECTION_FAILED, str(error)) from error
        lease_ns = options.connection_lease_ms * MS or LEASE_NS
        session = XrceSession(attachment, self.host.clock, config, lease_ns, domain, self._sessions.discard)
        self._sessions.add(session)
        return session

    def ping(self, options: SessionOptions, timeout_ms: int, attempts: int = 1) -> int:
        """OK; TIMEOUT; INVALID_ARGUMENT. ``timeout_ms`` is per attempt. Raises `RmwError` as `create_session`."""
        if not isinstance(timeout_ms, int) or not isinstance(attempts, int) or attempts < 1:
            return ReturnCode.INVALID_ARGUMENT
        try:
            attachment = self._link(options).open()
        except OSError:
            return ReturnCode.TIMEOUT
        try:
            reached = ping_agent(attachment.transport, self.host.clock, max(timeout_ms, 0) * MS, attempts)
        finally:
            attachment.close()
        return ReturnCode.OK if reached else ReturnCode.TIMEOUT

    def close(self) -> None:
        for session in tuple(self._sessions):
            session.destroy()
        if isinstance(self._environment, OwnAgent):
            self._environment.close()

    def environment(self) -> Environment:
        """The agent: embedded in this process, a process of its own, or the user's. Always the same object."""
        if isinstance(self._environment, OwnAgent):
            self._environment.started = True  # whoever asks for it starts it as well
        return self._environment

    def await_matched(self, publisher: Publisher, subscription: Subscription, until_ns: int) -> bool | None:
        """True at once for an own agent, which has confirmed both ends and matches them without delay.

        None for the user's: what stands behind it may have to discover first.
        """
        if not isinstance(publisher, XrcePublisher) or not isinstance(subscription, XrceSubscription):
            return None
        if isinstance(self._environment, UserAgent):
            return None
        return not (publisher.closed or subscription.closed) and compatible(publisher.qos, subscription.qos)

    def matched(self, entity: Entity) -> int | None:
        """As the embedded agent says; a client by itself is not told."""
        if not isinstance(entity, XrcePublisher | XrceSubscription):
            return None
        if not isinstance(self._environment, EmbeddedAgent) or not self._environment.endpoint():
            return None
        key = entity.session.client.core.config.key
        found = [one for one in self._environment.graph() if (one.client, one.id) == (key, entity.object_id)]
        return found[0].matched if found else 0

    def inject(self, fault: str, **arguments: Any) -> int:
        """See `faults`."""
        return inject(fault, arguments)

    def lacking(self) -> Mapping[str, str]:
        if not isinstance(self._environment, UserAgent):
            return {}
        return dict.fromkeys(("stop", "start"), self._environment.not_ours)

    def versions(self) -> Mapping[str, str]:
        return {"DDS-XRCE": "1.0"}

    def _link(self, options: SessionOptions) -> Link:
        """The path of this node; raises `RmwError`."""
        if not options.node_name or not 0 <= options.domain_id < DOMAINS:
            raise RmwError(
                ReturnCode.INVALID_ARGUMENT, f"node {options.node_name!r} in domain {options.domain_id} cannot exist"
            )
        lease_ms = options.connection_lease_ms
        if lease_ms and not LEASE_MIN_MS <= lease_ms <= LEASE_MAX_MS:
            raise RmwError(ReturnCode.INVALID_ARGUMENT, f"lease {lease_ms} ms is not {LEASE_MIN_MS} ms to an hour")
        if options.mode != "client":
            raise RmwError(ReturnCode.INVALID_CONFIG, f"mode {options.mode!r}: an XRCE client is a client")
        locator = options.locator
        if not locator:
            environment = self._environment
            if isinstance(environment, OwnAgent) and not environment.started:
                environment.start()
            locator = environment.endpoint()
        if not locator:
            raise RmwError(ReturnCode.CONNECTION_FAILED, "the agent has not been started")
        address = _address(locator)
        return self._links.setdefault((options.node_name, address), Link(address))


def _address(locator: str) -> tuple[str, int]:
    """``HOST:PORT`` as an IPv4 address; raises `RmwError` INVALID_CONFIG."""
    host, colon, port = locator.rpartition(":")
    if not colon or not host or not port.isascii() or not port.isdecimal() or not 0 < int(port) < 65_536:
        raise RmwError(ReturnCode.INVALID_CONFIG, f"agent {locator!r} is not HOST:PORT")
    try:
        found = socket.getaddrinfo(host, int(port), socket.AF_INET, socket.SOCK_DGRAM)
    except OSError as error:
        raise RmwError(ReturnCode.INVALID_CONFIG, f"agent {locator!r}: {error.strerror or error}") from error
    address: tuple[str, int] = found[0][4][:2]  # type: ignore[assignment]
    return address
