"""XRCE messages as frozen values: one per submessage of DDS-XRCE 1.0 (clause 8.3.5).

All of them compare by value. ``little`` is the byte order of the submessage's payload; both of
eProsima's sides always send little-endian.
"""

from __future__ import annotations

import msgspec

from nros_backends.xrce.wire.ids import COOKIE, NO_STREAM, VENDOR, VERSION, Kind, ObjectId

MAX_KEYED = 0x7F
"""Largest session id whose messages carry the client key."""


class Header(msgspec.Struct, frozen=True):
    """In front of every message. ``key``: u32, present exactly if ``session`` is at most 0x7f."""

    session: int
    stream: int = NO_STREAM
    sequence: int = 0
    key: int | None = None


class Submessage(msgspec.Struct, frozen=True, kw_only=True):
    """What all submessages have. ``little``: byte order of the payload."""

    little: bool = True


class CreateClient(Submessage, frozen=True):
    """Opens a session (id 0). ``mtu``: octets of the largest message the client takes, its header included.

    ``understated``: the length field says 16 although properties follow, as eProsima's client writes it.
    """

    key: int
    session: int
    mtu: int
    properties: tuple[tuple[str, str], ...] = ()
    cookie: bytes = COOKIE
    version: tuple[int, int] = VERSION
    vendor: tuple[int, int] = VENDOR
    understated: bool = False


class Ref(msgspec.Struct, frozen=True):
    """Representation by the name of a profile that the agent knows."""

    name: str


class Xml(msgspec.Struct, frozen=True):
    """Representation by an XML document of DDS-XML."""

    text: str


class Binary(msgspec.Struct, frozen=True):
    """Representation in CDR, in the byte order of its submessage; see `nros_backends.xrce.wire.binary`."""

    body: bytes


Representation = Ref | Xml | Binary


class Create(Submessage, frozen=True):
    """Creates an entity (id 1). ``kind`` is that of the representation and should be that of ``object``.

    A participant has a ``domain`` (i16), everything else a ``parent``.
    """

    request: int
    object: ObjectId
    kind: Kind
    representation: Representation
    parent: ObjectId | None = None
    domain: int = 0
    reuse: bool = False
    replace: bool = False


CONFIGURATION = 0x1
"""Bit of GET_INFO's mask: the agent asks a client for nothing else."""
ACTIVITY = 0x2
"""Bit of GET_INFO's mask: what eProsima's client pings with."""


class GetInfo(Submessage, frozen=True):
    """Asks for information (id 2); with object AGENT or, from the agent, CLIENT it is the ping."""

    request: int
    object: ObjectId
    mask: int


class Delete(Submessage, frozen=True):
    """Deletes an entity, or with object CLIENT the session (id 3)."""

    request: int
    object: ObjectId


class StatusAgent(Submessage, frozen=True):
    """Answers CREATE_CLIENT (id 4)."""

    status: int
    implementation: int = 0
    cookie: bytes = COOKIE
    version: tuple[int, int] = VERSION
    vendor: tuple[int, int] = VENDOR


class StatusReply(Submessage, frozen=True):
    """STATUS (id 5): the outcome of a request, `Status` or another u8."""

    request: int
    object: ObjectId
    status: int
    implementation: int = 0


class AgentConfiguration(msgspec.Struct, frozen=True):
    """``AGENT_Representation`` without properties."""

    cookie: bytes = COOKIE
    version: tuple[int, int] = VERSION
    vendor: tuple[int, int] = VENDOR


class AgentActivity(msgspec.Struct, frozen=True):
    """``AGENT_ActivityInfo`` without locators. ``availability``: i16, 1 is available."""

    availability: int = 1


class Info(Submessage, frozen=True):
    """Answers GET_INFO (id 6). ``implementation`` 1: the agent knows the session; 0: it does not."""

    request: int
    object: ObjectId
    status: int = 0
    implementation: int = 0
    configuration: AgentConfiguration | None = None
    activity: AgentActivity | None = None


class WriteData(Submessage, frozen=True):
    """A sample for a data writer (id 7). ``data``: CDR without encapsulation."""

    request: int
    object: ObjectId
    data: bytes
    format: int = 0


class DeliveryControl(msgspec.Struct, frozen=True):
    """How much READ_DATA asks for. Seconds and octets; 0 and ``max_samples`` 0xffff are without limit."""

    max_samples: int = 0xFFFF
    max_elapsed_s: int = 0
    max_octets_per_s: int = 0
    min_pace_ms: int = 0


class ReadData(Submessage, frozen=True):
    """Asks a data reader for samples (id 8); without ``delivery`` for one."""

    request: int
    object: ObjectId
    stream: int
    format: int = 0
    content_filter: str | None = None
    delivery: DeliveryControl | None = None


class Data(Submessage, frozen=True):
    """A sample from a data reader (id 9). ``request``: that of READ_DATA."""

    request: int
    object: ObjectId
    data: bytes
    format: int = 0


class Acknack(Submessage, frozen=True):
    """What a receiver has (id 10): all before ``first_unacked``; bit i of ``missing`` is that plus i."""

    first_unacked: int
    missing: int
    stream: int


class Heartbeat(Submessage, frozen=True):
    """What a sender still keeps (id 11): ``first`` to ``last``."""

    first: int
    last: int
    stream: int


class Reset(Submessage, frozen=True):
    """All streams back to sequence number 0 (id 12)."""


class Fragment(Submessage, frozen=True):
    """A piece of a submessage with its header (id 13)."""

    data: bytes
    last: bool = False


class Time(msgspec.Struct, frozen=True):
    """A time of the wire: seconds i32, nanoseconds u32."""

    seconds: int
    nanoseconds: int

    @classmethod
    def of(cls, ns: int) -> Time:
        """The time of an integer count of nanoseconds."""
        return cls(*divmod(ns, 1_000_000_000))

    @property
    def ns(self) -> int:
        """In nanoseconds."""
        return self.seconds * 1_000_000_000 + self.nanoseconds


class Timestamp(Submessage, frozen=True):
    """Asks for the agent's time (id 14)."""

    transmit: Time


class TimestampReply(Submessage, frozen=True):
    """The agent's times when it sent this and when it received, and the client's own (id 15)."""

    transmit: Time
    receive: Time
    originate: Time


class LivelinessAnswer(Submessage, frozen=True):
    """The whole body of eProsima's client's answer to the agent's ping: eight zeros, no submessage header."""


class Unknown(Submessage, frozen=True):
    """A submessage whose id (16 and above) the specification does not have. ``flags`` without bit 0."""

    id: int
    flags: int
    payload: bytes


class Message(msgspec.Struct, frozen=True):
    """One datagram. ``trailing``: padding after the last submessage, which eProsima's client sends."""

    header: Header
    submessages: tuple[Submessage, ...] = ()
    trailing: bytes = b""
