"""Datagrams that are no RTPS message, or none that means anything to anybody: the fault ``inject``.

What carries the name of a participant that lives is broken beyond doubt (DDSI-RTPS 2.3, 8.3.7, says of each
submessage when it is invalid), so that nobody may act on it. What is broken by chance, and so might make sense,
carries the name of nobody; announcements of that sort belong to a domain in which nobody is.
"""

from __future__ import annotations

import itertools
import random
import struct
from collections.abc import Iterator, Sequence

from nros_backends.cyclone.ear import parameters

_VERSION = bytes((2, 5, 1, 16))
"""Of the protocol, and the vendor: Cyclone's own, to which it is strict."""

_LITTLE, _INLINE_QOS, _HAS_DATA, _HAS_KEY = 0x01, 0x02, 0x04, 0x08
_ACKNACK, _HEARTBEAT, _GAP, _INFO_TS, _INFO_DST = 0x06, 0x07, 0x08, 0x09, 0x0E
_INFO_REPLY, _NACK_FRAG, _HEARTBEAT_FRAG, _DATA, _DATA_FRAG = 0x0F, 0x12, 0x13, 0x15, 0x16
_FIXED = (_ACKNACK, _HEARTBEAT, _GAP, _INFO_TS, _INFO_DST, _NACK_FRAG, _HEARTBEAT_FRAG, _DATA, _DATA_FRAG)
"""Submessages with fields that have to be there."""

_ANYBODY = b"\0\0\0\0"
_UNKNOWN_READER = b"\0\xff\xff\x04"
_UNKNOWN_WRITER = b"\0\xff\xff\x03"
_LIVELINESS_WRITER = b"\0\x02\0\xc2"
"""BuiltinParticipantMessageWriter, whose samples are assertions (8.4.13)."""

_TO_INLINE_QOS = 16
_CDR_LE = b"\0\1\0\0"
_DOMAIN_ID = 0x000F
_NOBODYS_DOMAIN = 0x7FFF_FFF0
_OVERSIZED = 60_000


def malformed(
    writers: Sequence[bytes], readers: Sequence[bytes], announcement: bytes, chance: random.Random, count: int
) -> Iterator[bytes]:
    """``count`` datagrams, each kind in turn, and one that is oversized.

    ``writers`` and ``readers`` are GUIDs that the victim knows, ``announcement`` was heard of a participant.
    """
    rounds = (
        itertools.chain(
            _torn(announcement, chance),
            _as_writer(chance.choice(writers), chance),
            _as_reader(chance.choice(readers)),
            _as_nobody(announcement, chance),
            _behind_all_numbers(chance.choice(writers)),
        )
        for _ in itertools.count()
    )
    yield from itertools.islice(itertools.chain.from_iterable(rounds), count)
    if count:
        yield _message(_nobody(chance), _data(_UNKNOWN_WRITER, 1, bytes(_OVERSIZED)))


def _torn(announcement: bytes, chance: random.Random) -> Iterator[bytes]:
    """A datagram that was heard, in pieces, and what surrounds submessages."""
    begin = parameters(announcement)
    assert begin is not None
    name = announcement[8:20]
    yield b""
    yield announcement[: chance.randrange(1, 20)]
    yield b"RTPX" + announcement[4:]
    yield announcement[:4] + b"\x09\0" + announcement[6:]
    yield announcement[: chance.randrange(begin + 1, len(announcement) - 4)]
    yield announcement[: begin + 2] + b"\xf0\xff" + announcement[begin + 4 :]  # a parameter longer than all
    yield announcement[:20] + bytes((chance.choice(_FIXED), _LITTLE, 0xF0, 0xFF)) + chance.randbytes(40)
    yield announcement[:20] + bytes((chance.choice(_FIXED), _LITTLE, 2, 0, 0, 0))
    yield _message(name, bytes((chance.choice(_FIXED), _LITTLE, 4, 0)) + bytes(4))
    yield _message(name, bytes((_INFO_TS, _LITTLE))[: chance.randrange(1, 3)])
    yield _message(name, _submessage(_INFO_REPLY, b"\xff\xff\xff\x7f" + bytes(24)))
    yield _message(name, *(bytes((1, 0, 0, 0)) for _ in range(300)), bytes((0x01,)))  # PAD, and half of one
    yield _message(name, *(_submessage(kind, chance.randbytes(12)) for kind in (0x30, 0x31, 0x34, 0x7F, 0xFF)))


def _as_writer(guid: bytes, chance: random.Random) -> Iterator[bytes]:
    """What a writer would send, if its numbers, lengths or names were possible."""
    name, writer = guid[:12], guid[12:]
    sample = _CDR_LE + chance.randbytes(48)
    for number in (0, -1, -(2**63)):
        yield _message(name, _data(writer, number, sample))
        yield _message(name, _data(_LIVELINESS_WRITER, number, name + sample))
    yield _message(name, _data(writer, 0, sample, to_inline_qos=chance.choice((0, 3, 0x7FF0, 0xFFFF))))
    yield _message(name, _data(writer, 0, b"\x70\0\xf0\xff" + sample, flags=_INLINE_QOS | _HAS_DATA))
    yield _message(name, _data(writer, 0, b"\0", flags=_HAS_KEY))
    yield _message(name, _data(_UNKNOWN_WRITER, 1, sample))
    yield _message(name, _data(writer, 0, sample, reader=_UNKNOWN_READER))
    for first, last in ((0, 5), (9, 2), (2**62, 1)):
        yield _message(name, _submessage(_HEARTBEAT, _ANYBODY + writer + _number(first) + _number(last) + b"\1\0\0\0"))
    for start, base, bits in ((0, 1, 0), (5, 2, 8), (1, 2, 257), (1, 2, 2**32 - 1), (-5, 0, 32)):
        yield _message(name, _submessage(_GAP, _ANYBODY + writer + _number(start) + _bitmap(base, bits)))
    for start, many, size, whole in ((0, 1, 16, 64), (1, 0, 16, 64), (1, 1, 0, 64), (900, 1, 16, 64)):
        fragment = struct.pack("<HH4s4s", 0, 28, _ANYBODY, writer) + _number(0)
        fragment += struct.pack("<IHHI", start, many, size, whole) + sample
        yield _message(name, _submessage(_DATA_FRAG, fragment))
    huge = struct.pack("<HH4s4s", 0, 28, _ANYBODY, _UNKNOWN_WRITER) + _number(1)
    yield _message(name, _submessage(_DATA_FRAG, huge + struct.pack("<IHHI", 1, 1, 0xFFFF, 2**32 - 1) + sample))
    yield _message(name, _submessage(_HEARTBEAT_FRAG, _ANYBODY + writer + _number(0) + bytes(8)))


def _as_reader(guid: bytes) -> Iterator[bytes]:
    """What a reader would answer, if its sets of numbers were possible."""
    name, reader = guid[:12], guid[12:]
    for base, bits in ((0, 8), (-1, 1), (1, 257), (1, 2**32 - 1)):
        yield _message(name, _submessage(_ACKNACK, reader + _UNKNOWN_WRITER + _bitmap(base, bits) + b"\1\0\0\0"))
    yield _message(name, _submessage(_ACKNACK, reader + _UNKNOWN_WRITER))
    fragments = struct.pack("<II", 0, 1_000) + bytes(4)
    yield _message(name, _submessage(_NACK_FRAG, reader + _UNKNOWN_WRITER + _number(0) + fragments + bytes(4)))


def _as_nobody(announcement: bytes, chance: random.Random) -> Iterator[bytes]:
    """Noise, and whole messages in which octets have changed."""
    yield chance.randbytes(chance.randrange(1, 200))
    yield b"RTPS" + chance.randbytes(chance.randrange(1, 200))
    name = _nobody(chance)
    sample = _CDR_LE + chance.randbytes(48)
    for whole in (
        _data(_UNKNOWN_WRITER, 1, sample),
        _submessage(_HEARTBEAT, _ANYBODY + _UNKNOWN_WRITER + _number(1) + _number(9) + b"\1\0\0\0"),
        _submessage(_GAP, _ANYBODY + _UNKNOWN_WRITER + _number(1) + _bitmap(2, 32)),
        _submessage(_ACKNACK, _UNKNOWN_READER + _UNKNOWN_WRITER + _bitmap(1, 32) + b"\1\0\0\0"),
        _submessage(_INFO_DST, bytes(12)) + _submessage(_INFO_TS, bytes(8)) + _data(_UNKNOWN_WRITER, 1, sample),
    ):
        yield _message(name, _changed(whole, chance))
    begin = parameters(announcement)
    assert begin is not None
    elsewhere = struct.pack("<HHI", _DOMAIN_ID, 4, _NOBODYS_DOMAIN)
    for _ in range(3):
        told = elsewhere + _changed(announcement[begin:], chance)
        yield _message(name, _data(b"\0\1\0\xc2", 1, b"\0\3\0\0" + told, reader=b"\0\1\0\xc7"))


def _behind_all_numbers(guid: bytes) -> Iterator[bytes]:
    """A HEARTBEAT with negative numbers. The last kind, because Cyclone 11.0.1 acts on it (C4 in backend.toml)."""
    heartbeat = _ANYBODY + guid[12:] + _number(-3) + _number(-1) + b"\1\0\0\0"
    yield _message(guid[:12], _submessage(_HEARTBEAT, heartbeat))


def _nobody(chance: random.Random) -> bytes:
    """A GUID prefix that no participant has."""
    return b"\xee" * 4 + chance.randbytes(8)


def _changed(octets: bytes, chance: random.Random) -> bytes:
    """One to eight octets of it are others."""
    changed = bytearray(octets)
    for _ in range(chance.randrange(1, 9)):
        changed[chance.randrange(len(changed))] = chance.randrange(256)
    return bytes(changed)


def _message(prefix: bytes, *submessages: bytes) -> bytes:
    return b"RTPS" + _VERSION + prefix + b"".join(submessages)


def _submessage(kind: int, body: bytes, flags: int = 0) -> bytes:
    return struct.pack("<BBH", kind, _LITTLE | flags, len(body)) + body


def _data(
    writer: bytes, number: int, content: bytes, *, reader: bytes = _ANYBODY, flags: int = _HAS_DATA,
    to_inline_qos: int = _TO_INLINE_QOS,
) -> bytes:  # fmt: skip
    head = struct.pack("<HH4s4s", 0, to_inline_qos, reader, writer) + _number(number)
    return _submessage(_DATA, head + content, flags)


def _number(number: int) -> bytes:
    """A sequence number: the high half first."""
    return struct.pack("<iI", number >> 32, number & 0xFFFF_FFFF)


def _bitmap(base: int, bits: int) -> bytes:
    """A set of sequence numbers that says it has so many bits, and has 32 at most."""
    return _number(base) + struct.pack("<I", bits) + (b"\xff\xff\xff\xff" if bits else b"")
