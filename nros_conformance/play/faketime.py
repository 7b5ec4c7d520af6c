"""libfaketime, preloaded into the process of a session so that its wall clock can be stepped."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

FAKETIME_PLACES: tuple[tuple[str, str], ...] = tuple(
    (root, pattern)
    for root in ("/usr/lib", "/usr/lib64", "/usr/local/lib")
    for pattern in ("faketime/libfaketimeMT.so.1", "*/faketime/libfaketimeMT.so.1")
)
"""Where distributions put the library; the variant for processes with threads."""

INSTALL = "apt install libfaketime"

_AHEAD = "FAKETIME"
"""The variable that says how far the wall clock is ahead, in seconds with a sign. It is looked up at every call."""


class NoFaketime(Exception):
    """The library is not on this machine."""


def find_faketime(places: Iterable[tuple[str, str]] = FAKETIME_PLACES) -> Path | None:
    """The library, in the first of (root, pattern) that holds it."""
    return next((file for root, pattern in places for file in sorted(Path(root).glob(pattern))), None)


def preload() -> dict[str, str]:
    """Environment of a process that can `set_ahead` its wall clock. Raises `NoFaketime`.

    libfaketime could read a file instead, which others can write: 4.5 us a call where the variable takes 0.5, and
    a middleware looks at the clock 5,000 times a second.
    """
    library = find_faketime()
    if library is None:
        raise NoFaketime(f"libfaketime is not installed; {INSTALL}")
    return {"LD_PRELOAD": str(library), _AHEAD: "+0", "FAKETIME_NO_CACHE": "1", "FAKETIME_DONT_FAKE_MONOTONIC": "1"}


def set_ahead(by_ns: int) -> None:
    """Set the wall clock of this process to ``by_ns`` ahead of the real one; its monotonic clock goes on as before."""
    os.environ[_AHEAD] = f"{by_ns / 1e9:+.6f}"


def lacking() -> dict[str, str]:
    """The faults that cannot be injected on this machine, and why."""
    return {} if find_faketime() is not None else {"clock_step": f"libfaketime is not installed ({INSTALL})"}
