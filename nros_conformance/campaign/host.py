"""What this host can do: how late a sleeping thread wakes."""

from __future__ import annotations

import dataclasses
import os
import platform
import statistics
import time


@dataclasses.dataclass(frozen=True, slots=True)
class HostCheck:
    """Lateness of a thread that sleeps 2 ms again and again, ms."""

    cores: int
    median_ms: float
    worst_ms: float
    seconds: float

    def __str__(self) -> str:
        cores = f"{self.cores} core{'s' if self.cores != 1 else ''}"
        return (
            f"{cores}; a sleeping thread wakes {self.median_ms:.1f} ms late, "
            f"{self.worst_ms:.1f} ms at worst over {self.seconds:g} s"
        )


def cores() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def check_host(seconds: float = 0.5) -> HostCheck:
    """Measure for this long."""
    late = []
    end = time.monotonic() + seconds
    while (begin := time.monotonic()) < end:
        time.sleep(0.002)
        late.append((time.monotonic() - begin - 0.002) * 1e3)
    return HostCheck(cores(), statistics.median(late), max(late), seconds)


def describe_host() -> dict[str, str]:
    """For the report; the matrix prints none of it."""
    return {"system": platform.platform(), "python": platform.python_version(), "cores": str(cores())}
