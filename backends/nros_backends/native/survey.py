"""What a library answers, asked in a process of its own: ``python -m nros_backends.native.survey FD``.

Reads `Job` from standard input and writes to the descriptor, one JSON object a line: a `Step` before
each thing that is tried, so that a crash tells where it was, and at last `Answers` or a `Refusal`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import TypeAlias

import msgspec

from nros_backends.native.library import Library, load
from nros_backends.native.options import Options
from nros_backends.native.session import NativeSession
from nros_conformance.rmw.backend import SessionOptions
from nros_conformance.rmw.clock import MS, MonotonicClock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import EventKind, Side
from nros_conformance.rmw.loading import LibraryError
from nros_conformance.rmw.qos import Durability, History, Liveliness, QosProfile

TOPIC = "/nros_conformance_survey"
TYPE = "nros_conformance_msgs/msg/Sample"
DISCOVERY_NS = 2_000 * MS
"""How long the first sample may take to arrive."""

POLICIES = {
    "transient_local": QosProfile(durability=Durability.TRANSIENT_LOCAL),
    "keep_all": QosProfile(history=History.KEEP_ALL),
    "deadline": QosProfile(deadline_ms=1000),
    "lifespan": QosProfile(lifespan_ms=1000),
    "liveliness.manual_by_topic": QosProfile(liveliness=Liveliness.MANUAL_BY_TOPIC, lease_ms=1000),
    "liveliness.manual_by_node": QosProfile(liveliness=Liveliness.MANUAL_BY_NODE, lease_ms=1000),
}
"""What a publisher is created with once each, by its name in ``[qos] unsupported``."""


class Job(msgspec.Struct, frozen=True):
    """The options of the library."""

    options: dict[str, str]


class Step(msgspec.Struct, frozen=True, tag="step"):
    """What is tried next."""

    doing: str


class Refusal(msgspec.Struct, frozen=True, tag="refusal"):
    """The library cannot be played."""

    text: str
    broken: bool


class Answers(msgspec.Struct, frozen=True, tag="answers"):
    """What it answered. Codes are return codes; ``discovery_ms``: until the first sample came, None if none did."""

    name: str
    registered_by: str
    vtable: str
    null_slots: tuple[str, ...]
    registering: dict[str, int]
    creating: dict[str, int]
    second_session: int
    same_session: bool
    discovery_ms: float | None
    ping: int
    asserting: int


Line: TypeAlias = Step | Refusal | Answers


class Survey:
    """Asks, one thing after the other."""

    def __init__(self, options: Options, tell: Callable[[Line], None]) -> None:
        self._options = options
        self._tell = tell
        self._clock = MonotonicClock()

    def run(self) -> None:
        """Tell everything, the answers at last."""
        try:
            self._tell(Step("loading it"))
            library = load(self._options)
            self._tell(self._ask(library))
        except LibraryError as error:
            self._tell(Refusal(str(error), error.broken))
        except RmwError as error:
            self._tell(Refusal(f"{library.file.name}: {error.detail}", broken=True))
        except Exception as error:
            self._tell(Refusal(f"{library.file.name}: {error}", broken=True))

    def _ask(self, library: Library) -> Answers:
        session = self._session(library, "create_session", "survey")
        registering, creating = {}, {}
        for kind in EventKind:
            registering[kind.label] = self._register(session, kind)
        for policy, qos in POLICIES.items():
            creating[policy] = self._create(session, qos)
        self._tell(Step("assert_publisher_liveliness"))
        publisher = session.create_publisher(TOPIC, TYPE, QosProfile())
        asserting = publisher.assert_liveliness()
        publisher.destroy()
        self._tell(Step("ping_session"))
        ping = session.ping(1000)
        same = self._arrival_ms(session, session) is not None
        second, discovery = int(ReturnCode.OK), None
        try:
            other = self._session(library, "create_session for a second session", "survey_too")
        except RmwError as error:
            second, discovery = int(error.code), self._arrival_ms(session, session)
        else:
            discovery = self._arrival_ms(other, session)
            self._tell(Step("destroy_session of a second session"))
            other.destroy()
        self._tell(Step("destroy_session"))
        session.destroy()
        return Answers(
            name=library.name, registered_by=library.registered_by, vtable=library.vtable,
            null_slots=library.null_slots, registering=registering, creating=creating, second_session=second,
            same_session=same, discovery_ms=discovery, ping=int(ping), asserting=int(asserting),
        )  # fmt: skip

    def _session(self, library: Library, doing: str, node: str) -> NativeSession:
        self._tell(Step(doing))
        return NativeSession(library, SessionOptions(node_name=node), self._options.domain)

    def _register(self, session: NativeSession, kind: EventKind) -> int:
        make = session.create_publisher if kind.side is Side.PUBLISHER else session.create_subscription
        self._tell(Step(f"create_{kind.side.value}"))
        entity = make(TOPIC, TYPE, QosProfile())
        self._tell(Step(f"register_{kind.side.value}_event for {kind.label}"))
        code = entity.register_event(int(kind), 1000, lambda *_: None, None)
        self._tell(Step(f"destroy_{kind.side.value}"))
        entity.destroy()
        return int(code)

    def _create(self, session: NativeSession, qos: QosProfile) -> int:
        self._tell(Step(f"create_publisher with {qos}"))
        try:
            session.create_publisher(TOPIC, TYPE, qos).destroy()
        except RmwError as error:
            return int(error.code)
        return int(ReturnCode.OK)

    def _arrival_ms(self, sender: NativeSession, receiver: NativeSession) -> float | None:
        self._tell(Step("drive_io, publish_raw, has_data and try_recv_raw"))
        publisher = sender.create_publisher(TOPIC, TYPE, QosProfile())
        subscription = receiver.create_subscription(TOPIC, TYPE, QosProfile())
        begin, found = self._clock.now_ns(), None
        while found is None and self._clock.now_ns() - begin < DISCOVERY_NS:
            publisher.publish_raw(b"survey")
            for session in (sender, receiver):
                session.drive_io(5)
            subscription.has_data()
            if isinstance(subscription.try_recv_raw(65536), bytes):
                found = (self._clock.now_ns() - begin) / MS
        publisher.destroy()
        subscription.destroy()
        return found


def main() -> None:
    """Ask what standard input names, tell the descriptor."""
    job = msgspec.json.decode(sys.stdin.buffer.read(), type=Job)
    encoder = msgspec.json.Encoder()
    pipe = int(sys.argv[1])
    Survey(Options.read(job.options), lambda line: _write(pipe, encoder.encode(line) + b"\n")).run()


def _write(pipe: int, data: bytes) -> None:
    os.write(pipe, data)


if __name__ == "__main__":
    main()
