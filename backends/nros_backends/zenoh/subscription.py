"""The receiving end: samples go into a queue of the QoS' depth, and are counted on the way."""

from __future__ import annotations

from typing import TYPE_CHECKING

import zenoh

from nros_backends.zenoh import attachment
from nros_backends.zenoh.attachment import Attachment
from nros_backends.zenoh.ends import End
from nros_backends.zenoh.history import ask
from nros_backends.zenoh.keys import NO_HASH, Token, data_key
from nros_backends.zenoh.numbers import Numbers
from nros_backends.zenoh.policies import compatible
from nros_conformance.rmw.backend import MessageCallback, Subscription
from nros_conformance.rmw.clock import MS, NEVER
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import LivelinessCounter, Source
from nros_conformance.rmw.events import EventKind, Side
from nros_conformance.rmw.qos import Durability, is_finite
from nros_conformance.rmw.receive_queue import ReceiveQueue

if TYPE_CHECKING:
    from nros_backends.zenoh.session import ZenohSession


class ZenohSubscription(End, Subscription):
    """A zenoh subscriber and a receive queue. Publishers are known by their tokens."""

    missed_kind = EventKind.REQUESTED_DEADLINE_MISSED

    def __init__(self, session: ZenohSession, topic: str, type_name: str, token: Token) -> None:
        self._alive = LivelinessCounter()
        self._numbers = Numbers()
        sources: dict[EventKind, Source] = {
            EventKind.LIVELINESS_CHANGED: self._alive,
            EventKind.MESSAGE_LOST: self._numbers.losses,
        }
        super().__init__(session, topic, type_name, token, sources)
        self._waiting = ReceiveQueue(self.qos, self.registry, session.clock)
        self._publishers: dict[bytes, Token] = {}
        """Those that it matches, by gid."""
        self._strangers: set[bytes] = set()
        """Publishers of this topic whose QoS does not go with its own."""
        self._asked: dict[bytes, list[tuple[int, bytes, Attachment]]] = {}
        """Publishers whose history is on the way, and what they have sent meanwhile."""
        self._created_ns = session.clock.now_ns()
        self._data_key = data_key(session.domain, topic, type_name, "*")
        self._declared = False
        self._token: zenoh.LivelinessToken | None = None

    def declare(self) -> None:
        """Subscribe. The token comes last: who sees it knows that samples get through."""
        self.session.subscribe(self._data_key, self.number)
        self._declared = True
        self._token = self.session.zenoh.liveliness().declare_token(self.token.key)

    def has_data(self) -> bool | int:
        return self._waiting.has_data()

    def try_recv_raw(self, max_size: int) -> bytes | int:
        """The oldest sample. One larger than ``max_size`` is dropped and counted as lost (ROB-002)."""
        taken = self._waiting.try_recv_raw(max_size)
        if taken == ReturnCode.BUFFER_TOO_SMALL:
            self.session.note()
        return taken

    def set_message_callback(self, callback: MessageCallback | None, context: object) -> int:
        with self.session.dispatching:
            code = self._waiting.set_message_callback(callback, context)
        self.session.note()
        return code

    # What the session hands on, from `drive_io`.

    def publisher_came(self, token: Token, at_ns: int) -> None:
        """A publisher of any topic is known now, and alive."""
        if token.side is not Side.PUBLISHER or not self._shares_topic(token):
            return
        if not compatible(token.qos, self.qos):
            self._strangers.add(token.gid)
            return
        self._publishers[token.gid] = token
        self._alive.came(token.key, at_ns)
        if token.qos.durability is self.qos.durability is Durability.TRANSIENT_LOCAL:
            self._ask(token.gid)

    def publisher_left(self, token: Token, at_ns: int) -> None:
        """Its token is gone. What it sends before that is back is nobody's loss."""
        self._strangers.discard(token.gid)
        if self._publishers.pop(token.gid, None) is not None:
            self._alive.left(token.key, at_ns)
            if self.qos.durability is Durability.TRANSIENT_LOCAL:
                self._numbers.resume(token.gid)
            else:
                self._numbers.forget(token.gid)

    def sample(self, payload: bytes, about: Attachment, at_ns: int) -> bool:
        """A sample arrived at ``at_ns``; whether it is one that counts."""
        if at_ns < self._created_ns or about.gid in self._strangers:
            return False
        if about.gid in self._asked:
            self._asked[about.gid].append((at_ns, payload, about))
            return False
        return self._accept(payload, about, at_ns, history=False)

    def history(self, gid: bytes, samples: list[tuple[bytes, bytes | None]], at_ns: int) -> bool:
        """What a publisher had kept has come, all of it; whether there was anything."""
        found = [(payload, attachment.decode(extra, payload)) for payload, extra in samples]
        kept = sorted(
            ((payload, about) for payload, about in found if about is not None and about.gid == gid),
            key=lambda one: one[1].number,
        )
        fresh = False
        for payload, about in kept:
            fresh |= self._accept(payload, about, at_ns, history=True)
        for later_ns, payload, about in self._asked.pop(gid, []):
            fresh |= self._accept(payload, about, later_ns, history=False)
        return fresh

    def look(self, now_ns: int) -> None:
        self._numbers.update(now_ns)
        self._numbers.losses.add(self._waiting.dropped(), now_ns)
        self.poll(now_ns)

    def next_due_ns(self) -> int:
        return min(super().next_due_ns(), self._numbers.next_due_ns)

    def meets(self, other: Token) -> bool:
        return other.side is Side.PUBLISHER and self._shares_topic(other) and compatible(other.qos, self.qos)

    def follow(self, gid: bytes, number: int) -> None:
        """The fault ``preset`` for numbers: as if ``number`` had been the publisher's last one."""
        with self.session.dispatching:
            self._numbers.preset(gid, number)

    def release(self) -> None:
        self._waiting.clear()
        declared, self._declared = self._declared, False
        token, self._token = self._token, None
        if token is not None:
            token.undeclare()
        if declared:
            self.session.unsubscribe(self._data_key, self.number)

    # Inside.

    def _ask(self, gid: bytes) -> None:
        if gid not in self._asked:
            self._asked[gid] = []
            key = data_key(self.session.domain, self.topic, self.type_name, NO_HASH)
            ask(self.session.zenoh, key, gid, *self.session.collector(self.number, gid))

    def _accept(self, payload: bytes, about: Attachment, at_ns: int, *, history: bool) -> bool:
        """Deadline clock, numbers, queue, message callbacks."""
        if not self._numbers.accept(about, at_ns, history=history):
            return False
        self.moved(at_ns)
        publisher = self._publishers.get(about.gid)
        expires_ns = NEVER
        if publisher is not None and is_finite(publisher.qos.lifespan_ms):
            expires_ns = at_ns + publisher.qos.lifespan_ms * MS
        now_ns = self.session.clock.now_ns()
        lost = self._waiting.put(payload, at_ns, expires_ns=expires_ns, history=history, now_ns=now_ns)
        self._numbers.losses.add(lost, at_ns)
        return True
