"""Identifiers and codes of DDS-XRCE 1.0 (clauses 7.7 and 8.3)."""

from __future__ import annotations

import enum
from typing import NamedTuple

NO_SESSION = 0x80
"""Session id of messages outside a session, without a client key; 0x00 is the same with one."""

KEYLESS = 0x80
"""Session ids from here on carry no client key in the message header."""

NO_STREAM = 0x00
BEST_EFFORT = 0x01
"""The best-effort stream of eProsima's client and the first of 127."""
RELIABLE = 0x80
"""The reliable stream of eProsima's client and the first of 128."""

COOKIE = b"XRCE"
VERSION = (1, 0)
VENDOR = (0x01, 0x0F)
"""eProsima: what its client and its agent put in, and therefore we."""


def is_reliable(stream: int) -> bool:
    """Whether a stream id is one of a reliable stream."""
    return stream >= RELIABLE


class Kind(enum.IntEnum):
    """Object kinds: the low four bits of an object id. 7 and 8 are eProsima's, for services."""

    INVALID = 0x0
    PARTICIPANT = 0x1
    TOPIC = 0x2
    PUBLISHER = 0x3
    SUBSCRIBER = 0x4
    DATAWRITER = 0x5
    DATAREADER = 0x6
    REQUESTER = 0x7
    REPLIER = 0x8
    RESERVED = 0x9
    TYPE = 0xA
    QOSPROFILE = 0xB
    APPLICATION = 0xC
    AGENT = 0xD
    CLIENT = 0xE
    SESSION = 0xF


class ObjectId(NamedTuple):
    """12 bits of number and 4 of kind; on the wire two bytes, always big-endian."""

    number: int
    kind: Kind

    def __str__(self) -> str:
        return f"{self.kind.name}#{self.number}"


AGENT = ObjectId(0xFFF, Kind.AGENT)
CLIENT = ObjectId(0xFFF, Kind.CLIENT)
SESSION = ObjectId(0xFFF, Kind.SESSION)


class Status(enum.IntEnum):
    """STATUS codes (``StatusValue``)."""

    OK = 0x00
    OK_MATCHED = 0x01
    DDS_ERROR = 0x80
    MISMATCH = 0x81
    ALREADY_EXISTS = 0x82
    DENIED = 0x83
    UNKNOWN_REFERENCE = 0x84
    INVALID_DATA = 0x85
    INCOMPATIBLE = 0x86
    RESOURCES = 0x87


class Id(enum.IntEnum):
    """Submessage ids."""

    CREATE_CLIENT = 0
    CREATE = 1
    GET_INFO = 2
    DELETE = 3
    STATUS_AGENT = 4
    STATUS = 5
    INFO = 6
    WRITE_DATA = 7
    READ_DATA = 8
    DATA = 9
    ACKNACK = 10
    HEARTBEAT = 11
    RESET = 12
    FRAGMENT = 13
    TIMESTAMP = 14
    TIMESTAMP_REPLY = 15


class DataFormat(enum.IntEnum):
    """``flags & 0x0e`` of DATA and WRITE_DATA, and the format of READ_DATA. Only DATA is used in practice."""

    DATA = 0x00
    SAMPLE = 0x02
    DATA_SEQ = 0x08
    SAMPLE_SEQ = 0x0A
    PACKED_SAMPLES = 0x0E
