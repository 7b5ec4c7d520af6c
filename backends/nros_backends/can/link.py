"""A session's end of the bus: transfers out, frames in, with the time of their reception."""

from __future__ import annotations

import collections
import time
from typing import Any

import can
from can.interfaces.virtual import VirtualBus

from nros_backends.can.buses import Wiring
from nros_backends.can.frames import MessageId, can_id, parse_id, segment
from nros_conformance.rmw.clock import MS, Clock
from nros_conformance.rmw.codes import ReturnCode

BUS_OFF, RESTARTED = 0x40, 0x100
"""Classes of error frames (linux/can/error.h)."""

DATA_PRIORITY, MANAGEMENT_PRIORITY = 4, 3
"""Nominal and high (Cyphal 1.0, 4.1.1.3): what tells of life and losses goes first."""

_ECHOES = 4096
"""Frames sent of which the echo is still awaited; more are lost ones."""

_ERRORS = 16
"""So many failures to receive in a row are no junk on the bus, but the bus."""

_ENOBUFS = 105
_TRIES = 5
_SLACK_NS = 1 * MS
"""Time stamps of the kernel and this process' clocks agree better than that."""


class Frame:
    """One received message frame, and when it came."""

    __slots__ = ("at_ns", "data", "id")

    def __init__(self, identifier: MessageId, data: bytes, at_ns: int) -> None:
        self.id = identifier
        self.data = data
        self.at_ns = at_ns


class _Outgoing(can.Message):
    """A frame to send; copies share its data, for the virtual bus makes a deep one for each receiver."""

    __slots__ = ()

    def __deepcopy__(self, memo: dict[int, Any] | None) -> can.Message:
        return self.__copy__()


class Link:
    """One node on one bus."""

    def __init__(self, wiring: Wiring, node: int, clock: Clock) -> None:
        self.bus: can.BusABC = wiring.bus
        self.node = node
        self.mtu = wiring.mtu
        self.off = False
        """Whether the controller has said that it is off the bus."""
        self.restarted = False
        """It was off, and is back; whoever looks clears it."""
        self.foreign_ns: int | None = None
        """When another node last used this node's id."""
        self.cut = False
        """Whether the last transfer that failed had gone out in part."""
        self.ignored = 0
        """Frames that are none of ours: foreign, malformed, remote."""
        self._clock = clock
        self._monotonic = wiring.monotonic
        self._echoes: collections.deque[tuple[int, bytes]] | None = (
            collections.deque(maxlen=_ECHOES) if wiring.echoes else None
        )
        self._idle_ns = clock.now_ns()
        self._errors = 0

    def send(self, subject: int, transfer_id: int, payload: bytes, priority: int) -> ReturnCode:
        """Send one transfer. WOULD_BLOCK when the controller has no room, CONNECTION_FAILED when it is off the bus."""
        identifier = can_id(priority, subject, self.node)
        fd = self.mtu > 8
        self.cut = False
        for data in segment(payload, transfer_id, self.mtu):
            message = _Outgoing(
                timestamp=self._clock.now_ns() / 1e9, arbitration_id=identifier, data=data, is_fd=fd,
                bitrate_switch=fd, is_rx=False,
            )  # fmt: skip
            if self._echoes is not None:
                self._echoes.append((identifier, data))  # first: another thread may be receiving
            code = self._send(message)
            if code != ReturnCode.OK:
                return code
            self.cut = True
        self.cut = False
        return ReturnCode.OK

    def _send(self, message: can.Message) -> ReturnCode:
        for _ in range(_TRIES):
            try:
                self.bus.send(message)
                return ReturnCode.OK
            except can.CanError as error:
                full = error.error_code == _ENOBUFS or isinstance(error, can.CanTimeoutError)
                if self.off or not full:
                    return ReturnCode.CONNECTION_FAILED
            self._clock.wait(None, self._clock.now_ns() + MS)
        return ReturnCode.WOULD_BLOCK

    def receive(self, timeout_ns: int) -> Frame | bool:
        """The next frame of another node; False when none came in time, True for one to be ignored."""
        begin = self._clock.now_ns()
        try:
            message = self._recv(timeout_ns)
            self._errors = 0
        except can.CanError:
            # A datagram that is no frame, or an interface that is down; the latter answers so for ever.
            self.ignored += 1
            self._errors += 1
            if timeout_ns > 0:
                self._clock.wait(None, min(begin + timeout_ns, self._clock.now_ns() + MS))
            return self._errors < _ERRORS
        if message is None:
            self._idle_ns = begin
            return False
        identifier = self._identify(message)
        if identifier is None:
            self.ignored += 1
            return True
        return Frame(identifier, bytes(message.data), self._stamp(message.timestamp))

    def _recv(self, timeout_ns: int) -> can.Message | None:
        if not self._clock.virtual or timeout_ns <= 0:
            return self.bus.recv(max(timeout_ns, 0) / 1e9)
        message = self.bus.recv(0)
        if message is None:
            self._clock.wait(None, self._clock.now_ns() + min(timeout_ns, MS))  # a bus waits in real time only
        return message

    def _identify(self, message: can.Message) -> MessageId | None:
        """Whose frame it is; None when it is not to be looked at."""
        if message.is_error_frame:
            if message.arbitration_id & BUS_OFF:
                self.off = True
            elif message.arbitration_id & RESTARTED:
                self.restarted |= self.off
                self.off = False
            return None
        if not message.is_extended_id or message.is_remote_frame or (message.is_fd and self.mtu == 8):
            return None
        identifier = parse_id(message.arbitration_id)
        if identifier is not None and identifier.node == self.node:
            if not self._is_echo(message):
                self.foreign_ns = self._clock.now_ns()
            return None
        return identifier

    def _is_echo(self, message: can.Message) -> bool:
        """Whether this node has sent that frame itself. What was sent before it will not come any more."""
        if self._echoes is None:
            return False
        sent = (message.arbitration_id, bytes(message.data))
        if sent not in self._echoes:
            return False
        while self._echoes.popleft() != sent:
            pass
        return True

    def _stamp(self, timestamp: float) -> int:
        """When a frame came, on the session's clock: between the last look that found none and now.

        Drivers stamp by the wall clock. Its age is taken, and not believed when it points outside of
        that span, as after a step of the wall clock: then it has come now.
        """
        now = self._clock.now_ns()
        if timestamp <= 0:
            return now
        at = round(timestamp * 1e9) if self._monotonic else now - round((time.time() - timestamp) * 1e9)
        if at < self._idle_ns - _SLACK_NS or at > now + _SLACK_NS:
            return now
        return min(max(at, self._idle_ns), now)

    def close(self) -> None:
        """Leave the bus, and what had come with it."""
        self.bus.shutdown()
        if isinstance(self.bus, VirtualBus):
            with self.bus.queue.mutex:
                self.bus.queue.queue.clear()  # else thousands of frames wait for the collector
