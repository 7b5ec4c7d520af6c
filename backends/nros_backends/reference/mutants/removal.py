"""Defects of hard liveliness (CON)."""

from __future__ import annotations

from collections.abc import Iterator

from nros_backends.reference.backend import ReferenceBackend, ReferenceSession
from nros_backends.reference.mutants.build import mutant
from nros_conformance.model.agent import Agent, _Client
from nros_conformance.model.world import Id
from nros_conformance.rmw.backend import SessionOptions
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.mutants import Mutant


class _Hard(Agent):
    """Another timeout than the one asked for."""

    def hard(self, hard_ns: int) -> int | None:
        return hard_ns

    def admit(self, client: Id, lease_ns: int, hard_ns: int | None, at_ns: int) -> None:
        super().admit(client, lease_ns, None if hard_ns is None else self.hard(hard_ns), at_ns)


class _RemovesNobody(_Hard):
    def hard(self, hard_ns: int) -> int | None:
        return None


class _RemovesLate(_Hard):
    def hard(self, hard_ns: int) -> int | None:
        return 2 * hard_ns


class _RemovesEarly(_Hard):
    def hard(self, hard_ns: int) -> int | None:
        return hard_ns // 10


class _OnlyDataIsLife(Agent):
    """Nobody's answers count."""

    def _check(self, id_: Id, client: _Client, at_ns: int) -> None:
        client.checks += 1
        self.checks += 1


class _OnlyAnswersAreLife(Agent):
    def hears(self, client: Id, at_ns: int) -> None:
        known = self._clients.get(client)
        if known is not None and known.checks:
            super().hears(client, at_ns)


class _RemovedUnseen(ReferenceSession):
    def given_up(self, at_ns: int, *, for_good: bool = False) -> None:
        if not for_good:
            super().given_up(at_ns)


class _Unaware(ReferenceSession):
    def given_up(self, at_ns: int, *, for_good: bool = False) -> None:
        pass

    def lose(self) -> None:
        pass

    def probe(self, timeout_ns: int) -> bool:
        return self.link.open


class _EndpointTaken(ReferenceBackend):
    def create_session(self, options: SessionOptions) -> ReferenceSession:
        if any(not session.link.open for session in self.sessions.values()):
            raise RmwError(ReturnCode.CONNECTION_FAILED, "the endpoint is taken")
        return super().create_session(options)


def mutants() -> Iterator[Mutant]:
    """All of this subject."""
    yield mutant("removes-nobody", "", "CON-008", "a silent client is never removed", agent=_RemovesNobody)
    yield mutant(
        "removes-late", "", "CON-008", "a silent client is removed after twice its timeout", agent=_RemovesLate
    )
    yield mutant("removed-unseen", "", "CON-008", "others do not see a client removed", session=_RemovedUnseen)
    yield mutant("removes-early", "", "CON-009", "a client that pauses is removed", agent=_RemovesEarly)
    yield mutant(
        "only-data-is-life", "D-CON-30", "CON-009", "a client that only drives is removed", agent=_OnlyDataIsLife
    )
    yield mutant("only-answers-are-life", "", "CON-009", "clients that send data are pinged", agent=_OnlyAnswersAreLife)
    yield mutant("unaware", "", "CON-010", "a client does not learn of its removal", session=_Unaware)
    yield mutant(
        "endpoint-taken", "D-CON-26", "CON-010", "the place of a silent client stays taken", backend=_EndpointTaken
    )
