"""The receive queue of a subscription: what has come and can be taken.

For adapters whose middleware has no queue of the QoS' depth, or does not say what falls out of it.
"""

from __future__ import annotations

import threading
from collections import deque

from nros_conformance.rmw.backend import MessageCallback
from nros_conformance.rmw.clock import NEVER, Clock
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.dispatch import EventRegistry
from nros_conformance.rmw.qos import History, QosProfile


class _Sample:
    __slots__ = ("at_ns", "called", "expires_ns", "history", "payload", "waiting")

    def __init__(self, payload: bytes, at_ns: int, expires_ns: int, history: bool) -> None:
        self.payload = payload
        self.at_ns = at_ns
        self.expires_ns = expires_ns
        self.history = history
        self.waiting = True
        """Whether it stands in the queue."""
        self.called = False
        """Whether a message callback has run for it."""


class ReceiveQueue:
    """Samples in the order in which they were put: as many as the QoS' depth, or all, until their lifespans end.

    `has_data`, `try_recv_raw` and `set_message_callback` are those of `Subscription`, argument checks included; the
    first two may be called on any thread, whatever the others do meanwhile. The others belong to the thread, or
    the lock, that guards ``registry``, which knows the message callback and whether the subscription is destroyed.
    """

    def __init__(self, qos: QosProfile, registry: EventRegistry, clock: Clock) -> None:
        self._depth = None if qos.history is History.KEEP_ALL else qos.depth
        self._registry = registry
        self._clock = clock
        self._samples: deque[_Sample] = deque()
        self._expires_ns = NEVER
        """No waiting sample expires before."""
        self._too_small = 0
        self._lock = threading.Lock()
        """Guards samples and counts; never held during a callback."""

    def __len__(self) -> int:
        """How many wait, among them perhaps some whose lifespan is over."""
        return len(self._samples)

    def put(
        self, payload: bytes, at_ns: int, *, expires_ns: int = NEVER, history: bool = False, now_ns: int | None = None
    ) -> int:
        """Have a sample wait that came at ``at_ns``, and queue its message callback; how many are lost by it.

        That is 1 when it pushed the oldest one out of a full queue. What has outlived its lifespan by ``now_ns``
        (by ``at_ns``, unless stated) goes before that, and is no loss (MSL-006); ``history``, sent before
        publisher and subscription knew each other, is none either (MSL-004).
        """
        sample = _Sample(payload, at_ns, expires_ns, history)
        lost = 0
        with self._lock:
            self._samples.append(sample)
            self._expires_ns = min(self._expires_ns, expires_ns)
            self._expire(at_ns if now_ns is None else now_ns)
            if self._depth is not None and len(self._samples) > self._depth:
                lost = int(not self._pop().history)
        self._announce(sample)
        return lost

    def dropped(self) -> int:
        """How many samples were taken into too small a buffer since the last call: they are lost (ROB-002)."""
        with self._lock:
            count, self._too_small = self._too_small, 0
        return count

    def clear(self) -> None:
        """Release all that waits; the subscription is being destroyed."""
        with self._lock:
            self._samples.clear()
            self._expires_ns = NEVER

    def has_data(self) -> bool | int:
        """`Subscription.has_data`: whether a sample waits whose lifespan is not over; or INVALID_ARGUMENT."""
        if self._registry.closed:
            return ReturnCode.INVALID_ARGUMENT
        with self._lock:
            self._expire(self._clock.now_ns())
            return bool(self._samples)

    def try_recv_raw(self, max_size: int) -> bytes | int:
        """`Subscription.try_recv_raw`: the oldest sample, NO_DATA, BUFFER_TOO_SMALL or INVALID_ARGUMENT.

        A sample larger than ``max_size`` octets is gone with BUFFER_TOO_SMALL, and for `dropped` to tell (ROB-002).
        """
        if self._registry.closed or not isinstance(max_size, int) or max_size < 0:
            return ReturnCode.INVALID_ARGUMENT
        with self._lock:
            self._expire(self._clock.now_ns())
            if not self._samples:
                return ReturnCode.NO_DATA
            payload = self._pop().payload
            if len(payload) <= max_size:
                return payload
            self._too_small += 1
        return ReturnCode.BUFFER_TOO_SMALL

    def set_message_callback(self, callback: MessageCallback | None, context: object) -> int:
        """`Subscription.set_message_callback`: called also for what waits by now and had no callback yet."""
        code = self._registry.set_message_callback(callback, context)
        for sample in self._snapshot():
            self._announce(sample)
        return code

    def _snapshot(self) -> tuple[_Sample, ...]:
        with self._lock:
            return tuple(self._samples)

    def _announce(self, sample: _Sample) -> None:
        self._registry.message(sample.at_ns, lambda: self._claim(sample))

    def _claim(self, sample: _Sample) -> bool:
        """Whether the callback is to run: once for a sample, as long as it can be taken."""
        if sample.called or not sample.waiting or sample.expires_ns <= self._clock.now_ns():
            return False
        sample.called = True
        return True

    def _expire(self, now_ns: int) -> None:
        if now_ns < self._expires_ns:
            return
        for sample in self._samples:
            sample.waiting = sample.expires_ns > now_ns
        self._samples = deque(sample for sample in self._samples if sample.waiting)
        self._expires_ns = min((sample.expires_ns for sample in self._samples), default=NEVER)

    def _pop(self) -> _Sample:
        sample = self._samples.popleft()
        sample.waiting = False
        return sample
