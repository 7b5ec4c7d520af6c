"""The uORB adapter: PX4's bus behind the contract.

The bus (`bus`) is PX4's rules and nothing else. The adapter on it decides what PX4 leaves open, or
what the contract asks for otherwise:

- **Payload.** A uORB topic is a fixed struct, the contract carries bytes of any length. All topics
  have the largest slot that PX4 can state (``o_size``, u16) and put the length, u16, in front. Above
  65,533 bytes `publish_raw` answers MESSAGE_TOO_LARGE; an empty sample is a sample.
- **Depth.** The queue length belongs to the topic, in PX4 to its message definition. Here every topic
  has the longest queue that is a power of two and fits ``o_queue``, u8: 128. A subscription reads the
  last ``depth`` of it, so each has exactly the depth that it asked for, also across the wrap of the
  generation. More than 128 is refused (INCOMPATIBLE_QOS); 0 becomes 1, PX4's default.
- **MessageLost** counts when a publication pushes an unread sample out of the depth, not at the next
  take as PX4's subscribers do: the total is the same, and it is reported without a further sample
  (MSL-007). Samples from before the subscription never count. Losses are per subscription, of all
  publishers together, which share one generation.
- **Late subscriptions** find the latest sample, one, whatever the depth: PX4's rule. It is history.
- **Destroyed publishers** leave the topic advertised, see `UorbPublisher`.
- **A type** is bound to a topic for as long as the bus lives, as message definitions are.
- **A sample larger than the caller's buffer** is dropped and counted as lost.
- **Domains** are separate buses; the sessions of one backend with one ``domain_id`` share theirs.
- **Refused**: both deadlines and both liveliness events, and all QoS that the bus lacks (`qos`).
"""

from __future__ import annotations

import random
import weakref
from collections.abc import Mapping
from typing import Any

from nros_backends.uorb.bus import WRAP
from nros_backends.uorb.domain import Domain
from nros_backends.uorb.entities import UorbPublisher, UorbSubscription
from nros_backends.uorb.session import UorbSession
from nros_conformance.rmw.backend import Backend, Entity, Host, Publisher, Session, SessionOptions, Subscription
from nros_conformance.rmw.codes import ReturnCode, RmwError


class UorbBackend(Backend):
    """PX4's uORB, as a model."""

    def __init__(self, host: Host) -> None:
        super().__init__(host)
        self._domains: dict[int, Domain] = {}
        self._sessions: weakref.WeakSet[UorbSession] = weakref.WeakSet()

    def create_session(self, options: SessionOptions) -> Session:
        """Raises `RmwError` INVALID_CONFIG for options that need a peer, INVALID_ARGUMENT."""
        if not options.node_name or options.domain_id < 0:
            raise RmwError(
                ReturnCode.INVALID_ARGUMENT, f"node {options.node_name!r} in domain {options.domain_id} cannot exist"
            )
        if options.locator:
            raise RmwError(ReturnCode.INVALID_CONFIG, f"locator {options.locator!r}: the bus has no address")
        if options.hard_liveliness_ms:
            raise RmwError(ReturnCode.INVALID_CONFIG, "hard liveliness: there is no agent that could check it")
        domain = self._domains.setdefault(options.domain_id, Domain())
        session = UorbSession(domain, self.host.clock)
        self._sessions.add(session)
        return session

    def close(self) -> None:
        for session in tuple(self._sessions):
            session.destroy()
        self._sessions.clear()
        self._domains.clear()

    def await_matched(self, publisher: Publisher, subscription: Subscription, until_ns: int) -> bool | None:
        """At once: both are on the bus or never will be."""
        if not isinstance(publisher, UorbPublisher) or not isinstance(subscription, UorbSubscription):
            return None
        return publisher.node is subscription.node

    def versions(self) -> Mapping[str, str]:
        return {"PX4 uORB (model)": "0148665"}

    def inject(self, fault: str, **arguments: Any) -> int:
        """``preset``: the generation of a topic, or the total of lost samples of a subscription.

        ``inject``: see `Domain.disturb`.
        """
        match fault, arguments:
            case "inject", {"session": UorbSession() as session, "count": int(count)}:
                return session.disturb(random.Random(arguments.get("seed", 0)), count)
        entity = arguments.get("entity")
        if fault != "preset" or not isinstance(entity, UorbPublisher | UorbSubscription):
            return ReturnCode.UNSUPPORTED
        if arguments["kind"] is None:
            return self.preset(entity, arguments["count"])
        return entity.preset_total(arguments["kind"], arguments["count"])

    def preset(self, entity: Entity, generation: int) -> int:
        """The fault ``preset``: move the generation of the entity's topic, u32, without any loss.

        OK, or INVALID_ARGUMENT for an entity that is not of this backend or a value that does not fit.
        """
        if not isinstance(entity, UorbPublisher | UorbSubscription) or not 0 <= generation < WRAP:
            return ReturnCode.INVALID_ARGUMENT
        return entity.preset(generation)
