"""The sample type on the wire: the application's bytes behind what the shim needs to know about them.

An IDL struct, keyless and final::

    struct Sample {
        octet publisher[16];               // GUID of the writer
        unsigned long long number;         // 1, 2, 3... per writer, counts successful writes
        long long sent;                    // CLOCK_MONOTONIC of this host, ns
        long long expires;                 // the same clock; 2^63 - 1 without a lifespan
        sequence<octet> payload_<digest>;
    };

DDS compares types by structure and not by name (DDS-XTypes 7.6.3.4.2), so the name of the payload
member carries a digest of the type name: other type, no match. ``CLOCK_MONOTONIC`` is one clock for
all processes of a host, and this adapter never leaves the host.
"""

from __future__ import annotations

import functools
import hashlib
import struct
import threading
from typing import Any, TypeAlias, cast

from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl.annotations import final
from cyclonedds.idl.types import array, int64, sequence, uint8, uint64

CAPACITY = 2**20
"""Bytes of the largest payload; above it `publish_raw` answers MESSAGE_TOO_LARGE. DDS itself takes
more, but a best-effort sample of several socket buffers (208 KiB here) is unlikely to arrive whole."""

_HEADER = struct.Struct("<4s16sQqqI")
_CDR_LE = b"\x00\x01\x00\x00"
"""Encapsulation: plain CDR, little endian (DDSI-RTPS 10.5)."""

_building = threading.Lock()
"""The binding builds types through a global of its own; two threads at once would mix their members."""

SampleType: TypeAlias = type[IdlStruct]


class Received:
    """One sample as taken from DDS. ``payload`` is None for wire bytes that are no such sample."""

    __slots__ = ("expires_ns", "number", "payload", "publisher", "sample_info", "sent_ns")

    def __init__(self, publisher: bytes, number: int, sent_ns: int, expires_ns: int, payload: bytes | None) -> None:
        self.publisher = publisher
        self.number = number
        self.sent_ns = sent_ns
        self.expires_ns = expires_ns
        self.payload = payload
        self.sample_info: Any = None
        """Set by the binding."""


def encode(publisher: bytes, number: int, sent_ns: int, expires_ns: int, payload: bytes) -> bytes:
    """The CDR of one sample, padded to whole words as DDSI-RTPS asks."""
    header = _HEADER.pack(_CDR_LE, publisher, number, sent_ns, expires_ns, len(payload))
    return header + payload + bytes(-len(payload) % 4)


def decode(data: bytes) -> Received:
    """The sample of these wire bytes; without payload when they are malformed (ROB-001)."""
    if len(data) >= _HEADER.size:
        encapsulation, publisher, number, sent_ns, expires_ns, length = _HEADER.unpack_from(data)
        # The last two octets of the encapsulation may say how much is padding.
        if encapsulation[:2] == _CDR_LE[:2] and length <= len(data) - _HEADER.size:
            payload = data[_HEADER.size : _HEADER.size + length]
            return Received(publisher, number, sent_ns, expires_ns, payload)
    return Received(b"", 0, 0, 0, None)


def _no_key(data: bytes, has_header: bool = True, use_version_2: bool | None = None) -> None:
    """What the binding shows of a sample without data, such as the notice that a writer has gone."""


@functools.lru_cache(maxsize=256)
def sample_type(type_name: str) -> SampleType:
    """The IDL type for samples of this type name, the same class for each call."""
    digest = hashlib.sha256(type_name.encode()).hexdigest()[:16]
    members = {
        "publisher": array[uint8, 16],  # type: ignore[misc]  # generic by the binding's mypy plugin
        "number": uint64,
        "sent": int64,
        "expires": int64,
        f"payload_{digest}": sequence[uint8],  # type: ignore[misc]
    }
    with _building:
        made: Any = final(make_idl_struct("Sample", dds_type_name(type_name), members))
        made.__idl__.populate()
        made.__idl__.fill_type_data()
        # The binding asks the type to decode; ours is 15 times faster for a large payload.
        made.deserialize = staticmethod(decode)
        made.deserialize_key = staticmethod(_no_key)
        return cast(SampleType, made)


def dds_type_name(type_name: str) -> str:
    """``std_msgs/msg/String`` as DDS spells it: ``std_msgs::msg::String``."""
    return type_name.replace("/", "::")
