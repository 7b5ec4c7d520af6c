"""What this process uses of its host."""

from __future__ import annotations

import ctypes
import gc
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

_SELF = Path("/proc/self")

passing = threading.Lock()
"""Held by who opens descriptors of this process for a moment and beside a play, and by who counts them."""


def _memory() -> int:
    """Without what the allocator keeps for later, where it gives that back (glibc): with zenoh some 0.5 MB."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
    return int((_SELF / "statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _entries(folder: str) -> Callable[[], int]:
    def count() -> int:
        with passing:
            return sum(1 for _ in (_SELF / folder).iterdir())

    return count


QUANTITIES: dict[str, Callable[[], int]] = {
    "cpu": time.process_time_ns,
    "threads": _entries("task"),
    "descriptors": _entries("fd"),
    "memory": _memory,
}
"""By name: nanoseconds of processor time, numbers, resident bytes (of Linux' /proc). Raise OSError elsewhere."""
