"""Topics of all domains: carries samples from data writers to the data readers that match. No time of its own."""

from __future__ import annotations

import os
import struct
from collections import deque
from typing import NamedTuple

from nros_backends.xrce.agent.qos import Durability, EntityQos, mismatch, share_partition

KEEP_ALL = 5000
"""Samples that KEEP_ALL keeps at most, Fast DDS' default for ``max_samples``; then the oldest goes."""

GUID = 16
"""Octets of a writer's GUID."""

IDENTITY = 24
"""Octets of an `Identity`."""

_NUMBER = struct.Struct("<iI")


class TopicKey(NamedTuple):
    """What a topic is known by across clients."""

    domain: int
    name: str
    type: str


class Identity(NamedTuple):
    """A sample of all: the GUID of its writer, 16 octets, and its number there, from 1 on. DDS' ``SampleIdentity``."""

    writer: bytes
    number: int

    @classmethod
    def of(cls, data: bytes) -> Identity | None:
        """What data begins with; None: it is too short."""
        if len(data) < IDENTITY:
            return None
        high, low = _NUMBER.unpack_from(data, GUID)
        return cls(data[:GUID], (high << 32) + low)

    def octets(self) -> bytes:
        """As it stands in front of requests and replies."""
        return self.writer + _NUMBER.pack(self.number >> 32, self.number & 0xFFFFFFFF)


class Sample(NamedTuple):
    """``data``: CDR as the client sent it. ``expires_ns``: None without a lifespan. ``related``: what it answers."""

    data: bytes
    expires_ns: int | None
    identity: Identity
    related: Identity | None = None


class DataWriter:
    """A writer with the history that late readers get. ``number``: of its last sample."""

    def __init__(self, topic: TopicKey, qos: EntityQos, partitions: tuple[str, ...]) -> None:
        self.topic = topic
        self.qos = qos
        self.partitions = partitions
        self.history: deque[Sample] = deque(maxlen=qos.depth or KEEP_ALL)
        self.guid = bytes(GUID)
        self.number = 0


class DataReader:
    """A reader with what nobody has asked for yet. ``dropped``: samples that the depth pushed out."""

    def __init__(self, topic: TopicKey, qos: EntityQos, partitions: tuple[str, ...]) -> None:
        self.topic = topic
        self.qos = qos
        self.partitions = partitions
        self.waiting: deque[Sample] = deque(maxlen=qos.depth or KEEP_ALL)
        self.dropped = 0

    def put(self, sample: Sample) -> None:
        """Keep a sample until it is read."""
        self.dropped += len(self.waiting) == self.waiting.maxlen
        self.waiting.append(sample)

    def peek(self, now_ns: int) -> bytes | None:
        """The oldest sample that has not expired; it stays."""
        while self.waiting:
            sample = self.waiting[0]
            if sample.expires_ns is None or now_ns < sample.expires_ns:
                return sample.data
            self.waiting.popleft()
        return None

    def pop(self) -> None:
        """Remove what `peek` gave."""
        self.waiting.popleft()


class Exchange:
    """All writers and readers of an agent."""

    def __init__(self) -> None:
        self._writers: dict[TopicKey, list[DataWriter]] = {}
        self._readers: dict[TopicKey, list[DataReader]] = {}
        # Other than those of the agent's former life, of which clients may still hold some.
        self._prefix = b"\x01\x0f\0\0" + os.urandom(4)
        self._made = 0

    def add_writer(self, writer: DataWriter) -> None:
        """A writer that from now on can write."""
        self._made += 1
        writer.guid = self._prefix + self._made.to_bytes(4, "big") + b"\0\0\x01\x03"
        self._writers.setdefault(writer.topic, []).append(writer)

    def add_reader(self, reader: DataReader) -> None:
        """A reader that from now on gets samples, and at once what transient-local writers kept for it."""
        self._readers.setdefault(reader.topic, []).append(reader)
        if reader.qos.durability is Durability.VOLATILE:
            return
        for writer in self.writers(reader):
            for sample in writer.history:
                reader.put(sample)

    def remove(self, endpoint: DataWriter | DataReader) -> None:
        """Take a writer (with its history) or a reader out."""
        table: dict[TopicKey, list[DataWriter]] | dict[TopicKey, list[DataReader]]
        table = self._writers if isinstance(endpoint, DataWriter) else self._readers
        members = table[endpoint.topic]
        members.remove(endpoint)  # type: ignore[arg-type]  # the table of its own kind
        if not members:
            del table[endpoint.topic]

    def write(self, writer: DataWriter, data: bytes, now_ns: int, related: Identity | None = None) -> list[DataReader]:
        """Carry a sample to every matching reader; these readers."""
        lifespan = writer.qos.lifespan_ns
        writer.number += 1
        expires_ns = None if lifespan is None else now_ns + lifespan
        sample = Sample(data, expires_ns, Identity(writer.guid, writer.number), related)
        if writer.qos.durability is not Durability.VOLATILE:
            writer.history.append(sample)
        reached = self.readers(writer)
        for reader in reached:
            reader.put(sample)
        return reached

    def readers(self, writer: DataWriter) -> list[DataReader]:
        """The readers that match a writer."""
        return [reader for reader in self._readers.get(writer.topic, ()) if _match(writer, reader)]

    def writers(self, reader: DataReader) -> list[DataWriter]:
        """The writers that match a reader."""
        return [writer for writer in self._writers.get(reader.topic, ()) if _match(writer, reader)]


def _match(writer: DataWriter, reader: DataReader) -> bool:
    return mismatch(writer.qos, reader.qos) is None and share_partition(writer.partitions, reader.partitions)
