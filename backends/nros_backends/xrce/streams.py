"""Streams of an XRCE session, for both of its ends (clause 8.4.11 to 8.4.14): no sockets, no clock.

A body is what follows the message header: encoded submessages. Whoever owns a stream puts the
header in front. All times are integer nanoseconds, handed in.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from nros_backends.xrce.wire.cdr import Malformed
from nros_backends.xrce.wire.codec import SUBMESSAGE_HEADER, encode_body, frames
from nros_backends.xrce.wire.ids import Id
from nros_backends.xrce.wire.messages import Acknack, Fragment, Heartbeat
from nros_backends.xrce.wire.transfers import LAST

MODULUS = 1 << 16
"""Sequence numbers wrap here."""
WINDOW = 16
"""Messages that may be unacknowledged: as many as ACKNACK has bits."""
LARGEST = 16 << 20
"""Octets to which fragments are joined; what is larger is thrown away and not stored."""


def later(one: int, other: int) -> bool:
    """Whether sequence number ``one`` comes after ``other``: by less than half the range."""
    return 0 < (one - other) % MODULUS < MODULUS // 2


class Packet(NamedTuple):
    """A message of a stream, without its header."""

    stream: int
    sequence: int
    body: bytes


class BestEffortOutput:
    """Numbers messages. What does not fit one message cannot be sent: there are no fragments here."""

    def __init__(self, stream: int) -> None:
        self.stream = stream
        self._next = 0

    def send(self, body: bytes) -> Packet:
        """The next message."""
        packet = Packet(self.stream, self._next, body)
        self._next = (self._next + 1) % MODULUS
        return packet

    def reset(self) -> None:
        """Back to sequence number 0."""
        self._next = 0


class BestEffortInput:
    """Drops what is old or repeated, and counts the gaps in ``lost`` (since creation, resets included)."""

    def __init__(self, stream: int) -> None:
        self.stream = stream
        self.lost = 0
        self._last = MODULUS - 1

    def receive(self, sequence: int) -> bool:
        """Whether this message is to be handled."""
        if not later(sequence, self._last):
            return False
        self.lost += (sequence - self._last - 1) % MODULUS
        self._last = sequence
        return True

    def reset(self) -> None:
        """Expect sequence number 0 again."""
        self._last = MODULUS - 1


class ReliableOutput:
    """Keeps messages until they are acknowledged; cuts into fragments what is larger than one message.

    ``capacity``: octets of the largest body (the MTU without the message header), at least 5.
    ``resend_all``: any nack bit resends everything unacknowledged, as eProsima's client does; its agent
    resends what the bits name. ``heartbeat_ns``: between announcements of `heartbeat`.
    """

    def __init__(
        self,
        stream: int,
        capacity: int,
        window: int = WINDOW,
        heartbeat_ns: int = 100_000_000,
        resend_all: bool = False,
    ) -> None:
        if capacity <= SUBMESSAGE_HEADER:
            raise ValueError(f"{capacity} octets hold no fragment")
        self.stream = stream
        self._capacity = capacity
        self._window = window
        self._heartbeat_ns = heartbeat_ns
        self._resend_all = resend_all
        self._backlog: deque[bytes] = deque()
        self._sent: dict[int, bytes] = {}
        self._again: list[int] = []
        self._first = 0  # the oldest that is not acknowledged
        self._next = 0
        self._due: int | None = None

    @property
    def free(self) -> int:
        """Messages that would be sent at once; 0 if the window is full."""
        return max(self._window - len(self._sent) - len(self._backlog), 0)

    @property
    def settled(self) -> bool:
        """Whether everything was sent and acknowledged."""
        return not self._sent and not self._backlog

    @property
    def wakeup_ns(self) -> int | None:
        """When `heartbeat` has something to say next; None: not before something is sent."""
        return self._due

    def push(self, body: bytes) -> None:
        """Queue a body: as one message, or one submessage (with its header) as many fragments."""
        if len(body) <= self._capacity:
            self._backlog.append(body)
            return
        size = self._capacity - SUBMESSAGE_HEADER
        for start in range(0, len(body), size):
            piece = Fragment(data=body[start : start + size], last=start + size >= len(body))
            self._backlog.append(encode_body([piece]))

    def take(self, now_ns: int) -> list[Packet]:
        """What is to be sent now: what was asked for again, then what is new and has room in the window."""
        again, self._again = self._again, []
        packets = [Packet(self.stream, sequence, self._sent[sequence]) for sequence in again if sequence in self._sent]
        while self._backlog and len(self._sent) < self._window:
            body = self._backlog.popleft()
            self._sent[self._next] = body
            packets.append(Packet(self.stream, self._next, body))
            self._next = (self._next + 1) % MODULUS
        if self._sent and self._due is None:
            self._due = now_ns + self._heartbeat_ns
        return packets

    def acknack(self, first_unacked: int, missing: int, now_ns: int) -> None:
        """Take in an ACKNACK; one about messages that were never sent is ignored. `take` follows."""
        ahead = (first_unacked - self._first) % MODULUS
        if ahead > len(self._sent):
            return
        for _ in range(ahead):
            del self._sent[self._first]
            self._first = (self._first + 1) % MODULUS
        if missing:
            named = [(first_unacked + bit) % MODULUS for bit in range(WINDOW) if missing >> bit & 1]
            self._again = list(self._sent) if self._resend_all else [one for one in named if one in self._sent]
        self._due = now_ns + self._heartbeat_ns if self._sent else None

    def heartbeat(self, now_ns: int) -> Heartbeat | None:
        """The announcement, if it is due; the next is due one period later."""
        if self._due is None or now_ns < self._due:
            return None
        self._due = now_ns + self._heartbeat_ns
        return self.announce()

    def announce(self) -> Heartbeat | None:
        """What is unacknowledged, whether or not an announcement is due; None: nothing is."""
        if not self._sent:
            return None
        return Heartbeat(first=self._first, last=(self._next - 1) % MODULUS, stream=self.stream)

    def reset(self) -> None:
        """Back to sequence number 0; everything unacknowledged or waiting is dropped."""
        self._backlog.clear()
        self._sent.clear()
        self._again.clear()
        self._first = self._next = 0
        self._due = None


class ReliableInput:
    """Hands bodies out in order and once, fragments joined.

    ``lost`` counts messages that the sender said it no longer has (since creation, resets included).
    """

    def __init__(self, stream: int, window: int = WINDOW, largest: int = LARGEST) -> None:
        self.stream = stream
        self.lost = 0
        self._window = window
        self._largest = largest
        self._next = 0
        self._last = MODULUS - 1  # the last that the sender is known to have sent
        self._early: dict[int, bytes] = {}
        self._joined = bytearray()
        self._skipping = False

    def receive(self, sequence: int, body: bytes) -> list[bytes]:
        """The bodies that can be handled now; old, repeated and too early ones (by the window) are dropped."""
        if (sequence - self._next) % MODULUS >= self._window:
            return []
        if later(sequence, self._last):
            self._last = sequence
        self._early.setdefault(sequence, body)
        return self._ready()

    def heartbeat(self, first: int, last: int) -> list[bytes]:
        """Take in a HEARTBEAT: what the sender no longer has (before ``first``) is given up."""
        bodies = []
        while later(first, self._next):
            if self._next in self._early:
                bodies += self._ready()
                continue
            gone = min([(first - self._next) % MODULUS, *((one - self._next) % MODULUS for one in self._early)])
            self.lost += gone
            self._next = (self._next + gone) % MODULUS
            self._give_up()
        if later(last, self._last):
            self._last = last
        if later((self._next - 1) % MODULUS, self._last):
            self._last = (self._next - 1) % MODULUS
        return bodies + self._ready()

    def acknack(self) -> Acknack:
        """What is here and, bit by bit, what is missing of what the sender announced."""
        missing = 0
        for bit in range(WINDOW):
            sequence = (self._next + bit) % MODULUS
            if later(sequence, self._last):
                break
            if sequence not in self._early:
                missing |= 1 << bit
        return Acknack(first_unacked=self._next, missing=missing, stream=self.stream)

    def reset(self) -> None:
        """Expect sequence number 0 again."""
        self._next = 0
        self._last = MODULUS - 1
        self._early.clear()
        self._joined.clear()
        self._skipping = False

    def _ready(self) -> list[bytes]:
        bodies = []
        while self._next in self._early:
            bodies += self._join(self._early.pop(self._next))
            self._next = (self._next + 1) % MODULUS
        return bodies

    def _join(self, body: bytes) -> list[bytes]:
        try:
            cut = list(frames(body))
        except Malformed:
            return [body]  # who reads it meets the same error, and knows what to answer
        if all(frame.id != Id.FRAGMENT for frame in cut):
            self._skipping = False
            return [body]
        bodies = []
        for frame in cut:
            if frame.id != Id.FRAGMENT:
                bodies.append(body[frame.offset - SUBMESSAGE_HEADER : frame.offset + len(frame.payload)])
                continue
            last = bool(frame.flags & LAST)
            if not self._skipping:
                self._joined += frame.payload
            if len(self._joined) > self._largest:
                self._give_up()
            if last:
                if self._joined:
                    bodies.append(bytes(self._joined))
                self._joined.clear()
                self._skipping = False
        return bodies

    def _give_up(self) -> None:
        """Throw fragments away up to the next last one: some are missing, or they are too many.

        Where the last one is missing too, that of the next sample in fragments ends it: none says that it is a first.
        """
        self._skipping = True
        self._joined.clear()
