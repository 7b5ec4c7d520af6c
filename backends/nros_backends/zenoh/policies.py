"""Names and QoS: what is accepted, and which ends go together.

zenoh knows none of the contract's policies but the reliability of a link, so all of them are the shim's:

- depth of a subscription is its receive queue; of a transient-local publisher, what it keeps for late ones;
- TRANSIENT_LOCAL: see `history`;
- lifespan: the publisher's, counted from reception, and from the publication for what late ones get;
- deadlines and MANUAL liveliness run on the shim's clock;
- AUTOMATIC liveliness is the lease of a zenoh transport. A publisher with a shorter lease than the session's
  has its token on a transport of its own.
- depth 0 becomes 1; `Entity.qos` says so. NONE is AUTOMATIC without a lease.
- A finite lease below `MIN_LEASE_MS` is refused: the keep-alives of a transport are a quarter of it apart, and
  at 30 ms a busy host makes a healthy one look dead.
- Ends are matched as DDS matches them (requested against offered), by what their tokens say.
"""

from __future__ import annotations

import re

from nros_conformance.rmw.admission import NAME_MAX, admit_names, refuse_short_lease
from nros_conformance.rmw.qos import Liveliness, QosProfile, is_finite

MIN_LEASE_MS = 100

_NODE = re.compile(r"[A-Za-z0-9_.-]+", re.ASCII)


def admit(topic: object, type_name: object, qos: QosProfile) -> QosProfile:
    """The QoS in force for an entity with these names.

    Raises `RmwError` TOPIC_NAME_INVALID, INVALID_ARGUMENT, INCOMPATIBLE_QOS.
    """
    qos = admit_names(topic, type_name, qos)
    refuse_short_lease(qos, MIN_LEASE_MS)
    return qos


def is_node_name(name: object) -> bool:
    """Whether it can be a chunk of a key."""
    return isinstance(name, str) and len(name) <= NAME_MAX and _NODE.fullmatch(name) is not None


def compatible(offered: QosProfile, requested: QosProfile) -> bool:
    """Whether a publisher offers at least what a subscription asks for (DDS 1.4, 2.2.3)."""
    return (
        offered.reliability >= requested.reliability
        and offered.durability >= requested.durability
        and _at_most(offered.deadline_ms, requested.deadline_ms)
        and offered.liveliness.strength >= requested.liveliness.strength
        and _at_most(_lease_ms(offered), _lease_ms(requested))
    )


def _lease_ms(qos: QosProfile) -> int:
    return 0 if qos.liveliness is Liveliness.NONE else qos.lease_ms


def _at_most(offered_ms: int, requested_ms: int) -> bool:
    return not is_finite(requested_ms) or (is_finite(offered_ms) and offered_ms <= requested_ms)
