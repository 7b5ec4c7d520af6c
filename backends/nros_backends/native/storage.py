"""The structs that the runtime lends a backend, and the strings in them.

The runtime may pass the same struct in every call, or a fresh copy each time; a backend that keeps a
pointer to it works with the first only. *stable* does the first; *fresh* the second, and overwrites the
copy afterwards, so that whoever still looks at it is found out.
"""

from __future__ import annotations

import collections
import ctypes as ct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_POISON = 0xA5
_KEPT = 4096
"""Copies that stay allocated after their call, so that a stale pointer meets the poison and not somebody else."""


class Strings:
    """C strings that stay where they are for as long as the process lives, as those of the runtime may."""

    def __init__(self) -> None:
        self._kept: dict[bytes, Any] = {}

    def address(self, text: str) -> int:
        """Of a NUL terminated copy. Raises ValueError for a text with a NUL inside."""
        data = text.encode()
        if b"\0" in data:
            raise ValueError("a NUL character cannot be passed")
        if data not in self._kept:
            self._kept[data] = ct.create_string_buffer(data)
        return ct.addressof(self._kept[data])


class Storage:
    """One entity's struct. ``fresh``: whether each call gets a copy of its own."""

    def __init__(self, struct: ct.Structure, graveyard: collections.deque[Any], *, fresh: bool) -> None:
        self.struct = struct
        self._graveyard = graveyard
        self._fresh = fresh

    @contextmanager
    def lent(self) -> Iterator[int]:
        """The address to pass in one call. What the backend wrote to ``backend_data`` is kept."""
        if not self._fresh:
            yield ct.addressof(self.struct)
            return
        copy = type(self.struct).from_buffer_copy(self.struct)
        try:
            yield ct.addressof(copy)
        finally:
            self.struct.backend_data = copy.backend_data
            ct.memset(ct.addressof(copy), _POISON, ct.sizeof(copy))
            self._graveyard.append(copy)


def graveyard() -> collections.deque[Any]:
    """For the copies of one library."""
    return collections.deque(maxlen=_KEPT)
