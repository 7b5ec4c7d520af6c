"""A bus around a bus that loses, repeats, holds back and adds frames: the faults of `faults`."""

from __future__ import annotations

import collections
from collections.abc import Iterable

import can

from nros_backends.can.link import BUS_OFF, RESTARTED
from nros_conformance.rmw.clock import NEVER, Clock

_ENOBUFS = 105


class Tap(can.BusABC):
    """Passes everything on until told otherwise. What is held back leaves while the session is driven."""

    def __init__(self, bus: can.BusABC, clock: Clock) -> None:
        super().__init__(channel="")
        self.channel_info = f"{bus} with faults"
        self.bus = bus
        self.deaf = False
        self.mute = False
        self.stalled = False
        self.delay_ns = 0
        self.lost_id: int | None = None
        """Frames that this session sends with this identifier are lost."""
        self.copied_id: int | None = None
        self.copies: list[can.Message] = []
        """What was sent with ``copied_id``."""
        self._off = False
        self._clock = clock
        self._held: collections.deque[tuple[int, can.Message]] = collections.deque()
        self._inbound: collections.deque[can.Message] = collections.deque()

    def heal(self) -> None:
        """Pass everything on again; first, in order, what was held back."""
        self.deaf = self.mute = self.stalled = False
        self.delay_ns = 0
        if self._off:
            self._off = False
            self._inbound.append(_error(RESTARTED))
        self._release(NEVER)

    def bus_off(self) -> None:
        """The controller leaves the bus: it says so in an error frame, sends nothing and hears nothing."""
        self._off = True
        self._inbound.append(_error(BUS_OFF))

    def put(self, messages: Iterable[can.Message]) -> None:
        """Let these frames reach the session as if they had been on the bus."""
        self._inbound.extend(messages)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self._off:
            raise can.CanOperationError("the controller is off the bus", error_code=_ENOBUFS)
        if self.mute or msg.arbitration_id == self.lost_id:
            return
        if msg.arbitration_id == self.copied_id:
            self.copies.append(msg)
        if self.stalled or self.delay_ns or self._held:
            self._held.append((NEVER if self.stalled else self._clock.now_ns() + self.delay_ns, msg))
            self._release(self._clock.now_ns())
        else:
            self.bus.send(msg, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self._inbound:
            return self._inbound.popleft()
        until = NEVER if timeout is None else self._clock.now_ns() + round(timeout * 1e9)
        while True:
            self._release(self._clock.now_ns())
            now = self._clock.now_ns()
            due = min(until, self._held[0][0]) if self._held else until
            message = self.bus.recv(None if due == NEVER else max(due - now, 0) / 1e9)
            if message is not None and not self.deaf and not self._off:
                return message
            if message is None and self._clock.now_ns() >= until:
                return None

    def shutdown(self) -> None:
        super().shutdown()
        self.bus.shutdown()

    def _release(self, now_ns: int) -> None:
        while self._held and (self._held[0][0] <= now_ns or now_ns == NEVER):
            self.bus.send(self._held.popleft()[1])


def _error(kind: int) -> can.Message:
    return can.Message(arbitration_id=kind, is_error_frame=True, dlc=8, data=bytes(8))
