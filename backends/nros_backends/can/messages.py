"""What sessions tell each other beside the samples: heartbeat, endpoints, counts and signs of life.

The heartbeat is Cyphal's (``uavcan.node.Heartbeat.1.0``). The rest is this adapter's own, on three
subjects of its own, little endian. Trailing bytes are padding of CAN FD, or later versions, and ignored.

    endpoint  u8 version, u8 round, u16 endpoint, u16 subject, u16 bits, u32 count, u32 lease, u32 node lease,
              u32 silent, u32 deadline, u32 lifespan (all ms), 8 bytes each: digests of topic and type
    status    u16 subject, u32 count, u8 bits: seven bytes, one frame also of classic CAN
    sign      u8 kind, u16 endpoint, u8 round
"""

from __future__ import annotations

import dataclasses
import enum
import hashlib
import struct

from nros_conformance.rmw.qos import Durability, Liveliness, Reliability

HEARTBEAT_SUBJECT = 7509
ENDPOINT_SUBJECT, STATUS_SUBJECT, SIGN_SUBJECT = 6141, 6142, 6143
"""The last ones of the range that is free for use (Cyphal 1.0, 2.1)."""

EXPIRED_MS = 2**32 - 1
"""``silent_ms`` of a publisher that has missed its lease."""

_VERSION = 1
_HEARTBEAT = struct.Struct("<IBBB")
_ENDPOINT = struct.Struct("<BBHHHIIIIII8s8s")
_STATUS = struct.Struct("<HIB")
_SIGN = struct.Struct("<BHB")
_REBASED = 1
_READER, _RELIABLE, _TRANSIENT = 1, 2, 4
_LIVELINESS_SHIFT = 3


def digest(name: str) -> bytes:
    """Eight bytes that stand for a topic or type name."""
    return hashlib.sha256(name.encode()).digest()[:8]


@dataclasses.dataclass(frozen=True, slots=True)
class Heartbeat:
    """``uptime_s`` runs back when a node restarts; ``incarnation`` (the vendor's byte) tells quick ones apart."""

    uptime_s: int
    incarnation: int

    def encode(self) -> bytes:
        """Seven bytes: health nominal, mode operational."""
        return _HEARTBEAT.pack(self.uptime_s, 0, 0, self.incarnation)

    @classmethod
    def decode(cls, data: bytes) -> Heartbeat | None:
        """None when it is too short."""
        if len(data) < _HEARTBEAT.size:
            return None
        uptime_s, _, _, incarnation = _HEARTBEAT.unpack_from(data)
        return cls(uptime_s, incarnation)


@dataclasses.dataclass(frozen=True, slots=True)
class Endpoint:
    """A publisher or subscription, as its session announces it. Durations are ms, 0 is no check."""

    number: int
    """Which one of its node."""
    subject: int
    """Where a publisher sends; 0 for a subscription."""
    is_reader: bool
    topic: bytes
    type: bytes
    reliability: Reliability
    durability: Durability
    liveliness: Liveliness
    lease_ms: int
    node_lease_ms: int
    """After so long without a heartbeat its node is gone."""
    deadline_ms: int
    lifespan_ms: int
    count: int = 0
    """Samples that its node has sent on the subject so far."""
    silent_ms: int = 0
    """Since when a manual publisher has not asserted; `EXPIRED_MS` when it has missed its lease."""
    round: int = 0

    def encode(self) -> bytes:
        """The 56 bytes of the announcement."""
        bits = (
            _READER * self.is_reader
            | _RELIABLE * (self.reliability is Reliability.RELIABLE)
            | _TRANSIENT * (self.durability is Durability.TRANSIENT_LOCAL)
            | self.liveliness << _LIVELINESS_SHIFT
        )
        return _ENDPOINT.pack(
            _VERSION, self.round, self.number, self.subject, bits, self.count, self.lease_ms, self.node_lease_ms,
            self.silent_ms, self.deadline_ms, self.lifespan_ms, self.topic, self.type,
        )  # fmt: skip

    @classmethod
    def decode(cls, data: bytes) -> Endpoint | None:
        """None when it is too short or of another version."""
        if len(data) < _ENDPOINT.size or data[0] != _VERSION:
            return None
        _, round_, number, subject, bits, count, lease, node_lease, silent, deadline, lifespan, topic, type_ = (
            _ENDPOINT.unpack_from(data)
        )
        return cls(
            number=number, subject=subject, is_reader=bool(bits & _READER), topic=topic, type=type_,
            reliability=Reliability(bool(bits & _RELIABLE)), durability=Durability(bool(bits & _TRANSIENT)),
            liveliness=Liveliness(bits >> _LIVELINESS_SHIFT & 3), lease_ms=lease, node_lease_ms=node_lease,
            deadline_ms=deadline, lifespan_ms=lifespan, count=count, silent_ms=silent, round=round_,
        )  # fmt: skip


@dataclasses.dataclass(frozen=True, slots=True)
class Status:
    """How many transfers a node has sent on a subject; ``rebased``: it goes on from there, nothing was lost."""

    subject: int
    count: int
    rebased: bool = False

    def encode(self) -> bytes:
        """Seven bytes."""
        return _STATUS.pack(self.subject, self.count, _REBASED * self.rebased)

    @classmethod
    def decode(cls, data: bytes) -> Status | None:
        """None when it is too short."""
        if len(data) < _STATUS.size:
            return None
        subject, count, bits = _STATUS.unpack_from(data)
        return cls(subject, count, bool(bits & _REBASED))


class SignKind(enum.IntEnum):
    """What a sign says of an endpoint; endpoint 0 is the node."""

    ASSERTS = 1
    """The application asserts the liveliness of this publisher, or of all MANUAL_BY_NODE ones of the node."""
    GONE = 2
    """Destroyed in an orderly way; of the node: with all that it had."""
    ROUND = 3
    """All endpoints have been announced; what was missing in two rounds does not exist any more."""


@dataclasses.dataclass(frozen=True, slots=True)
class Sign:
    """A sign of life, or of its end."""

    kind: SignKind
    endpoint: int = 0
    round: int = 0

    def encode(self) -> bytes:
        """Four bytes."""
        return _SIGN.pack(self.kind, self.endpoint, self.round)

    @classmethod
    def decode(cls, data: bytes) -> Sign | None:
        """None when it is too short or of an unknown kind."""
        if len(data) < _SIGN.size:
            return None
        kind, endpoint, round_ = _SIGN.unpack_from(data)
        return cls(SignKind(kind), endpoint, round_) if kind in (1, 2, 3) else None
