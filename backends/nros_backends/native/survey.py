"""What a library answers, asked in a process of its own: ``python -m nros_backends.native.survey FD``.

Reads `Job` from standard input and writes to the descriptor, one JSON object a line: a `Step` before
each thing that is tried, so that a crash tells where it was, and at last `Answers` or a `Refusal`.
"""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable, Collection
from typing import TypeAlias, TypeVar

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
    """The options of the library, and the steps that crashed it before and are left out."""

    options: dict[str, str]
    without: tuple[str, ...] = ()


class Step(msgspec.Struct, frozen=True, tag="step"):
    """What is tried next. What is not ``needed`` can be left out."""

    doing: str
    needed: bool = True


class Refusal(msgspec.Struct, frozen=True, tag="refusal"):
    """The library cannot be played."""

    text: str
    broken: bool


class Answers(msgspec.Struct, frozen=True, tag="answers"):
    """What it answered. Codes are return codes, `CRASHED` where it did.

    ``discovery_ms``: until the first sample came, None if none did.
    """

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


CRASHED = 1
"""In place of a return code: no backend answers so."""

Line: TypeAlias = Step | Refusal | Answers
_T = TypeVar("_T")


class Survey:
    """Asks, one thing after the other."""

    def __init__(self, options: Options, without: Collection[str], tell: Callable[[Line], None]) -> None:
        self._options = options
        self._without = without
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
        self._tell(Step("create_session"))
        session = self._session(library, "survey")
        registering, creating = {}, {}
        for kind in EventKind:
            ask = functools.partial(self._register, session, kind)
            registering[kind.label] = self._try(f"registering {kind.label}", CRASHED, ask)
        for policy, qos in POLICIES.items():
            ask = functools.partial(self._create, session, qos)
            creating[policy] = self._try(f"creating a publisher with {policy}", CRASHED, ask)
        asserting = self._try("assert_publisher_liveliness", CRASHED, lambda: self._assert(session))
        ping = self._try("ping_session", CRASHED, lambda: int(session.ping(1000)))
        nothing: float | None = None
        same = self._try("passing a sample within a session", nothing, lambda: self._arrival_ms(session, session))
        second, discovery = self._try(
            "a second session, and passing a sample between the two", (CRASHED, nothing), lambda: self._second(session)
        )
        self._try("destroy_session", CRASHED, lambda: int(session.destroy()))
        return Answers(
            name=library.name, registered_by=library.registered_by, vtable=library.vtable,
            null_slots=library.null_slots, registering=registering, creating=creating, second_session=second,
            same_session=same is not None, discovery_ms=discovery, ping=ping, asserting=asserting,
        )  # fmt: skip

    def _try(self, doing: str, otherwise: _T, do: Callable[[], _T]) -> _T:
        if doing in self._without:
            return otherwise
        self._tell(Step(doing, needed=False))
        return do()

    def _session(self, library: Library, node: str) -> NativeSession:
        return NativeSession(library, SessionOptions(node_name=node), self._options.domain)

    def _register(self, session: NativeSession, kind: EventKind) -> int:
        make = session.create_publisher if kind.side is Side.PUBLISHER else session.create_subscription
        entity = make(TOPIC, TYPE, QosProfile())
        code = entity.register_event(int(kind), 1000, lambda *_: None, None)
        entity.destroy()
        return int(code)

    def _create(self, session: NativeSession, qos: QosProfile) -> int:
        try:
            session.create_publisher(TOPIC, TYPE, qos).destroy()
        except RmwError as error:
            return int(error.code)
        return int(ReturnCode.OK)

    def _assert(self, session: NativeSession) -> int:
        publisher = session.create_publisher(TOPIC, TYPE, QosProfile())
        code = publisher.assert_liveliness()
        publisher.destroy()
        return int(code)

    def _second(self, first: NativeSession) -> tuple[int, float | None]:
        """What creating a second session answers, and how long discovery takes."""
        try:
            other = self._session(first.library, "survey_too")
        except RmwError as error:
            return int(error.code), self._arrival_ms(first, first)
        found = self._arrival_ms(other, first)
        other.destroy()
        return int(ReturnCode.OK), found

    def _arrival_ms(self, sender: NativeSession, receiver: NativeSession) -> float | None:
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
    Survey(Options.read(job.options), job.without, lambda line: _write(pipe, encoder.encode(line) + b"\n")).run()


def _write(pipe: int, data: bytes) -> None:
    os.write(pipe, data)


if __name__ == "__main__":
    main()
