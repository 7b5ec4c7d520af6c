"""libfaketime, preloaded into the process of a session so that its wall clock can be stepped."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

FAKETIME_PLACES: tuple[tuple[str, str], ...] = tuple(
    (root, pattern)
    for root in ("/usr/lib", "/usr/lib64", "/usr/local/lib")
    for pattern in ("faketime/libfaketimeMT.so.1", "*/faketime/libfaketimeMT.so.1")
)
"""Where distributions put the library; the variant for processes with threads."""

INSTALL = "apt install libfaketime"


class NoFaketime(Exception):
    """The library is not on this machine."""


def find_faketime(places: Iterable[tuple[str, str]] = FAKETIME_PLACES) -> Path | None:
    """The library, in the first of (root, pattern) that holds it."""
    return next((file for root, pattern in places for file in sorted(Path(root).glob(pattern))), None)


def preload(wall_clock: Path) -> dict[str, str]:
    """Environment of a process whose wall clock is ahead by what ``wall_clock`` says, in seconds, at every look.

    Raises `NoFaketime`.
    """
    library = find_faketime()
    if library is None:
        raise NoFaketime(f"libfaketime is not installed; {INSTALL}")
    return {
        "LD_PRELOAD": str(library),
        "FAKETIME_TIMESTAMP_FILE": str(wall_clock),
        "FAKETIME_NO_CACHE": "1",
        "FAKETIME_DONT_FAKE_MONOTONIC": "1",
    }


def lacking() -> dict[str, str]:
    """The faults that cannot be injected on this machine, and why."""
    return {} if find_faketime() is not None else {"clock_step": f"libfaketime is not installed ({INSTALL})"}
