"""Defects of creation, of lifetime, and of what is malformed or misused (QOS, LIF, ROB)."""

from __future__ import annotations

import dataclasses
import os
import threading
from collections.abc import Iterator
from typing import Any

from nros_backends.reference.backend import (
    ReferenceBackend,
    ReferencePublisher,
    ReferenceSession,
    ReferenceSubscription,
)
from nros_backends.reference.mutants.build import mutant
from nros_backends.reference.mutants.dispatch import hang
from nros_backends.reference.wire import MAGIC
from nros_conformance.model.world import Id, Occurrence, Topic, World
from nros_conformance.rmw.backend import Host, SessionOptions
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.dispatch import EventRegistry
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.mutants import Mutant
from nros_conformance.rmw.qos import DEPTH_MAX, INFINITE_MS, Liveliness, QosProfile, Reliability


class _Clamps(ReferenceSession):
    def admit(self, topic: str, type_name: str, qos: QosProfile) -> tuple[Topic, QosProfile]:
        limits = {"depth": DEPTH_MAX, "deadline_ms": INFINITE_MS, "lifespan_ms": INFINITE_MS, "lease_ms": INFINITE_MS}
        cut: Any = {name: max(0, min(getattr(qos, name), limit)) for name, limit in limits.items()}
        return super().admit(topic, type_name, dataclasses.replace(qos, **cut))


class _Drops(ReferenceSession):
    """Drops a policy without a word."""

    policies: tuple[str, ...] = ()

    def admit(self, topic: str, type_name: str, qos: QosProfile) -> tuple[Topic, QosProfile]:
        key, admitted = super().admit(topic, type_name, qos)
        dropped: Any = dict.fromkeys(self.policies, 0)
        return key, dataclasses.replace(admitted, **dropped)


class _DropsLease(_Drops):
    policies = ("lease_ms",)


class _DropsDeadline(_Drops):
    policies = ("deadline_ms",)


class _DropsLifespan(_Drops):
    policies = ("lifespan_ms",)


class _Refuses(ReferenceSession):
    def admit(self, topic: str, type_name: str, qos: QosProfile) -> tuple[Topic, QosProfile]:
        key, admitted = super().admit(topic, type_name, qos)
        if qos.depth > 128:
            raise RmwError(ReturnCode.INCOMPATIBLE_QOS, "depth above 128")
        return key, admitted


class _LeaksPlaces(ReferenceSession):
    left = 100

    def admit(self, topic: str, type_name: str, qos: QosProfile) -> tuple[Topic, QosProfile]:
        if not self.left:
            raise RmwError(ReturnCode.BAD_ALLOC, "no place is left")
        try:
            return super().admit(topic, type_name, qos)
        except RmwError:
            self.left -= 1
            raise


class _AnyName(ReferenceSession):
    def admit(self, topic: str, type_name: str, qos: QosProfile) -> tuple[Topic, QosProfile]:
        if self.destroyed:
            raise RmwError(ReturnCode.INVALID_ARGUMENT)
        qos.check()
        return (self.options.domain_id, topic, type_name), qos


class _MatchesAll(World):
    def create_subscription(self, id_: Id, topic: Topic, qos: QosProfile, at_ns: int) -> list[Occurrence]:
        weakest = QosProfile(
            reliability=Reliability.BEST_EFFORT, liveliness=Liveliness.NONE, depth=qos.depth, history=qos.history
        )
        return super().create_subscription(id_, topic, weakest, at_ns)


class _LeakThread(ReferenceBackend):
    def __init__(self, host: Host) -> None:
        super().__init__(host)
        self.ended = threading.Event()

    def create_session(self, options: SessionOptions) -> ReferenceSession:
        threading.Thread(target=self.ended.wait, daemon=True).start()
        return super().create_session(options)

    def close(self) -> None:
        self.ended.set()


class _LeakDescriptor(ReferenceBackend):
    def __init__(self, host: Host) -> None:
        super().__init__(host)
        self.open: list[int] = []

    def create_session(self, options: SessionOptions) -> ReferenceSession:
        self.open.append(os.open(os.devnull, os.O_RDONLY))
        return super().create_session(options)

    def close(self) -> None:
        for descriptor in self.open:
            os.close(descriptor)


class _LeakMemory(ReferenceBackend):
    def __init__(self, host: Host) -> None:
        super().__init__(host)
        self.kept: list[bytes] = []

    def create_session(self, options: SessionOptions) -> ReferenceSession:
        self.kept.append(os.urandom(4096))
        return super().create_session(options)


class _GoesDeaf(ReferenceSession):
    created = 0

    def create_subscription(self, topic: str, type_name: str, qos: QosProfile) -> ReferenceSubscription:
        self.created += 1
        return super().create_subscription(topic + "x" * (self.created > 30), type_name, qos)


class _KeepsCallbacks(EventRegistry):
    def close(self) -> None:
        self.__dict__["kept"] = [*self._registered.values()]
        super().close()


class _KeepsForever(ReferenceSubscription):
    def destroy(self) -> int:
        self.backend.__dict__.setdefault("kept", []).append(self.registry)
        return super().destroy()


class _CloseHangs(ReferenceSession):
    def destroy(self) -> int:
        if any(entity.registry._registered for entity in self.entities):
            hang(self.clock)
        return super().destroy()


class _DoubleFree(ReferenceSession):
    def destroy(self) -> int:
        if self.destroyed:
            raise MemoryError("double free")
        return super().destroy()


class _Dangling(ReferencePublisher):
    def publish_raw(self, data: bytes) -> int:
        if self.destroyed:
            raise AttributeError("the session is gone")
        return super().publish_raw(data)


class _StaleIsFine(ReferencePublisher):
    def publish_raw(self, data: bytes) -> int:
        return ReturnCode.OK if self.destroyed else super().publish_raw(data)


class _Allocates(ReferenceSession):
    def receive(self, packet: bytes) -> None:
        super().receive(packet)
        if len(packet) >= 19 and packet.startswith(MAGIC):
            declared = int.from_bytes(packet[15:19], "little")
            self.__dict__.setdefault("kept", []).append(bytearray(b"\1") * min(declared, 2**20))


class _CountsForeign(ReferenceSession):
    def receive(self, packet: bytes) -> None:
        super().receive(packet)
        for entity in self.entities:
            if isinstance(entity, ReferenceSubscription):
                self.backend.tell([Occurrence(self.clock.now_ns(), entity.id, EventKind.MESSAGE_LOST, (1,))])


class _AnyPacketIsLife(ReferenceSession):
    def receive(self, packet: bytes) -> None:
        super().receive(packet)
        for entity in self.entities:
            if isinstance(entity, ReferenceSubscription):
                self.backend.world._subscriptions[entity.id].requested.restart(self.clock.now_ns())


class _Blocks(ReferenceSubscription):
    def try_recv_raw(self, max_size: int) -> bytes | int:
        if not self.destroyed:
            sample = self.backend.world.peek(self.id, self.backend.clock.now_ns())
            if sample is not None and len(sample.data) > max_size >= 0:
                return ReturnCode.BUFFER_TOO_SMALL
        return super().try_recv_raw(max_size)


class _Crashes(ReferenceSubscription):
    def try_recv_raw(self, max_size: int) -> bytes | int:
        bytearray(max_size)
        return super().try_recv_raw(max_size)


class _EmptyIsNothing(ReferenceSubscription):
    def try_recv_raw(self, max_size: int) -> bytes | int:
        data = super().try_recv_raw(max_size)
        return ReturnCode.NO_DATA if data == b"" else data


def mutants() -> Iterator[Mutant]:
    """All of this subject."""
    yield mutant(
        "deadline-not-enforced",
        "D-QOS-02",
        "QOS-002",
        "a deadline is accepted and not enforced",
        session=_DropsDeadline,
    )
    yield mutant("clamps", "D-QOS-03", "QOS-003", "values that do not fit are cut down", session=_Clamps)
    yield mutant("lease-dropped", "D-QOS-05", "QOS-002", "a lease is accepted and dropped", session=_DropsLease)
    yield mutant("leaks-places", "D-QOS-07", "QOS-005", "a failed creation takes a place", session=_LeaksPlaces)
    yield mutant(
        "lifespan-not-enforced",
        "D-QOS-08",
        "QOS-002",
        "a lifespan is accepted and not enforced",
        session=_DropsLifespan,
    )
    yield mutant("refuses-depth", "", "QOS-001", "a depth above 128 is refused and not declared so", session=_Refuses)
    yield mutant("any-name", "", "QOS-004", "any name is accepted", session=_AnyName)
    yield mutant("matches-all", "", "QOS-006", "pairs that do not fit are matched", world=_MatchesAll)
    yield mutant("leaks-threads", "D-LIF-02", "LIF-001", "each session leaves a thread", backend=_LeakThread)
    yield mutant(
        "leaks-descriptors", "D-LIF-03", "LIF-001", "each session leaves a descriptor", backend=_LeakDescriptor
    )
    yield mutant("leaks-memory", "D-LIF-04", "LIF-001", "each session leaves 4 kB", backend=_LeakMemory)
    yield mutant(
        "goes-deaf", "D-LIF-05", "LIF-002", "the 31st subscription of a session hears nothing", session=_GoesDeaf
    )
    yield mutant(
        "keeps-callbacks",
        "D-LIF-06",
        "LIF-003",
        "callback and context are kept after destroy",
        subscription=_KeepsForever,
        registry=_KeepsCallbacks,
    )
    yield mutant(
        "close-hangs", "D-LIF-12", "LIF-004", "closing hangs as long as something is registered", session=_CloseHangs
    )
    yield mutant("double-free", "D-LIF-14", "LIF-004", "a second close crashes", session=_DoubleFree)
    yield mutant("dangling", "D-LIF-18", "ROB-003", "publishing after the session is gone crashes", publisher=_Dangling)
    yield mutant(
        "stale-is-fine", "", "ROB-003", "publishing on a destroyed publisher answers OK", publisher=_StaleIsFine
    )
    yield mutant(
        "allocates-declared-length",
        "D-ROB-02",
        "ROB-001",
        "memory is taken for the length that a packet declares",
        session=_Allocates,
    )
    yield mutant(
        "foreign-is-loss", "D-ROB-04", "ROB-001", "foreign packets count as lost samples", session=_CountsForeign
    )
    yield mutant("any-packet-is-life", "", "ROB-001", "any packet restarts the deadline", session=_AnyPacketIsLife)
    yield mutant(
        "oversized-blocks", "D-ROB-06", "ROB-002", "a sample that does not fit blocks the queue", subscription=_Blocks
    )
    yield mutant("misuse-crashes", "D-ROB-10", "ROB-003", "a negative size crashes", subscription=_Crashes)
    yield mutant(
        "empty-is-nothing", "", "ROB-004", "a sample without a payload is no data", subscription=_EmptyIsNothing
    )
