"""Defects of pings and of coming back (CON)."""

from __future__ import annotations

from collections.abc import Iterator

from nros_backends.reference.backend import (
    ReferenceBackend,
    ReferencePublisher,
    ReferenceSession,
    ReferenceSubscription,
)
from nros_backends.reference.mutants.build import mutant
from nros_conformance.model.agent import Agent
from nros_conformance.model.world import Topic
from nros_conformance.rmw.backend import SessionOptions
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.mutants import Mutant
from nros_conformance.rmw.qos import QosProfile

LONG_NS = 3_000 * MS
"""More than twice the connection lease."""


# --- what a ping answers, and how long it takes -----------------------------------------------------


class _StalePong(ReferenceSession):
    answered = False

    def probe(self, timeout_ns: int) -> bool:
        self.answered = super().probe(timeout_ns) or self.answered
        return self.answered


class _LoopbackPong(ReferenceSession):
    def probe(self, timeout_ns: int) -> bool:
        return super().probe(timeout_ns) or len(self.entities) > 1


class _LatePong(ReferenceSession):
    sent = False

    def probe(self, timeout_ns: int) -> bool:
        late, self.sent = self.sent, True
        return super().probe(timeout_ns) or (late and self.connected)


class _NotesTraffic(ReferenceSubscription):
    def arrived(self, publisher: int, now_ns: int) -> None:
        if isinstance(self.session, _TrafficProlongs) and self.session.link.in_:
            self.session.traffic_ns = now_ns
        super().arrived(publisher, now_ns)


class _TrafficProlongs(ReferenceSession):
    """Each packet that is no answer has the timeout begin again."""

    traffic_ns = 0

    def probe(self, timeout_ns: int) -> bool:
        begin = self.clock.now_ns()
        answered = super().probe(timeout_ns)
        while not answered and self.traffic_ns > begin:
            begin = self.clock.now_ns()
            self.clock.wait(None, self.traffic_ns + timeout_ns)
        return answered


class _PingAsDelay(ReferenceSession):
    def probe(self, timeout_ns: int) -> bool:
        begin = self.clock.now_ns()
        answered = super().probe(timeout_ns)
        self.clock.wait(None, begin + timeout_ns)
        return answered


class _IgnoresAttempts(ReferenceSession):
    def ping(self, timeout_ms: int, attempts: int = 1) -> int:
        return super().ping(timeout_ms, 10)


class _StalePongBefore(ReferenceBackend):
    answered = False

    def ping(self, options: SessionOptions, timeout_ms: int, attempts: int = 1) -> int:
        self.answered |= super().ping(options, timeout_ms, attempts) == ReturnCode.OK
        return ReturnCode.OK if self.answered else ReturnCode.TIMEOUT


class _FailedOnce(ReferenceBackend):
    failed = False

    def ping(self, options: SessionOptions, timeout_ms: int, attempts: int = 1) -> int:
        code = super().ping(options, timeout_ms, attempts)
        self.failed |= code != ReturnCode.OK
        return ReturnCode.TIMEOUT if self.failed else code


class _DeadOnceASessionExists(ReferenceBackend):
    def ping(self, options: SessionOptions, timeout_ms: int, attempts: int = 1) -> int:
        code = super().ping(options, timeout_ms, attempts)
        return ReturnCode.TIMEOUT if self.sessions else code


class _DeadOnceEntitiesExist(ReferenceSession):
    def probe(self, timeout_ns: int) -> bool:
        return super().probe(timeout_ns) and not self.entities


class _PingLosesData(ReferenceSession):
    def ping(self, timeout_ms: int, attempts: int = 1) -> int:
        for entity in self.entities:
            if isinstance(entity, ReferenceSubscription):
                entity.try_recv_raw(65536)
        return super().ping(timeout_ms, attempts)


class _PingRunsCallbacks(ReferenceSession):
    def ping(self, timeout_ms: int, attempts: int = 1) -> int:
        self.drive_io(0)
        return super().ping(timeout_ms, attempts)


# --- a peer that is gone, or has forgotten ----------------------------------------------------------


class _AnyPeerWillDo(ReferenceSession):
    """Whoever answers is the peer: a plain ping in place of the one within the session."""

    def probe(self, timeout_ns: int) -> bool:
        return self.backend.agent.up and self.link.open

    def link_changed(self) -> None:
        if self.link.open and self.backend.agent.up and not self.backend.agent.knows(self.id):
            self.link.silent_since = None
        else:
            super().link_changed()

    def lose(self) -> None:
        pass


class _IntoTheVoid(ReferenceSession):
    def lose(self) -> None:
        pass


class _ReceiverNoticesNothing(ReferenceSession):
    def lose(self) -> None:
        if any(isinstance(entity, ReferencePublisher) for entity in self.entities):
            super().lose()


class _QuietIsDead(ReferenceSession):
    quiet = 0

    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        self.quiet += 1
        return super().drive_io(timeout_ms, max_callbacks) or (ReturnCode.TIMEOUT if self.quiet > 20 else 0)


class _WaitsForThePeer(ReferenceSession):
    def await_peer(self) -> None:
        try:
            super().await_peer()
        except RmwError:
            self.clock.wait(None, self.clock.now_ns() + LONG_NS)
            raise


class _CreatesWithoutPeer(ReferenceSession):
    def await_peer(self) -> None:
        pass


class _DestroyBlocks(ReferenceSession):
    def destroy(self) -> int:
        if not self.connected:
            self.clock.wait(None, self.clock.now_ns() + LONG_NS)
        return super().destroy()


class _SlotTaken(ReferenceBackend):
    taken = False

    def create_session(self, options: SessionOptions) -> ReferenceSession:
        if self.taken:
            raise RmwError(ReturnCode.BAD_ALLOC, "the slot is taken")
        return super().create_session(options)


class _KeepsItsSlot(ReferenceSession):
    def destroy(self) -> int:
        assert isinstance(self.backend, _SlotTaken)
        self.backend.taken |= not self.connected
        return super().destroy()


# --- coming back ------------------------------------------------------------------------------------


class _Counting(Agent):
    """How often it was started; more than once means that it was restarted."""

    starts = 0

    def start(self) -> None:
        super().start()
        self.starts += 1


def _restarted(backend: ReferenceBackend) -> bool:
    assert isinstance(backend.agent, _Counting)
    return backend.agent.starts > 1


class _DeafAtFirst(ReferenceSession):
    """Hears nothing for a while when it is connected to a peer that was restarted."""

    def __init__(self, backend: ReferenceBackend, options: SessionOptions) -> None:
        super().__init__(backend, options)
        if _restarted(backend):
            self.link.in_ = False
            backend.later(self.clock.now_ns() + LONG_NS, self._hear)

    def _hear(self) -> None:
        self.link.in_ = True

    @property
    def connected(self) -> bool:
        return self.link.out and self.backend.agent.knows(self.id)

    def await_peer(self) -> None:
        if not self.backend.agent.up:
            super().await_peer()


class _EightSessions(ReferenceBackend):
    made = 0

    def create_session(self, options: SessionOptions) -> ReferenceSession:
        self.made += 1
        if self.made > 8:
            raise RmwError(ReturnCode.CONNECTION_FAILED, "no more sessions")
        return super().create_session(options)


class _GivesUp(ReferenceBackend):
    """A peer that did not answer for ten seconds is looked for no more."""

    patience_ns = 10_000 * MS
    since: int | None = None

    def ping(self, options: SessionOptions, timeout_ms: int, attempts: int = 1) -> int:
        if self.since is not None and self.clock.now_ns() - self.since > self.patience_ns:
            return ReturnCode.TIMEOUT
        code = super().ping(options, timeout_ms, attempts)
        if code == ReturnCode.OK:
            self.since = None
        elif self.since is None:
            self.since = self.clock.now_ns()
        return code


class _GivesUpLater(_GivesUp):
    """The same after three quarters of a minute: longer than any outage that is played on real time."""

    patience_ns = 45_000 * MS


class _Halfway(ReferenceSession):
    """A set-up that fails halfway; the next one leaves out what had been asked for already."""

    def admit(self, topic: str, type_name: str, qos: QosProfile) -> tuple[Topic, QosProfile]:
        try:
            return super().admit(topic, type_name, qos)
        except RmwError:
            self.backend.__dict__.setdefault("requested", set()).add(topic)
            raise


class _Hollow(ReferencePublisher):
    def send(self, data: bytes) -> None:
        if self.topic not in self.backend.__dict__.get("requested", ()):
            super().send(data)


class _LaterUnserved(ReferencePublisher):
    """After a restart it serves only those that were there when it was created."""

    def __init__(self, session: ReferenceSession, key: Topic, topic: str, type_name: str, qos: QosProfile) -> None:
        super().__init__(session, key, topic, type_name, qos)
        self.known = set(self.backend.entities)

    def send(self, data: bytes) -> None:
        late = [one for one in self.backend.entities.values() if one.id not in self.known]
        late = late if _restarted(self.backend) else []
        for one in late:
            one.session.link.in_ = False
        super().send(data)
        for one in late:
            one.session.link.in_ = True


def mutants() -> Iterator[Mutant]:
    """All of this subject."""
    yield from _pings()
    yield from _peers()
    yield from _returns()


def _pings() -> Iterator[Mutant]:
    yield mutant(
        "stale-pong", "D-CON-01", "CON-001", "a ping is answered for ever by the first pong", session=_StalePong
    )
    yield mutant(
        "loopback-pong", "D-CON-03", "CON-001", "a ping is answered in the process itself", session=_LoopbackPong
    )
    yield mutant("late-pong", "", "CON-001", "a pong for an earlier ping counts", session=_LatePong)
    yield mutant(
        "stale-pong-before",
        "",
        "CON-001",
        "a ping before a session is answered by the first pong",
        backend=_StalePongBefore,
    )
    yield mutant(
        "traffic-prolongs", "D-CON-04", "CON-002", "other traffic has the timeout of a ping begin again",
        session=_TrafficProlongs, subscription=_NotesTraffic,
    )  # fmt: skip
    yield mutant("ping-as-delay", "D-CON-06", "CON-002", "a ping lasts as long as its timeout", session=_PingAsDelay)
    yield mutant("ignores-attempts", "", "CON-002", "the number of attempts is ignored", session=_IgnoresAttempts)
    yield mutant(
        "failed-once", "D-CON-07", "CON-005", "no ping is answered after one that was not", backend=_FailedOnce
    )
    yield mutant(
        "dead-beside-session", "D-CON-08", "CON-003", "no ping is answered once there is a session",
        backend=_DeadOnceASessionExists,
    )  # fmt: skip
    yield mutant(
        "dead-beside-entities",
        "",
        "CON-003",
        "no ping is answered once there are entities",
        session=_DeadOnceEntitiesExist,
    )
    yield mutant("ping-loses-data", "", "CON-003", "a ping drops a sample that waits", session=_PingLosesData)
    yield mutant(
        "ping-runs-callbacks", "D-CON-10", "CON-003", "a ping runs event callbacks", session=_PingRunsCallbacks
    )


def _peers() -> Iterator[Mutant]:
    yield mutant(
        "restart-unnoticed",
        "D-CON-12",
        "CON-004",
        "a restart faster than the lease goes unnoticed",
        session=_AnyPeerWillDo,
    )
    yield mutant(
        "receiver-unaware", "D-CON-14", "CON-007", "a session that only receives notices nothing",
        session=_ReceiverNoticesNothing,
    )  # fmt: skip
    yield mutant("quiet-is-dead", "D-CON-15", "CON-007", "a quiet session counts as dead", session=_QuietIsDead)
    yield mutant("into-the-void", "D-CON-16", "CON-007", "without a peer publishing answers OK", session=_IntoTheVoid)
    yield mutant(
        "keeps-its-slot", "D-CON-19", "CON-006", "a session destroyed with a dead peer keeps its resources",
        backend=_SlotTaken, session=_KeepsItsSlot,
    )  # fmt: skip
    yield mutant("create-blocks", "", "CON-006", "creating with a dead peer takes long", session=_WaitsForThePeer)
    yield mutant(
        "create-says-nothing", "", "CON-006", "creating with a dead peer succeeds", session=_CreatesWithoutPeer
    )
    yield mutant("destroy-blocks", "", "CON-006", "destroying with a dead peer takes long", session=_DestroyBlocks)


def _returns() -> Iterator[Mutant]:
    yield mutant(
        "deaf-at-first", "D-CON-22", "CON-005", "connected anew, it hears nothing for a while", session=_DeafAtFirst,
        agent=_Counting,
    )  # fmt: skip
    yield mutant("eight-sessions", "", "CON-005", "the ninth session is refused", backend=_EightSessions)
    yield mutant("gives-up", "D-CON-25", "CON-005", "a peer that was away for long is not found", backend=_GivesUp)
    yield mutant(
        "gives-up-later", "D-CON-25", "CON-005", "a peer that was away for a minute is not found",
        backend=_GivesUpLater,
    )  # fmt: skip
    yield mutant(
        "halfway", "D-CON-35", "CON-005", "what a failed set-up asked for is never created", session=_Halfway,
        publisher=_Hollow,
    )  # fmt: skip
    yield mutant(
        "later-unserved", "D-CON-36", "CON-005", "who subscribes after a restart hears nothing",
        publisher=_LaterUnserved, agent=_Counting,
    )  # fmt: skip
