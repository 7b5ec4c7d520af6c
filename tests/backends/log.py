"""What an entity's callbacks were told, held against the payload rules while it is read."""

from __future__ import annotations

from typing import TypeVar

from nros_conformance.rmw.backend import Publisher, Subscription
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import CountStatus, EventStatus, LivelinessChangedStatus

_L = TypeVar("_L", bound="Log")


class Log:
    """A status callback, and its own context."""

    def __init__(self) -> None:
        self.statuses: list[EventStatus] = []

    def __call__(self, kind: int, status: EventStatus, context: object) -> None:
        assert context is self
        self.statuses.append(status)

    def watch(self: _L, entity: Publisher | Subscription, kind: int, deadline_ms: int = 0) -> _L:
        assert entity.register_event(kind, deadline_ms, self, self) == ReturnCode.OK
        return self

    @property
    def total(self) -> int:
        """The last total, which is the sum of the changes (CNT-002)."""
        if not self.statuses:
            return 0
        status = self.statuses[-1]
        assert isinstance(status, CountStatus)
        assert sum(one[1] for one in self.statuses) == status.total_count
        return status.total_count

    @property
    def counts(self) -> tuple[int, int]:
        """alive and not alive, each the sum of its changes (CNT-004)."""
        alive, not_alive = 0, 0
        for status in self.statuses:
            assert isinstance(status, LivelinessChangedStatus)
            alive += status.alive_count_change
            not_alive += status.not_alive_count_change
            assert (alive, not_alive) == (status.alive_count, status.not_alive_count)
        return alive, not_alive
