"""What a session says on the bus: heartbeats, its endpoints, samples and their counts."""

from __future__ import annotations

import collections
import dataclasses
import itertools
import os
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from nros_backends.can.buses import SUBJECT_MAX
from nros_backends.can.ends import End
from nros_backends.can.frames import MTU_CLASSIC
from nros_backends.can.link import DATA_PRIORITY, MANAGEMENT_PRIORITY, Link
from nros_backends.can.messages import (
    ENDPOINT_SUBJECT,
    HEARTBEAT_SUBJECT,
    SIGN_SUBJECT,
    STATUS_SUBJECT,
    Endpoint,
    Heartbeat,
    Sign,
    SignKind,
    Status,
)
from nros_backends.can.publisher import CanPublisher
from nros_backends.can.transfers import NUMBERS
from nros_conformance.rmw.clock import MS, Clock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.qos import Liveliness, QosProfile, is_finite

HEARTBEAT_NS = 200 * MS
"""Cyphal asks for one a second at least; any higher rate is allowed."""

_PER_LEASE = 4
"""Heartbeats in the shortest lease that they assert."""

_REPEAT_NS = 1_000 * MS
"""Announcements and counts are repeated that often, for whom they did not reach."""

_COUNT_EVERY = 16
"""Samples between two counts; below 31, so that transfer-ids alone cannot mistake a loss for a repetition."""

_ROUNDS = 256
_LENGTH_SIZE = 2


class Said(NamedTuple):
    """A transfer as this session itself hears it: whole, and without the length that CAN FD needs."""

    subject: int
    transfer_id: int
    payload: bytes
    at_ns: int


class Outlet:
    """A subject on which this node sends samples of one topic and QoS, numbered without gaps."""

    def __init__(self, subject: int) -> None:
        self.subject = subject
        self.count = 0
        """Samples sent, modulo `NUMBERS`; also the number of the next one."""
        self.told = 0
        """The count that was told last."""
        self.publishers = 0


class Herald:
    """The sending half of a session; under its lock."""

    def __init__(self, link: Link, clock: Clock, lease_ms: int, subjects: Mapping[bytes, int]) -> None:
        self.muted = False
        """Whether the last heartbeat could not be sent."""
        self.wanted = False
        """Whether somebody has come who has to be told everything."""
        self.said: collections.deque[Said] = collections.deque()
        """For this session's own ears."""
        self.listening = False
        """Whether this session has subscriptions; else its own samples are not kept for them."""
        self._link = link
        self._clock = clock
        self._fixed = subjects
        self._period_ns = min(HEARTBEAT_NS, lease_ms * MS // _PER_LEASE)
        self._base_period_ns = self._period_ns
        self._incarnation = os.urandom(1)[0]
        self._begin_ns = self._beat_ns = self._told_ns = clock.now_ns()
        self._round = 0
        self._outlets: dict[Endpoint, Outlet] = {}
        self._transfers = {
            subject: itertools.count()
            for subject in (HEARTBEAT_SUBJECT, ENDPOINT_SUBJECT, STATUS_SUBJECT, SIGN_SUBJECT)
        }

    def next_due_ns(self) -> int:
        """When to call `speak` next."""
        return self._beat_ns

    def speak(self, now_ns: int, ends: Iterable[End]) -> None:
        """Send what is due: a heartbeat, changed counts, and everything to a newcomer or once in a second."""
        if now_ns < self._beat_ns and not self.wanted:
            return
        ends = tuple(ends)
        self.beat(now_ns, ends)
        everything = self.wanted or now_ns - self._told_ns >= _REPEAT_NS
        if everything and not self.muted:
            self.wanted, self._told_ns = False, now_ns
            self._round = (self._round + 1) % _ROUNDS
            for end in ends:
                self.announce(end)
            self.sign(Sign(SignKind.ROUND, round=self._round))
        for outlet in self._outlets.values():
            if outlet.count != outlet.told or (everything and outlet.publishers):
                self._tell(outlet)

    def beat(self, now_ns: int, ends: Iterable[End]) -> None:
        """Send a heartbeat, which is what asserts AUTOMATIC publishers."""
        self._beat_ns = now_ns + self._period_ns
        heartbeat = Heartbeat((now_ns - self._begin_ns) // (1_000 * MS), self._incarnation)
        code = self._send(HEARTBEAT_SUBJECT, heartbeat.encode())
        automatic = [
            end for end in ends if isinstance(end, CanPublisher) and end.qos.liveliness is Liveliness.AUTOMATIC
        ]
        if code == ReturnCode.OK:
            for publisher in automatic:
                publisher.alive_at(now_ns)
        elif not self.muted:
            for publisher in automatic:
                publisher.asserted_ns = max(publisher.asserted_ns, now_ns - self._period_ns)
        self.muted = code != ReturnCode.OK

    def announce(self, end: End) -> None:
        """Tell everybody of an endpoint."""
        self._send(ENDPOINT_SUBJECT, end.announcement(self._clock.now_ns(), self._round).encode())

    def sign(self, sign: Sign) -> ReturnCode:
        """Send a sign of life, or of its end."""
        return self._send(SIGN_SUBJECT, sign.encode())

    def sample(self, outlet: Outlet, payload: bytes) -> ReturnCode:
        """Send a sample. Its number is used up when at least one frame of it went out."""
        framed = payload if self._link.mtu == MTU_CLASSIC else len(payload).to_bytes(_LENGTH_SIZE, "little") + payload
        code = self._link.send(outlet.subject, outlet.count, framed, DATA_PRIORITY)
        if code == ReturnCode.OK and self.listening:
            self.said.append(Said(outlet.subject, outlet.count, payload, self._clock.now_ns()))
        if code == ReturnCode.OK or self._link.cut:
            outlet.count = (outlet.count + 1) % NUMBERS
            if outlet.count % _COUNT_EVERY == 0:
                self._tell(outlet)
        return code

    def rebase(self, outlet: Outlet, count: int) -> ReturnCode:
        """Go on with another number, and say so."""
        outlet.count = outlet.told = count % NUMBERS
        return self._send(STATUS_SUBJECT, Status(outlet.subject, outlet.count, rebased=True).encode())

    def outlet(self, profile: Endpoint) -> Outlet:
        """Where publishers with this topic and QoS send; ``profile``: one of them, whichever number it has.

        The topic's fixed subject, or the first free one from its hash on. A subject belongs to one topic and
        QoS of a node, and subscriptions know whose it is by the announcement: neither topics whose hashes
        collide nor publishers that a subscription does not want are mixed. Raises `RmwError` BAD_ALLOC when
        none is free, INCOMPATIBLE_QOS when a fixed subject would have to carry two kinds.
        """
        kind = dataclasses.replace(profile, number=0)
        if kind not in self._outlets:
            fixed = self._fixed.get(kind.topic)
            if fixed is None:
                self._outlets[kind] = Outlet(self._free_subject(int.from_bytes(kind.topic, "little")))
            else:
                self._outlets[kind] = self._take_over(fixed)
        return self._outlets[kind]

    def _take_over(self, subject: int) -> Outlet:
        """A fixed subject for another QoS; its numbers go on."""
        for kind, outlet in tuple(self._outlets.items()):
            if outlet.subject == subject:
                if outlet.publishers:
                    raise RmwError(
                        ReturnCode.INCOMPATIBLE_QOS,
                        f"subject {subject}, which is fixed, has a publisher with another QoS",
                    )
                del self._outlets[kind]
                return outlet
        return Outlet(subject)

    def _free_subject(self, first: int) -> int:
        taken = {outlet.subject for outlet in self._outlets.values()} | set(self._fixed.values())
        for step in range(SUBJECT_MAX + 1):
            subject = (first + step) % (SUBJECT_MAX + 1)
            if subject not in taken:
                return subject
        raise RmwError(ReturnCode.BAD_ALLOC, "no subject is free")

    def adjust(self, qualities: Iterable[QosProfile]) -> None:
        """Beat as often as the AUTOMATIC publishers need that there are now."""
        leases = [
            qos.lease_ms * MS // _PER_LEASE
            for qos in qualities
            if qos.liveliness is Liveliness.AUTOMATIC and is_finite(qos.lease_ms)
        ]
        self._period_ns = min([self._base_period_ns, *leases])
        self._beat_ns = min(self._beat_ns, self._clock.now_ns() + self._period_ns)

    def _tell(self, outlet: Outlet) -> None:
        if self._send(STATUS_SUBJECT, Status(outlet.subject, outlet.count).encode()) == ReturnCode.OK:
            outlet.told = outlet.count

    def _send(self, subject: int, payload: bytes) -> ReturnCode:
        transfer_id = next(self._transfers[subject])
        code = self._link.send(subject, transfer_id, payload, MANAGEMENT_PRIORITY)
        self.said.append(Said(subject, transfer_id, payload, self._clock.now_ns()))
        return code
