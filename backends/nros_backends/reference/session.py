"""Sessions: their half of the world, a ready queue each, and the faults that hit them."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from nros_backends.reference.connection import ConnectedSession
from nros_backends.reference.entities import ReferencePublisher, ReferenceSubscription
from nros_backends.reference.wire import decode, malformed
from nros_conformance.model.world import Topic
from nros_conformance.rmw.backend import SessionOptions
from nros_conformance.rmw.clock import MS, NEVER
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.dispatch import ReadyQueue
from nros_conformance.rmw.events import Side
from nros_conformance.rmw.qos import QosProfile

if TYPE_CHECKING:
    from nros_backends.reference.backend import ReferenceBackend

_NAME = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*", re.ASCII)


class ReferenceSession(ConnectedSession):
    """A session: its own ready queue over the shared world."""

    queue_type: type[ReadyQueue] = ReadyQueue

    def __init__(self, backend: ReferenceBackend, options: SessionOptions) -> None:
        self.queue = self.queue_type()
        self.held: list[Callable[[], None]] = []
        """What is sent while the link is stalled."""
        self.wall_clock_step_ns = 0
        """By how much the wall clock of its process was stepped; nothing looks at it (RDM-006)."""
        self.destroyed = False
        super().__init__(backend, options)

    @property
    def publisher_type(self) -> type[ReferencePublisher]:
        """What `create_publisher` makes."""
        return ReferencePublisher

    @property
    def subscription_type(self) -> type[ReferenceSubscription]:
        """What `create_subscription` makes."""
        return ReferenceSubscription

    def hit(self, fault: str, arguments: dict[str, Any]) -> int:
        """A fault of its link, or of its process."""
        with self.backend.lock:
            self.backend.advance()
            match fault:
                case "crash" | "freeze" | "thaw":
                    self.link.down = fault != "thaw"
                    self.backend.silence(self)
                case "stall":
                    self.link.stalled = True
                case "clock_step":
                    self.wall_clock_step_ns += arguments["by_ns"]
                case "inject":
                    entities = self.backend.entities.items()
                    publisher = next((id_ for id_, one in entities if one.side is Side.PUBLISHER), 0)
                    for packet in malformed(publisher, arguments["count"], arguments["seed"]):
                        self.receive(packet)
                case _:
                    code = self.suffer(fault, arguments)
                    if fault == "heal":
                        self.link.stalled = False
                        held, self.held = self.held, []
                        for send in held:
                            send()
                    return code
        return ReturnCode.OK

    def receive(self, packet: bytes) -> None:
        """A packet that came from nobody known. What is no frame of ours is dropped (ROB-001)."""
        frame = decode(packet)
        assert frame is None, "nobody but the harness sends here, and it sends nothing valid"

    def create_publisher(self, topic: str, type_name: str, qos: QosProfile) -> ReferencePublisher:
        key, qos = self.admit(topic, type_name, qos)
        return self.publisher_type(self, key, topic, type_name, qos)

    def create_subscription(self, topic: str, type_name: str, qos: QosProfile) -> ReferenceSubscription:
        key, qos = self.admit(topic, type_name, qos)
        return self.subscription_type(self, key, topic, type_name, qos)

    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        if self.destroyed:
            return ReturnCode.INVALID_ARGUMENT
        if self.queue.busy:
            return ReturnCode.WOULD_BLOCK
        until = self.clock.now_ns() + max(timeout_ms, 0) * MS
        while True:
            self.signal.clear()
            if self.poll():
                self.queue.drain(max_callbacks)
                return self.code
            now = self.clock.now_ns()
            if now >= until or self.lost:
                return self.code
            self.clock.wait(self.signal, min(until, self.next_due_ns()))

    def poll(self) -> bool:
        """Let the world catch up with the clock; whether a callback is ready."""
        if self.link.down:
            return False  # a process that does not run
        with self.backend.lock:
            self.backend.advance()
            for entity in self.entities:
                entity.registry.poll()
        return len(self.queue) > 0

    def next_due_ns(self) -> int:
        """When something happens by itself next."""
        if self.link.down:
            return NEVER
        with self.backend.lock:
            return self.backend.next_due_ns

    def destroy(self) -> int:
        for entity in list(self.entities):
            entity.destroy()
        with self.backend.lock:
            code = ReturnCode.OK if self.connected else ReturnCode.TIMEOUT  # all is released nevertheless (C22)
            self.backend.agent.leave(self.id)
            self.backend.sessions.pop(self.id, None)
        self.destroyed = True
        self.signal.set()
        return code

    def admit(self, topic: str, type_name: str, qos: QosProfile) -> tuple[Topic, QosProfile]:
        """What identifies the topic, and the QoS in force. Raises `RmwError`."""
        if self.destroyed:
            raise RmwError(ReturnCode.INVALID_ARGUMENT, "the session is destroyed")
        self.await_peer()
        qos.check()
        if not _NAME.fullmatch(topic) or not type_name:
            raise RmwError(ReturnCode.TOPIC_NAME_INVALID, f"topic {topic!r}, type {type_name!r}")
        for entity in self.backend.entities.values():
            if (entity.key[0], entity.topic) == (self.options.domain_id, topic) and entity.type_name != type_name:
                raise RmwError(ReturnCode.TOPIC_NAME_INVALID, f"{topic} has the type {entity.type_name}")
        return (self.options.domain_id, topic, type_name), qos
