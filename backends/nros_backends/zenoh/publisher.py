"""The sending end."""

from __future__ import annotations

import collections
import threading
import time
from typing import TYPE_CHECKING, Any

import zenoh

from nros_backends.zenoh.attachment import Attachment, encode
from nros_backends.zenoh.ends import End
from nros_backends.zenoh.history import Keeper
from nros_backends.zenoh.keys import Token
from nros_backends.zenoh.leases import ManualLease
from nros_backends.zenoh.policies import compatible
from nros_conformance.rmw.backend import Publisher
from nros_conformance.rmw.clock import MS, NEVER
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import EventKind, Side
from nros_conformance.rmw.qos import Durability, Liveliness, Reliability, is_finite

if TYPE_CHECKING:
    from nros_backends.zenoh.session import ZenohSession

CAPACITY = 64 * 2**20
"""Bytes of the largest sample. zenoh itself takes a gigabyte."""


class ZenohPublisher(End, Publisher):
    """A zenoh publisher, and the token by which others know of it.

    ``transport`` is where the token lives: the session's, or one of its own with a shorter lease.
    """

    missed_kind = EventKind.OFFERED_DEADLINE_MISSED

    def __init__(
        self,
        session: ZenohSession,
        topic: str,
        type_name: str,
        token: Token,
        data_key: str,
        transport: zenoh.Session,
    ) -> None:
        qos = token.qos
        lease_ns = qos.lease_ms * MS if qos.liveliness.is_manual and is_finite(qos.lease_ms) else NEVER
        self.lease = ManualLease(lease_ns, session.clock.now_ns())
        self._sent: collections.deque[int] = collections.deque()
        """When samples went, for `look`."""
        self._writing = threading.Lock()
        """Guards the numbers and what is being sent; zenoh's callbacks never want it."""
        super().__init__(session, topic, type_name, token, {EventKind.LIVELINESS_LOST: self.lease.lost})
        reliable = qos.reliability is Reliability.RELIABLE
        self._transport = transport
        self._publisher: zenoh.Publisher | None = session.zenoh.declare_publisher(
            data_key,
            congestion_control=zenoh.CongestionControl.BLOCK if reliable else zenoh.CongestionControl.DROP,
            reliability=zenoh.Reliability.RELIABLE if reliable else zenoh.Reliability.BEST_EFFORT,
            express=True,  # a frame of its own for each sample: one that is lost is one sample
        )
        self._keeper = (
            Keeper(session.zenoh, data_key, token, session.clock)
            if qos.durability is Durability.TRANSIENT_LOCAL
            else None
        )
        self.next_number = 1
        self.reorder: list[tuple[bytes, bytes]] | None = None
        """The fault of this name: what is held back."""
        self.repeat = 1
        """The fault ``duplicate``: how often each sample is put."""
        self._token: zenoh.LivelinessToken | None = transport.liveliness().declare_token(token.key)

    @property
    def matching(self) -> bool:
        """Whether zenoh knows anybody who wants its samples."""
        publisher = self._publisher
        # Annotated as bool, it is an object that is always true.
        status: Any = None if publisher is None else publisher.matching_status
        return status is not None and bool(status.matching)

    def publish_raw(self, data: object) -> int:
        """OK; MESSAGE_TOO_LARGE above `CAPACITY`; CONNECTION_FAILED without a link; INVALID_ARGUMENT."""
        if not isinstance(data, bytes | bytearray | memoryview):
            return ReturnCode.INVALID_ARGUMENT
        payload = bytes(data)
        if len(payload) > CAPACITY:
            return ReturnCode.MESSAGE_TOO_LARGE
        with self._writing:
            if self._publisher is None:
                return ReturnCode.INVALID_ARGUMENT
            if not self.session.connected:
                return ReturnCode.CONNECTION_FAILED
            # First the token: subscriptions take samples of those they know.
            self._assert()
            attachment = encode(Attachment(self.next_number, time.time_ns(), self.token.gid))
            try:
                self._put(payload, attachment)
            except zenoh.ZError:
                return ReturnCode.ERROR  # the number is not used up: it would look like a loss
            self.next_number += 1
            if self._keeper is not None:
                self._keeper.keep(payload, attachment)
            if self.deadline is None:
                self._sent.clear()
            self._sent.append(self.session.clock.now_ns())
        if self.deadline is not None:
            self.session.note()
        return ReturnCode.OK

    def assert_liveliness(self) -> int:
        if self.closed:
            return ReturnCode.INVALID_ARGUMENT
        self._assert()
        return ReturnCode.OK

    def renew(self, now_ns: int) -> None:
        """It is alive: its token comes back if it was withdrawn."""
        with self.session.leasing:
            if self.lease.renew(now_ns) and self._token is None and not self.closed:
                self._token = self._transport.liveliness().declare_token(self.token.key)

    def expire(self, now_ns: int) -> int:
        """Withdraw the token if its lease has expired; when that has to be looked at next. Any thread."""
        with self.session.leasing:
            if self.lease.update(now_ns) and self._token is not None:
                token, self._token = self._token, None
                token.undeclare()
                self.session.note()
            return self.lease.due_ns

    def flush(self) -> None:
        """The fault ``reorder``: put what was held back, the last one first."""
        with self._writing:
            held, self.reorder = self.reorder or [], None
            for payload, attachment in (*held[-1:], *held[:-1]):
                self._put(payload, attachment)

    def look(self, now_ns: int) -> None:
        self.expire(now_ns)
        self._note_sent()
        self.poll(now_ns)

    def meets(self, other: Token) -> bool:
        return other.side is Side.SUBSCRIPTION and self._shares_topic(other) and compatible(self.qos, other.qos)

    def next_due_ns(self) -> int:
        return min(super().next_due_ns(), self.lease.due_ns)

    def release(self) -> None:
        with self._writing:
            publisher, self._publisher = self._publisher, None
            if publisher is not None:
                publisher.undeclare()
                if self._keeper is not None:
                    self._keeper.close()
        # The token goes last: what was sent belongs to a publisher that is there.
        with self.session.leasing:
            token, self._token = self._token, None
            if token is not None:
                token.undeclare()

    def _assert(self) -> None:
        now = self.session.clock.now_ns()
        if self.qos.liveliness is Liveliness.MANUAL_BY_TOPIC:
            self.renew(now)
        elif self.qos.liveliness is Liveliness.MANUAL_BY_NODE:
            self.session.assert_node(now)

    def _put(self, payload: bytes, attachment: bytes) -> None:
        assert self._publisher is not None
        if self.reorder is not None:
            self.reorder.append((payload, attachment))
            return
        for _ in range(self.repeat):
            self._publisher.put(payload, attachment=attachment)

    def _time(self, period_ns: int) -> None:
        self._note_sent()
        super()._time(period_ns)

    def _note_sent(self) -> None:
        with self._writing:
            sent, self._sent = self._sent, collections.deque()
        for at_ns in sent:
            self.moved(at_ns)
