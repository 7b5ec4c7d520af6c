"""Plain CDR as DDS-XRCE uses it: bounded reading, aligned writing.

Alignment counts from the start of the buffer. Nothing is allocated for a length that the buffer does
not hold, so that a declared length of gigabytes costs nothing.
"""

from __future__ import annotations


class Malformed(ValueError):
    """Input that is not DDS-XRCE. ``offset``: byte at which reading stopped; ``reason``: what was wrong there."""

    def __init__(self, offset: int, reason: str) -> None:
        super().__init__(f"malformed XRCE message at byte {offset}: {reason}")
        self.offset = offset
        self.reason = reason


class Reader:
    """Reads ``data[start:end]``; alignment counts from ``start``. Every method raises `Malformed`.

    ``origin`` is added to the offsets of errors, for a buffer that was cut from a message.
    """

    def __init__(self, data: bytes, little: bool = True, start: int = 0, end: int | None = None, origin: int = 0):
        self.data = data
        self.little = little
        self.start = start
        self.position = start
        self.end = len(data) if end is None else end
        self.origin = origin

    @property
    def remaining(self) -> int:
        """Bytes not yet read."""
        return self.end - self.position

    def fail(self, reason: str) -> Malformed:
        """The error for the current position."""
        return Malformed(self.origin + self.position, reason)

    def take(self, count: int, what: str) -> bytes:
        """``count`` raw bytes."""
        if count > self.remaining:
            raise self.fail(f"{what} needs {count} bytes, {self.remaining} are left")
        taken = self.data[self.position : self.position + count]
        self.position += count
        return taken

    def align(self, size: int) -> None:
        """Skip to a multiple of ``size``."""
        self.take(-(self.position - self.start) % size, "alignment")

    def unsigned(self, size: int, what: str) -> int:
        """An aligned unsigned integer of ``size`` bytes."""
        self.align(size)
        return int.from_bytes(self.take(size, what), "little" if self.little else "big")

    def signed(self, size: int, what: str) -> int:
        """An aligned signed integer of ``size`` bytes."""
        self.align(size)
        return int.from_bytes(self.take(size, what), "little" if self.little else "big", signed=True)

    def boolean(self, what: str) -> bool:
        """A CDR bool: 0 or 1 and nothing else."""
        value = self.take(1, what)[0]
        if value > 1:
            self.position -= 1
            raise self.fail(f"{what} is {value}, a bool is 0 or 1")
        return value == 1

    def sequence(self, what: str) -> bytes:
        """Octets behind their u32 length."""
        return self.take(self.unsigned(4, f"length of {what}"), what)

    def string(self, what: str) -> str:
        """UTF-8 behind its u32 length, which counts the final NUL. Length 0 is the empty string too."""
        octets = self.sequence(what)
        if octets and octets[-1] != 0:
            raise self.fail(f"{what} does not end with NUL")
        try:
            return octets[:-1].decode()
        except UnicodeDecodeError:
            raise self.fail(f"{what} is not UTF-8") from None


class Writer:
    """Writes a buffer; alignment counts from its start. Values that do not fit raise `OverflowError`."""

    def __init__(self, little: bool = True) -> None:
        self.little = little
        self.data = bytearray()

    def put(self, octets: bytes) -> None:
        """Raw bytes."""
        self.data += octets

    def align(self, size: int) -> None:
        """Zeros up to a multiple of ``size``."""
        self.data += bytes(-len(self.data) % size)

    def unsigned(self, size: int, value: int) -> None:
        """An aligned unsigned integer of ``size`` bytes."""
        self.align(size)
        self.data += value.to_bytes(size, "little" if self.little else "big")

    def signed(self, size: int, value: int) -> None:
        """An aligned signed integer of ``size`` bytes."""
        self.align(size)
        self.data += value.to_bytes(size, "little" if self.little else "big", signed=True)

    def boolean(self, value: bool) -> None:
        """A CDR bool."""
        self.data.append(value)

    def sequence(self, octets: bytes) -> None:
        """Octets behind their u32 length."""
        self.unsigned(4, len(octets))
        self.put(octets)

    def string(self, value: str) -> None:
        """UTF-8 with a final NUL behind its u32 length."""
        self.sequence(value.encode() + b"\0")
