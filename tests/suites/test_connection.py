"""The connection suite against defective variants of the reference: each fails where its defect shows."""

from __future__ import annotations

from pathlib import Path

import pytest

from nros_backends.reference.backend import ReferenceBackend, ReferencePublisher, ReferenceSession
from nros_conformance.campaign.plans import Row, make_plan
from nros_conformance.judge.judge import judge
from nros_conformance.judge.results import Verdict
from nros_conformance.model.agent import Agent
from nros_conformance.model.world import Id
from nros_conformance.play.player import play_virtually
from nros_conformance.rmw.backend import Backend, SessionOptions
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.qos import QosProfile
from nros_conformance.trace.records import Header, Trace
from tests.suites.test_suites import reference, scenario, suites


class Variant(ReferenceBackend):
    """Sessions of the class ``session``."""

    session: type[ReferenceSession] = ReferenceSession

    def create_session(self, options: SessionOptions) -> ReferenceSession:
        return self.session(self, options)


class PongFlagNeverCleared(Variant):
    class session(ReferenceSession):  # noqa: N801
        answered = False

        def probe(self, timeout_ns: int) -> bool:
            self.answered = super().probe(timeout_ns) or self.answered
            return self.answered


class LoopbackAnswers(Variant):
    class session(ReferenceSession):  # noqa: N801
        def probe(self, timeout_ns: int) -> bool:
            return super().probe(timeout_ns) or len(self.entities) > 1


class LateAnswerCounts(Variant):
    class session(ReferenceSession):  # noqa: N801
        sent = False

        def probe(self, timeout_ns: int) -> bool:
            late, self.sent = self.sent, True
            return super().probe(timeout_ns) or (late and self.connected)


class PingTakesTwiceItsTimeout(Variant):
    class session(ReferenceSession):  # noqa: N801
        def probe(self, timeout_ns: int) -> bool:
            return super().probe(timeout_ns) or super().probe(timeout_ns)


class PingActsAsADelay(Variant):
    class session(ReferenceSession):  # noqa: N801
        def probe(self, timeout_ns: int) -> bool:
            begin = self.clock.now_ns()
            answered = super().probe(timeout_ns)
            self.clock.wait(None, begin + timeout_ns)
            return answered


class AttemptsAreIgnored(Variant):
    class session(ReferenceSession):  # noqa: N801
        def ping(self, timeout_ms: int, attempts: int = 1) -> int:
            return super().ping(timeout_ms, 10)


class PingBeforeASessionKeepsItsAnswer(ReferenceBackend):
    answered = False

    def ping(self, options: SessionOptions, timeout_ms: int, attempts: int = 1) -> int:
        self.answered |= super().ping(options, timeout_ms, attempts) == ReturnCode.OK
        return ReturnCode.OK if self.answered else ReturnCode.TIMEOUT


class PingNeverRecovers(ReferenceBackend):
    failed = False

    def ping(self, options: SessionOptions, timeout_ms: int, attempts: int = 1) -> int:
        code = super().ping(options, timeout_ms, attempts)
        self.failed |= code != ReturnCode.OK
        return ReturnCode.TIMEOUT if self.failed else code


class PingEndsWithEntities(Variant):
    class session(ReferenceSession):  # noqa: N801
        def probe(self, timeout_ns: int) -> bool:
            return super().probe(timeout_ns) and not self.entities


class PingLosesData(Variant):
    class session(ReferenceSession):  # noqa: N801
        def ping(self, timeout_ms: int, attempts: int = 1) -> int:
            for entity in self.entities:
                take = getattr(entity, "try_recv_raw", None)
                if take is not None:
                    take(65536)
            return super().ping(timeout_ms, attempts)


class PingRunsCallbacks(Variant):
    class session(ReferenceSession):  # noqa: N801
        def ping(self, timeout_ms: int, attempts: int = 1) -> int:
            self.drive_io(0)
            return super().ping(timeout_ms, attempts)


class FastRestartGoesUnnoticed(Variant):
    """Whoever answers is the peer: a plain ping in place of the one within the session."""

    class session(ReferenceSession):  # noqa: N801
        def probe(self, timeout_ns: int) -> bool:
            return self.backend.agent.up and self.link.open

        def link_changed(self) -> None:
            if self.link.open and self.backend.agent.up and not self.backend.agent.knows(self.id):
                self.link.silent_since = None
            else:
                super().link_changed()

        def lose(self) -> None:
            pass


class PublishesIntoTheVoid(Variant):
    class session(ReferenceSession):  # noqa: N801
        def lose(self) -> None:
            pass


class IdleIsAFailure(Variant):
    class session(ReferenceSession):  # noqa: N801
        quiet = 0

        def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
            self.quiet += 1
            return super().drive_io(timeout_ms, max_callbacks) or (ReturnCode.TIMEOUT if self.quiet > 20 else 0)


class CreateWaitsForEver(Variant):
    class session(ReferenceSession):  # noqa: N801
        def await_peer(self) -> None:
            try:
                super().await_peer()
            except RmwError:
                self.clock.wait(None, self.clock.now_ns() + 3_000 * MS)
                raise


class CreateDoesNotSay(Variant):
    class session(ReferenceSession):  # noqa: N801
        def await_peer(self) -> None:
            pass


class DestroyBlocks(Variant):
    class session(ReferenceSession):  # noqa: N801
        def destroy(self) -> int:
            if not self.connected:
                self.clock.wait(None, self.clock.now_ns() + 3_000 * MS)
            return super().destroy()


class DestroyKeepsResources(Variant):
    """After a destroy with a dead peer the next create fails."""

    stuck = False

    def create_session(self, options: SessionOptions) -> ReferenceSession:
        if self.stuck:
            raise RmwError(ReturnCode.BAD_ALLOC, "the slot is taken")
        return super().create_session(options)

    class session(ReferenceSession):  # noqa: N801
        def destroy(self) -> int:
            assert isinstance(self.backend, DestroyKeepsResources)
            self.backend.stuck |= not self.connected
            return super().destroy()


class GivesUpAfterFourRestarts(Variant):
    made = 0

    def create_session(self, options: SessionOptions) -> ReferenceSession:
        self.made += 1
        if self.made > 8:
            raise RmwError(ReturnCode.CONNECTION_FAILED, "no more sessions")
        return super().create_session(options)


class LaterSubscribersAreNotServed(Variant):
    """A session that was opened after a restart serves only those that were there when it was."""

    class session(ReferenceSession):  # noqa: N801
        def create_publisher(self, topic: str, type_name: str, qos: QosProfile) -> ReferencePublisher:
            made = super().create_publisher(topic, type_name, qos)
            known = set(self.backend.entities)
            if self.id > 10:
                send = made.send

                def send_to_known(data: bytes) -> None:
                    late = [one for one in self.backend.entities.values() if one.id not in known and one.id > made.id]
                    for one in late:
                        one.session.link.in_ = False
                    send(data)
                    for one in late:
                        one.session.link.in_ = True

                made.send = send_to_known  # type: ignore[method-assign]
            return made


class _Lenient(Agent):
    """Never removes anybody."""

    def admit(self, client: Id, lease_ns: int, hard_ns: int | None, at_ns: int) -> None:
        super().admit(client, lease_ns, None, at_ns)


class NobodyIsRemoved(ReferenceBackend):
    agent_type: type[Agent] = _Lenient

    def __init__(self, host: object) -> None:
        super().__init__(host)  # type: ignore[arg-type]
        self.agent.__class__ = self.agent_type


class _Deaf(Agent):
    """Only data counts as life."""

    def _check(self, id_: Id, client: object, at_ns: int) -> None:
        client.checks += 1  # type: ignore[attr-defined]
        self.checks += 1


class IdleClientsAreRemoved(NobodyIsRemoved):
    agent_type = _Deaf


class _Nagging(Agent):
    """Data does not count as life."""

    def hears(self, client: Id, at_ns: int) -> None:
        known = self._clients.get(client)
        if known is not None and known.checks:
            super().hears(client, at_ns)


class PingsDespiteData(NobodyIsRemoved):
    agent_type = _Nagging


class _Hasty(Agent):
    """Removes at half of the timeout."""

    def admit(self, client: Id, lease_ns: int, hard_ns: int | None, at_ns: int) -> None:
        super().admit(client, lease_ns, hard_ns and hard_ns // 10, at_ns)


class RemovesTooEarly(NobodyIsRemoved):
    agent_type = _Hasty


class ReturnsUnaware(Variant):
    """A removed client is not told, and what it had is not taken back."""

    class session(ReferenceSession):  # noqa: N801
        def given_up(self, at_ns: int, *, for_good: bool = False) -> None:
            pass

        def lose(self) -> None:
            pass

        def probe(self, timeout_ns: int) -> bool:
            return self.link.open


class SuccessorIsRefused(Variant):
    def create_session(self, options: SessionOptions) -> ReferenceSession:
        if any(not session.link.open for session in self.sessions.values()):
            raise RmwError(ReturnCode.CONNECTION_FAILED, "the endpoint is taken")
        return super().create_session(options)


def verdict_of(key: str, adapter: type[Backend]) -> Verdict:
    header, *records = play_virtually(make_plan(scenario(key), Row(reference(), ""), suites(), Path()), adapter)
    assert isinstance(header, Header)
    return judge(Trace(header, tuple(records)))  # type: ignore[arg-type]


@pytest.mark.parametrize(("adapter", "key", "requirement"), [
    (PongFlagNeverCleared, "con.ping-truth[kill=true]", "CON-001"),
    (LoopbackAnswers, "con.cut-off", "CON-001"),
    (LateAnswerCounts, "con.late-answer", "CON-001"),
    (PingTakesTwiceItsTimeout, "con.traffic-is-no-answer", "CON-002"),
    (PingActsAsADelay, "con.busy-link", "CON-002"),
    (AttemptsAreIgnored, "con.attempts[who=in-session]", "CON-002"),
    (AttemptsAreIgnored, "con.attempts-are-probes[attempts=3]", "CON-001"),
    (PingBeforeASessionKeepsItsAnswer, "con.ping-before-truth[kill=true]", "CON-001"),
    (PingNeverRecovers, "con.ping-before-truth[kill=false]", "CON-001"),
    (PingNeverRecovers, "con.absent-at-start[absence=short]", "CON-005"),
    (PingEndsWithEntities, "con.any-stage", "CON-003"),
    (PingLosesData, "con.queued-data[queued=received]", "CON-003"),
    (PingRunsCallbacks, "con.no-callback-in-ping", "CON-003"),
    (FastRestartGoesUnnoticed, "con.restart-is-noticed[kill=true,outage=fast,side=pub]", "CON-004"),
    (FastRestartGoesUnnoticed, "con.state-machine[outage=fast]", "CON-005"),
    (CreateWaitsForEver, "con.connect-to-a-dead-peer", "CON-006"),
    (CreateDoesNotSay, "con.create-with-a-dead-peer[side=publisher]", "CON-006"),
    (DestroyBlocks, "con.destroy-with-a-dead-peer[entities_first=false]", "CON-006"),
    (GivesUpAfterFourRestarts, "con.twenty-restarts", "CON-005"),
    (NobodyIsRemoved, "con.hard-silence[client=cut-off]", "CON-008"),
    (IdleClientsAreRemoved, "con.hard-idle", "CON-009"),
    (IdleClientsAreRemoved, "con.hard-receiver", "CON-009"),
    (PingsDespiteData, "con.hard-data", "CON-009"),
    (RemovesTooEarly, "con.hard-silence[client=cut-off]", "CON-009"),
    (RemovesTooEarly, "con.hard-pause", "CON-009"),
    (ReturnsUnaware, "con.hard-return", "CON-010"),
])  # fmt: skip
def test_a_defect_fails_where_it_shows(adapter: type[Backend], key: str, requirement: str) -> None:
    assert verdict_of(key, ReferenceBackend).verdict == "pass"
    verdict = verdict_of(key, adapter)
    assert verdict.verdict == "fail"
    assert requirement in {one for finding in verdict.failed() for one in finding.proves}


@pytest.mark.parametrize(("adapter", "key"), [
    (PublishesIntoTheVoid, "con.death-is-noticed[side=pub]"),
    (PublishesIntoTheVoid, "con.death-is-noticed[side=sub]"),
    (IdleIsAFailure, "con.idle-is-healthy[side=sub]"),
])  # fmt: skip
def test_a_defect_against_a_should_is_a_warning(adapter: type[Backend], key: str) -> None:
    assert verdict_of(key, adapter).verdict == "warn"


@pytest.mark.parametrize(("adapter", "key"), [
    (DestroyKeepsResources, "con.destroy-with-a-dead-peer[entities_first=true]"),
    (SuccessorIsRefused, "con.hard-successor"),
])  # fmt: skip
def test_a_creation_that_should_work_and_does_not_ends_the_play(adapter: type[Backend], key: str) -> None:
    assert verdict_of(key, adapter).verdict == "fail"
