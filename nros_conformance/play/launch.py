"""How a worker process is started, and what is done when it dies."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import PurePath

WRAPPED = 20
"""A wrapped worker may take this many times longer: valgrind slows the interpreter down about thirtyfold, but
most of a play is waiting."""

DEBUGGERS = ("gdb", "lldb", "rr")
"""Commands that ask somebody at the terminal what to do."""


@dataclasses.dataclass(frozen=True, slots=True)
class Launch:
    """What stands around a worker.

    ``wrap``: a command before its own. ``debug``: somebody watches, so that it has the terminal, plays one
    scenario at a time and is never late. ``debugger``: looks at crashes; empty for none. ``group``: the scenarios
    that one process plays before a fresh one takes over; 0 for all.
    """

    wrap: tuple[str, ...] = ()
    debug: bool = False
    debugger: str = ""
    group: int = 0

    @property
    def patience(self) -> float:
        """By how much every limit of the harness is multiplied."""
        return math.inf if self.debug else WRAPPED if self.wrap else 1

    def command(self, worker: Sequence[str]) -> list[str]:
        """What to start."""
        return [*self.wrap, *worker]

    @property
    def interactive(self) -> bool:
        """Whether the wrapper is one that needs `debug`."""
        return bool(self.wrap) and PurePath(self.wrap[0]).name in DEBUGGERS


PLAIN = Launch()
"""Nothing around it."""
