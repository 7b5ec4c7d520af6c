"""A backend over UDP on loopback, whose sessions meet in a folder: enough to play across processes."""

from __future__ import annotations

import os
import signal
import socket
import time
from pathlib import Path
from typing import Any

from nros_conformance.rmw.backend import Backend, Entity, Host, Publisher, Session, SessionOptions, Subscription
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import EventCallback
from nros_conformance.rmw.qos import QosProfile

FAR_FUTURE_S = 4_000_000_000
"""A wall clock beyond this was set forward (the year 2096)."""


class DatagramBackend(Backend):
    """What a play says in ``options``: ``publish`` may be segfault, exit, raise or hang."""

    def __init__(self, host: Host) -> None:
        super().__init__(host)
        host.scratch.mkdir(parents=True, exist_ok=True)

    def create_session(self, options: SessionOptions) -> Session:
        return _Session(self.host)

    def matched(self, entity: Entity) -> int | None:
        return len(_readers(self.host.scratch)) if isinstance(entity, Publisher) else None

    def inject(self, fault: str, **arguments: Any) -> int:
        entity, count, publish = arguments["entity"], arguments["count"], arguments["publish"]
        assert (fault, type(entity)) == ("lose", _Publisher)
        entity.mute = True
        try:
            return min(int(publish()) for _ in range(count))
        finally:
            entity.mute = False


def _readers(folder: Path) -> list[int]:
    return [int(file.suffix[1:]) for file in folder.glob("reader.*")]


class _Session(Session):
    def __init__(self, host: Host) -> None:
        self.host = host
        self.entities: list[Entity] = []

    def create_publisher(self, topic: str, type_name: str, qos: QosProfile) -> Publisher:
        publisher = _Publisher(self.host)
        self.entities.append(publisher)
        return publisher

    def create_subscription(self, topic: str, type_name: str, qos: QosProfile) -> Subscription:
        subscription = _Subscription(self.host)
        self.entities.append(subscription)
        return subscription

    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        time.sleep(timeout_ms / 1000)
        return ReturnCode.OK

    def destroy(self) -> int:
        for entity in self.entities:
            entity.destroy()
        return ReturnCode.OK


class _Entity(Entity):
    def supports_event(self, kind: int) -> bool:
        return time.time() > FAR_FUTURE_S

    def register_event(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        return ReturnCode.UNSUPPORTED


class _Publisher(_Entity, Publisher):
    def __init__(self, host: Host) -> None:
        self._host = host
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.mute = False

    def publish_raw(self, data: bytes) -> int:
        match self._host.options.get("publish"):
            case "segfault":
                os.kill(os.getpid(), signal.SIGSEGV)
            case "exit":
                os._exit(3)
            case "raise":
                raise ValueError("no such thing")
            case "hang":
                time.sleep(3600)
        for port in [] if self.mute else _readers(self._host.scratch):
            self._socket.sendto(data, ("127.0.0.1", port))
        return ReturnCode.OK

    def destroy(self) -> int:
        self._socket.close()
        return ReturnCode.OK


class _Subscription(_Entity, Subscription):
    def __init__(self, host: Host) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self._file = host.scratch / f"reader.{self._socket.getsockname()[1]}"
        self._file.touch()

    def has_data(self) -> bool | int:
        return True

    def try_recv_raw(self, max_size: int) -> bytes | int:
        try:
            return self._socket.recv(max_size)
        except BlockingIOError:
            return ReturnCode.NO_DATA

    def destroy(self) -> int:
        self._file.unlink(missing_ok=True)
        self._socket.close()
        return ReturnCode.OK
