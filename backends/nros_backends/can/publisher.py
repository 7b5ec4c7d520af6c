"""The sending end."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from nros_backends.can.ends import End, lease_ns
from nros_backends.can.messages import EXPIRED_MS, Endpoint, Sign, SignKind
from nros_backends.can.policies import CAPACITY
from nros_conformance.rmw.backend import Publisher
from nros_conformance.rmw.clock import MS, NEVER
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import CountTracker
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import Liveliness, QosProfile

if TYPE_CHECKING:
    from nros_backends.can.session import CanSession


class CanPublisher(End, Publisher):
    """One of the publishers that send through an `Outlet`: those of one topic and QoS share subject and numbers."""

    missed_kind = EventKind.OFFERED_DEADLINE_MISSED
    is_reader = False

    def __init__(self, session: CanSession, number: int, names: tuple[str, str], qos: QosProfile) -> None:
        self._lost = CountTracker()
        super().__init__(session, number, names, qos, {EventKind.LIVELINESS_LOST: self._lost})
        self.outlet = session.herald.outlet(self.profile)
        self.asserted_ns = session.clock.now_ns()
        """When it was last said to be alive; its creation is the first time."""
        self._is_lost = False
        self._lease_ns = lease_ns(qos)

    def announcement(self, now_ns: int, round_: int) -> Endpoint:
        silent_ms = 0
        if self.qos.liveliness.is_manual and self._lease_ns != NEVER:
            silent_ns = now_ns - self.asserted_ns
            silent_ms = EXPIRED_MS if silent_ns >= self._lease_ns else max(silent_ns, 0) // MS
        return dataclasses.replace(
            super().announcement(now_ns, round_),
            subject=self.outlet.subject, count=self.outlet.count, silent_ms=silent_ms,
        )  # fmt: skip

    def publish_raw(self, data: object) -> int:
        """OK, which also asserts a MANUAL publisher.

        MESSAGE_TOO_LARGE above `CAPACITY`; WOULD_BLOCK while the controller has no room, CONNECTION_FAILED
        while it is off the bus; INVALID_CONFIG while another node has this node's id; INVALID_ARGUMENT.
        """
        if not isinstance(data, bytes | bytearray | memoryview):
            return ReturnCode.INVALID_ARGUMENT
        payload = bytes(data)
        if len(payload) > CAPACITY:
            return ReturnCode.MESSAGE_TOO_LARGE
        with self.session.lock:
            if self.closed:
                return ReturnCode.INVALID_ARGUMENT
            if self.session.collides():
                return ReturnCode.INVALID_CONFIG
            code = self._assert() if self.qos.liveliness.is_manual else ReturnCode.OK
            if code == ReturnCode.OK:
                code = self.session.herald.sample(self.outlet, payload)
            if code == ReturnCode.OK:
                self.moved(self.session.clock.now_ns())
            return code

    def assert_liveliness(self) -> int:
        with self.session.lock:
            if self.closed:
                return ReturnCode.INVALID_ARGUMENT
            return self._assert() if self.qos.liveliness.is_manual else ReturnCode.OK

    def _assert(self) -> ReturnCode:
        by_node = self.qos.liveliness is Liveliness.MANUAL_BY_NODE
        code = self.session.herald.sign(Sign(SignKind.ASSERTS, 0 if by_node else self.number))
        if code == ReturnCode.OK:
            for publisher in self.session.manual_by_node() if by_node else [self]:
                publisher.alive_at(self.session.clock.now_ns())
        return code

    def alive_at(self, at_ns: int) -> None:
        """It was asserted, or the heartbeat that asserts it was sent."""
        self._expire(at_ns)
        self.asserted_ns = at_ns
        self._is_lost = False

    def look(self, now_ns: int) -> None:
        self._expire(now_ns)
        super().look(now_ns)

    def next_due_ns(self) -> int:
        due = super().next_due_ns()
        if self._is_lost or not self._in_danger():
            return due
        return min(due, self.asserted_ns + self._lease_ns)

    def preset(self, kind: int | None, count: int) -> ReturnCode:
        """See `Backend.inject`."""
        if kind is None:
            return self.session.herald.rebase(self.outlet, count)
        trackers = {EventKind.LIVELINESS_LOST: self._lost, self.missed_kind: self.missed}
        if kind not in trackers:
            return ReturnCode.UNSUPPORTED
        trackers[EventKind(kind)].preset(count)
        return ReturnCode.OK

    def _in_danger(self) -> bool:
        """Whether its lease runs: always when manual, when AUTOMATIC only while heartbeats cannot be sent."""
        if self._lease_ns == NEVER or self.qos.liveliness is Liveliness.NONE:
            return False
        return self.qos.liveliness.is_manual or self.session.herald.muted

    def _expire(self, now_ns: int) -> None:
        if not self._is_lost and self._in_danger() and now_ns >= self.asserted_ns + self._lease_ns:
            self._is_lost = True
            self._lost.add(1, self.asserted_ns + self._lease_ns)
