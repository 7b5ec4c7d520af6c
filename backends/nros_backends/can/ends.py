"""What publishers and subscriptions have in common: identity, announcement, events, deadline.

All of it is done under the session's lock; events are found in `look`, inside `drive_io`.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from nros_backends.can.messages import Endpoint, digest
from nros_backends.can.policies import compatible, finite
from nros_conformance.rmw.clock import MS, NEVER
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import Source
from nros_conformance.rmw.ends import ClockedEnd
from nros_conformance.rmw.events import EventCallback, EventKind
from nros_conformance.rmw.qos import QosProfile, is_finite

if TYPE_CHECKING:
    from nros_backends.can.peers import Remote
    from nros_backends.can.session import CanSession


class End(ClockedEnd):
    """One endpoint of a session; ``number`` tells it from the others of its node."""

    is_reader: bool

    def __init__(
        self,
        session: CanSession,
        number: int,
        names: tuple[str, str],
        qos: QosProfile,
        sources: dict[EventKind, Source],
    ) -> None:
        self.session = session
        self.number = number
        super().__init__(session.clock, session.queue, *names, qos, sources)
        self.topic_digest, self.type_digest = topic_digest(self.topic), digest(self.type_name)
        self.profile = Endpoint(
            number=number, subject=0, is_reader=self.is_reader, topic=self.topic_digest, type=self.type_digest,
            reliability=qos.reliability, durability=qos.durability, liveliness=qos.liveliness,
            lease_ms=finite(qos.lease_ms), node_lease_ms=session.lease_ms, deadline_ms=finite(qos.deadline_ms),
            lifespan_ms=finite(qos.lifespan_ms),
        )  # fmt: skip
        if qos.has_deadline:
            self._time(qos.deadline_ms * MS)

    def announcement(self, now_ns: int, round_: int) -> Endpoint:
        """What the others are told of it."""
        return dataclasses.replace(self.profile, round=round_)

    def meets(self, info: Endpoint) -> bool:
        """Whether that endpoint is another end of the same topic, and the two belong together."""
        if info.is_reader is self.is_reader or info.topic != self.topic_digest or info.type != self.type_digest:
            return False
        return compatible(self.profile, info) if info.is_reader else compatible(info, self.profile)

    def met(self) -> list[Remote]:
        """The endpoints that it has met, and that are there."""
        return [
            remote
            for peer in tuple(self.session.directory.peers.values())
            for remote in tuple(peer.remotes.values())
            if remote.alive and self.meets(remote.info)
        ]

    def knows(self, other: End) -> bool:
        """Whether it has met that endpoint of another session, or of its own."""
        peer = self.session.directory.peers.get(other.session.node)
        remote = None if peer is None else peer.remotes.get(other.number)
        return remote is not None and self.meets(remote.info)

    def register_event(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        with self.session.lock:
            return super().register_event(kind, deadline_ms, callback, context)

    def destroy(self) -> int:
        """OK; INVALID_ARGUMENT, and no harm, the second time."""
        with self.session.lock:
            if self.closed:
                return ReturnCode.INVALID_ARGUMENT
            self.registry.close()
            self.session.forget(self)
            self.release()
        return ReturnCode.OK

    def release(self) -> None:
        """Drop what it holds."""

    def look(self, now_ns: int) -> None:
        """Find what time has brought, and queue callbacks."""
        self.poll(now_ns)


def topic_digest(topic: str) -> bytes:
    """What stands for a topic on the bus; a leading slash makes no difference."""
    return digest(topic.removeprefix("/"))


def lease_ns(qos: QosProfile) -> int:
    """The lease of a publisher's QoS, `NEVER` without one."""
    return qos.lease_ms * MS if is_finite(qos.lease_ms) else NEVER
