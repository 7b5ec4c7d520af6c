"""Port ranges for one row of one run alone: rows and runs on one host must not disturb each other."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock, Timeout

FIRST, SIZE, COUNT = 11_000, 250, 84
"""Below the ephemeral range of Linux (from 32,768 on) and above the registered RTPS defaults (7400...)."""


class NoPorts(Exception):
    """All ranges are taken by runs on this host."""


@contextlib.contextmanager
def lease_ports() -> Iterator[range]:
    """A range of `SIZE` ports that nobody else holds; given back at the end, also of a crash."""
    folder = Path(tempfile.gettempdir()) / f"nros-conformance-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    for number in range(COUNT):
        first = FIRST + number * SIZE
        lock = FileLock(folder / f"ports-{first}.lock", timeout=0)
        try:
            lock.acquire()
        except Timeout:
            continue
        try:
            yield range(first, first + SIZE)
        finally:
            lock.release()
        return
    raise NoPorts(f"runs of nros-conformance hold all {COUNT} port ranges of this host; wait for one to end")
