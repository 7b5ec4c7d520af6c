"""Key expressions as rmw_zenoh and nano-ros write them: data, liveliness tokens, the QoS within a token.

- data: ``<domain>/<topic>/<type>/<type hash>``
- token: ``@ros2_lv/<domain>/<session>/<node>/<entity>/<kind>/<enclave>/<namespace>/<node name>`` and, for an
  entity, ``/<topic>/<type>/<type hash>/<qos>``; a slash inside a name is written ``%``.
- qos: ``reliability:durability:history,depth:deadline s,ns:lifespan s,ns:liveliness,lease s,ns``, each field
  empty where it has rmw_zenoh's default.
"""

from __future__ import annotations

import dataclasses

import xxhash

from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.events import Side
from nros_conformance.rmw.qos import INFINITE_MS, Durability, History, Liveliness, QosProfile, Reliability, is_finite

TOKENS = "@ros2_lv"
NO_HASH = "TypeHashNotSupported"
"""What stands for the type hash where none is known; the contract carries none."""

NODE, PUBLISHER, SUBSCRIPTION = "NN", "MP", "MS"
_KINDS = {PUBLISHER: Side.PUBLISHER, SUBSCRIPTION: Side.SUBSCRIPTION}
_CODES = {side: code for code, side in _KINDS.items()}
_FIELDS = 13

# Values of the rmw enumerations (rmw/types.h); what is left out of a token has the first of each.
_RELIABILITY = {Reliability.RELIABLE: 1, Reliability.BEST_EFFORT: 2}
_DURABILITY = {Durability.VOLATILE: 2, Durability.TRANSIENT_LOCAL: 1}
_HISTORY = {History.KEEP_LAST: 1, History.KEEP_ALL: 2}
_LIVELINESS = {Liveliness.AUTOMATIC: 1, Liveliness.MANUAL_BY_NODE: 2, Liveliness.MANUAL_BY_TOPIC: 3}
_DEPTH = 42

_SECOND = 1000 * MS


@dataclasses.dataclass(frozen=True, slots=True)
class Token:
    """An entity as its liveliness token describes it."""

    key: str
    session: str
    side: Side
    topic: str
    """With its slashes, beginning with one."""
    type_name: str
    """As in the key: ``std_msgs::msg::dds_::String_``."""
    qos: QosProfile
    gid: bytes


def absolute(topic: str) -> str:
    """The topic with a slash in front."""
    return topic if topic.startswith("/") else f"/{topic}"


def wire_type(type_name: str) -> str:
    """``std_msgs/msg/String`` as it is spelled in keys; other names keep their parts.

    >>> wire_type("std_msgs/msg/String")
    'std_msgs::msg::dds_::String_'
    """
    *package, name = type_name.replace("::", "/").split("/")
    return "::".join([*package, "dds_", f"{name}_"])


def data_key(domain: int, topic: str, type_name: str, type_hash: str = NO_HASH) -> str:
    """Where samples are put; with the hash ``*`` what a subscription asks for, as nano-ros does."""
    return f"{domain}/{absolute(topic)[1:]}/{wire_type(type_name)}/{type_hash}"


def node_key(domain: int, session: str, node_name: str) -> str:
    """The token of a session's node."""
    return f"{TOKENS}/{domain}/{session}/0/0/{NODE}/%/%/{node_name}"


def entity_key(
    domain: int, session: str, entity: int, side: Side, node_name: str, topic: str, type_name: str, qos: QosProfile
) -> str:
    """The token of an entity, unique by the session and the entity's number in it."""
    name = absolute(topic).replace("/", "%")
    owner = f"{TOKENS}/{domain}/{session}/0/{entity}/{_CODES[side]}/%/%/{node_name}"
    return f"{owner}/{name}/{wire_type(type_name)}/{NO_HASH}/{qos_chunk(qos)}"


def gid_of(key: str) -> bytes:
    """A publisher's gid as rmw_zenoh derives it: XXH3-128 of its token, low half first."""
    digest = xxhash.xxh3_128_intdigest(key.encode())
    return (digest % 2**64).to_bytes(8, "little") + (digest >> 64).to_bytes(8, "little")


def parse_token(key: str) -> Token | None:
    """None for a node's token, and for a key that is no well-formed token of a publisher or subscription."""
    parts = key.split("/")
    if len(parts) != _FIELDS or parts[0] != TOKENS or parts[5] not in _KINDS or not parts[9].startswith("%"):
        return None
    qos = parse_qos(parts[12])
    if qos is None:
        return None
    return Token(key, parts[2], _KINDS[parts[5]], parts[9].replace("%", "/"), parts[10], qos, gid_of(key))


def qos_chunk(qos: QosProfile) -> str:
    """The QoS within a token."""
    reliability = _number(_RELIABILITY, qos.reliability)
    durability = _number(_DURABILITY, qos.durability)
    history = _number(_HISTORY, qos.history)
    depth = "" if qos.depth == _DEPTH else str(qos.depth)
    # NONE does not exist in rmw: it is alive for as long as it is known, as AUTOMATIC without a lease is.
    none = qos.liveliness is Liveliness.NONE
    liveliness = "" if none else _number(_LIVELINESS, qos.liveliness)
    lease = _duration(0 if none else qos.lease_ms)
    times = f"{_duration(qos.deadline_ms)}:{_duration(qos.lifespan_ms)}:{liveliness},{lease}"
    return f"{reliability}:{durability}:{history},{depth}:{times}"


def parse_qos(chunk: str) -> QosProfile | None:
    """None when it is malformed."""
    try:
        reliability, durability, history, deadline, lifespan, liveliness = chunk.split(":")
        kept, depth = history.split(",")
        kind, *lease = liveliness.split(",")
        return QosProfile(
            reliability=_value(_RELIABILITY, reliability),
            durability=_value(_DURABILITY, durability),
            history=_value(_HISTORY, kept),
            depth=int(depth) if depth else _DEPTH,
            deadline_ms=_milliseconds(*deadline.split(",")),
            lifespan_ms=_milliseconds(*lifespan.split(",")),
            liveliness=_value(_LIVELINESS, kind),
            lease_ms=_milliseconds(*lease),
        )
    except (ValueError, KeyError, TypeError):
        return None


def _number(numbers: dict, policy: object) -> str:  # type: ignore[type-arg]
    """Empty for the default."""
    first = next(iter(numbers))
    return "" if policy is first else str(numbers[policy])


def _value(numbers: dict, text: str):  # type: ignore[no-untyped-def,type-arg]
    by_number = {number: policy for policy, number in numbers.items()}
    return by_number[int(text)] if text else next(iter(numbers))


def _duration(duration_ms: int) -> str:
    if not is_finite(duration_ms):
        return ","
    seconds, rest = divmod(duration_ms * MS, _SECOND)
    return f"{seconds},{rest}"


def _milliseconds(seconds: str, nanoseconds: str) -> int:
    """A fraction of a millisecond rounds up, and what the ABI cannot hold is for ever."""
    total = int(seconds or 0) * _SECOND + int(nanoseconds or 0)
    return min(-(-total // MS), INFINITE_MS)
