"""Messages to bytes and back. Both directions hold to recordings of eProsima's client and agent 3.0.1."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from nros_backends.xrce.wire import messages as m
from nros_backends.xrce.wire import payloads
from nros_backends.xrce.wire.cdr import Malformed, Reader, Writer
from nros_backends.xrce.wire.fields import read_request
from nros_backends.xrce.wire.ids import KEYLESS, Id, ObjectId

LITTLE = 0x01
LIVELINESS_ANSWER = bytes(8)
SUBMESSAGE_HEADER = 4
"""Octets of a submessage header, and the alignment of submessages."""
STATED = 16
"""What eProsima's client states as the length of CREATE_CLIENT whether or not properties follow."""
HAS_PROPERTIES = 13
"""Where CREATE_CLIENT says that properties follow."""
LONGEST = 0xFFFF
"""Octets that the length field can state; a longer sample states 0 (eProsima's extension)."""
REQUESTS = frozenset({Id.CREATE, Id.DELETE, Id.GET_INFO, Id.READ_DATA})
"""Submessages that begin with a request id and are answered."""


class Frame(NamedTuple):
    """A submessage that is cut out but not read. ``offset``: of the payload in the message."""

    id: int
    flags: int
    length: int
    offset: int
    payload: bytes

    @property
    def request(self) -> tuple[int, ObjectId] | None:
        """What to answer to, also if the rest is malformed: request id and object id."""
        if self.id not in REQUESTS or len(self.payload) < 4:
            return None
        return read_request(Reader(self.payload))

    def read(self) -> m.Submessage:
        """The submessage. Raises `Malformed`."""
        reader = Reader(self.payload, bool(self.flags & LITTLE), origin=self.offset)
        submessage = payloads.read(self.id, self.flags, reader)
        if isinstance(submessage, m.CreateClient) and submessage.properties and self.length == STATED:
            return _understated(submessage)
        return submessage


def _understated(value: m.CreateClient) -> m.CreateClient:
    return m.CreateClient(
        key=value.key, session=value.session, mtu=value.mtu, properties=value.properties, cookie=value.cookie,
        version=value.version, vendor=value.vendor, little=value.little, understated=True,
    )  # fmt: skip


def decode_header(datagram: bytes) -> tuple[m.Header, int]:
    """The message header and where the body starts. Raises `Malformed`."""
    reader = Reader(datagram)
    session, stream = reader.take(2, "message header")
    sequence = reader.unsigned(2, "sequence number")  # little-endian in every message
    key = int.from_bytes(reader.take(4, "client key"), "big") if session < KEYLESS else None
    return m.Header(session, stream, sequence, key), reader.position


def encode_header(header: m.Header) -> bytes:
    """The opposite of `decode_header`. Raises `ValueError` if the key is there or missing against the session id."""
    if (header.key is None) == (header.session < KEYLESS):
        raise ValueError("a message carries the client key exactly if its session id is below 0x80")
    key = b"" if header.key is None else header.key.to_bytes(4, "big")
    return bytes((header.session, header.stream)) + header.sequence.to_bytes(2, "little") + key


def frames(data: bytes, start: int = 0) -> Iterator[Frame]:
    """Cut the body of a message into submessages, lazily. Raises `Malformed` for a length beyond the end.

    ``data`` may also be the joined fragments of a submessage (``start`` 0).
    """
    position = start
    while len(data) - position >= SUBMESSAGE_HEADER:
        identifier, flags = data[position], data[position + 1]
        length = int.from_bytes(data[position + 2 : position + 4], "little")
        position += SUBMESSAGE_HEADER
        end = position + length
        if (
            identifier == Id.CREATE_CLIENT and length == STATED and data[position + HAS_PROPERTIES : end][:1] == b"\1"
        ) or (length == 0 and identifier in (Id.WRITE_DATA, Id.DATA)):
            end = len(data)
        if end > len(data):
            raise Malformed(position, f"submessage {identifier} states {length} bytes, {len(data) - position} are left")
        yield Frame(identifier, flags, length, position, data[position:end])
        position = end + (-(end - start) % SUBMESSAGE_HEADER)


def decode(datagram: bytes) -> m.Message:
    """The message of a datagram. Raises `Malformed` and nothing else."""
    header, start = decode_header(datagram)
    if datagram[start:] == LIVELINESS_ANSWER:
        return m.Message(header, (m.LivelinessAnswer(),))
    submessages = []
    end = start
    for frame in frames(datagram, start):
        submessages.append(frame.read())
        end = frame.offset + len(frame.payload)
    return m.Message(header, tuple(submessages), datagram[end:])


def decode_body(data: bytes) -> tuple[m.Submessage, ...]:
    """The submessages of a body without message header, as fragments carry it. Raises `Malformed`."""
    return tuple(frame.read() for frame in frames(data))


def encode(message: m.Message) -> bytes:
    """The datagram. Raises `OverflowError` or `ValueError` for values that have no room on the wire."""
    return encode_header(message.header) + encode_body(message.submessages) + message.trailing


def encode_body(submessages: Iterable[m.Submessage]) -> bytes:
    """Submessages in a row, each aligned, the last not padded. Raises as `encode`."""
    body = bytearray()
    for submessage in submessages:
        body += bytes(-len(body) % SUBMESSAGE_HEADER)
        body += _encode_one(submessage)
    return bytes(body)


def _encode_one(submessage: m.Submessage) -> bytes:
    if isinstance(submessage, m.LivelinessAnswer):
        return LIVELINESS_ANSWER
    writer = Writer(submessage.little)
    identifier, flags = payloads.write(submessage, writer)
    length = len(writer.data)
    if isinstance(submessage, m.CreateClient) and submessage.understated:
        length = STATED
    elif length > LONGEST and isinstance(submessage, m.WriteData | m.Data):
        length = 0
    return bytes((identifier, flags | submessage.little)) + length.to_bytes(2, "little") + bytes(writer.data)
