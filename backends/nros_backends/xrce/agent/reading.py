"""Delivery control: when a READ_DATA request may give its next sample (clause 7.8.5).

As in eProsima's agent: without delivery control one sample; the rate is a bucket of one second's octets;
0 samples cancel, but only if no sample is waiting, else they count as no limit.
"""

from __future__ import annotations

from nros_backends.xrce.wire.ids import ObjectId
from nros_backends.xrce.wire.messages import DeliveryControl, ReadData

SECOND = 1_000_000_000
MS = 1_000_000
UNLIMITED = 0xFFFF


class Reading:
    """A READ_DATA request in force. Times in nanoseconds of the caller's clock."""

    def __init__(self, request: ReadData, now_ns: int, waiting: bool) -> None:
        control = request.delivery or DeliveryControl(max_samples=1)
        self.request = request.request
        self.object: ObjectId = request.object
        self.stream = request.stream
        self._left: int | None = control.max_samples
        if control.max_samples == UNLIMITED or (control.max_samples == 0 and waiting):
            self._left = None
        self._end_ns = now_ns + control.max_elapsed_s * SECOND if control.max_elapsed_s else None
        self._rate = control.max_octets_per_s
        self._tokens = self._rate * SECOND  # octets times nanoseconds, so that nothing is rounded
        self._filled_ns = now_ns
        self._pace_ns = control.min_pace_ms * MS
        self._next_ns = now_ns

    def over(self, now_ns: int) -> bool:
        """Whether no sample will come any more."""
        return self._left == 0 or (self._end_ns is not None and now_ns > self._end_ns)

    def ready_ns(self, size: int, now_ns: int) -> int:
        """From when on a sample of ``size`` octets may be given."""
        if not self._rate:
            return self._next_ns
        self._tokens = min(self._rate * SECOND, self._tokens + (now_ns - self._filled_ns) * self._rate)
        self._filled_ns = now_ns
        lacking = min(size, self._rate) * SECOND - self._tokens  # a full bucket is enough for any size
        return max(self._next_ns, now_ns + (max(lacking, 0) + self._rate - 1) // self._rate)

    def give(self, size: int, now_ns: int) -> None:
        """Account for a sample that was given."""
        if self._left is not None:
            self._left -= 1
        if self._rate:
            self._tokens -= min(size, self._rate) * SECOND
        self._next_ns = now_ns + self._pace_ns
