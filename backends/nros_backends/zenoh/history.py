"""TRANSIENT_LOCAL: what a publisher keeps for subscriptions that come later, and how those ask for it.

A queryable per publisher, on a key of its own, that answers with its last samples as they were sent. zenoh's
advanced publishers do the same by a protocol of their own, whose replies cannot be told from new samples.
"""

from __future__ import annotations

import collections
import threading
from collections.abc import Callable
from typing import Any

import zenoh

from nros_backends.zenoh.keys import Token
from nros_conformance.rmw.clock import MS, NEVER, Clock
from nros_conformance.rmw.qos import History, is_finite

_TIMEOUT_S = 2.0


def history_key(data_key: str, gid: bytes) -> str:
    """Where a publisher answers. A subscription to data never meets a chunk that begins with ``@``."""
    return f"@nros_history/{data_key}/{gid.hex()}"


class Keeper:
    """The samples that a publisher keeps: as many as its depth, none that has outlived its lifespan."""

    def __init__(self, session: zenoh.Session, data_key: str, token: Token, clock: Clock) -> None:
        qos = token.qos
        self._clock = clock
        self._key = history_key(data_key, token.gid)
        self._lifespan_ns = qos.lifespan_ms * MS if is_finite(qos.lifespan_ms) else None
        depth = None if qos.history is History.KEEP_ALL else qos.depth
        self._kept: collections.deque[tuple[int, bytes, bytes]] = collections.deque(maxlen=depth)
        self._lock = threading.Lock()
        self._queryable: zenoh.Queryable[None] = session.declare_queryable(
            self._key, zenoh.handlers.Callback(self._answer, indirect=False)
        )

    def keep(self, payload: bytes, attachment: bytes) -> None:
        """One more."""
        expires_ns = NEVER if self._lifespan_ns is None else self._clock.now_ns() + self._lifespan_ns
        with self._lock:
            self._kept.append((expires_ns, payload, attachment))

    def close(self) -> None:
        """Answer no more."""
        self._queryable.undeclare()

    def _answer(self, query: zenoh.Query) -> None:
        """On a thread of zenoh."""
        now = self._clock.now_ns()
        with self._lock:
            kept = [one for one in self._kept if one[0] > now]
        for _, payload, attachment in kept:
            query.reply(self._key, payload, attachment=attachment)


def ask(
    session: zenoh.Session,
    data_key: str,
    gid: bytes,
    sample: Callable[[zenoh.Sample], None],
    end: Callable[[], None],
) -> None:
    """Have ``sample`` called for each that the publisher keeps, then ``end``, on threads of zenoh."""

    def on_reply(reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            sample(reply.ok)

    handler: Any = zenoh.handlers.Callback(on_reply, end, indirect=False)
    session.get(
        history_key(data_key, gid),
        handler,
        target=zenoh.QueryTarget.ALL,
        consolidation=zenoh.ConsolidationMode.NONE,
        timeout=_TIMEOUT_S,
    )
