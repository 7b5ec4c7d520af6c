"""One process plays thousands of scenarios on one backend: threads, descriptors and memory have to stay flat.

python benchmarks/endurance.py [--backend cyclone] [--plays 5000] [--at-once 16]
"""

from __future__ import annotations

import argparse
import ctypes
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import msgspec

from nros_conformance.campaign.plans import Row, make_plan
from nros_conformance.campaign.selection import Selection, decide
from nros_conformance.play.adapters import load_adapter
from nros_conformance.play.leases import lease_ports
from nros_conformance.play.player import play
from nros_conformance.play.process import QUANTITIES
from nros_conformance.rmw.clock import MonotonicClock
from nros_conformance.rmw.discovery import find_backend
from nros_conformance.suite.loader import load_suites
from nros_conformance.trace.files import TraceWriter

LEAK_KB = 0.5
"""Allocated per play and not freed: what libddsc 11.0.1 loses with each of a play's two domains is 0.07."""


class Reading(NamedTuple):
    """What the process holds: threads of all kinds, open descriptors, resident memory and the heap in use, kB."""

    threads: int
    descriptors: int
    memory_kb: int
    heap_kb: float


class Heap(ctypes.Structure):
    """glibc's ``struct mallinfo2``: ``uordblks`` are the bytes that are allocated now, in all arenas."""

    _fields_ = tuple(
        (name, ctypes.c_size_t)
        for name in [
            "arena",
            "ordblks",
            "smblks",
            "hblks",
            "hblkhd",
            "usmblks",
            "fsmblks",
            "uordblks",
            "fordblks",
            "keepcost",
        ]
    )


LIBC = ctypes.CDLL(None)
LIBC.mallinfo2.restype = Heap


def read() -> Reading:
    """Now, as scenarios measure it: after a collection, and without free pages, which are no leak."""
    threads, descriptors, memory = (QUANTITIES[what]() for what in ("threads", "descriptors", "memory"))
    heap = LIBC.mallinfo2()
    return Reading(threads, descriptors, memory // 1024, round((heap.uordblks + heap.hblkhd) / 1024, 1))


def main() -> None:
    """Play, read, compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backend", default="cyclone")
    parser.add_argument("--plays", type=int, default=5000)
    parser.add_argument("--at-once", type=int, default=16)
    parser.add_argument("--scenario", action="append", default=[])
    options = parser.parse_args()
    found = find_backend(options.backend)
    assert found.declaration is not None
    adapter, suites = load_adapter(found.adapter), load_suites()
    row = Row(found.declaration, found.adapter, clock="real")
    chosen = Selection(scenarios=tuple(options.scenario) or ("reg.supports-*", "reg.destroyed-*")).choose(suites)
    scenarios = [one for one in chosen if decide(one, found.declaration).status == "play"]
    networks, lock, failures = list(range(options.at_once)), threading.Lock(), 0

    with lease_ports() as ports, tempfile.TemporaryDirectory() as folder:

        def one_play(number: int) -> None:
            nonlocal failures
            plan = make_plan(scenarios[number % len(scenarios)], row, suites, Path(folder), ports=ports)
            with lock:
                network = networks.pop()
            with TraceWriter(Path(folder) / f"{network}.jsonl") as writer:
                end = play(msgspec.structs.replace(plan, network=network), adapter, MonotonicClock(), writer.write)
            with lock:
                networks.append(network)
                failures += end.outcome != "done"

        begun = time.monotonic()
        readings = []
        with ThreadPoolExecutor(options.at_once) as pool:
            step = max(options.plays // 10, 1)
            for first in range(0, options.plays, step):
                list(pool.map(one_play, range(first, min(first + step, options.plays))))
                readings.append(read())
                print(f"{first + step:6} plays  {readings[-1]}", flush=True)
    warm, last = readings[len(readings) // 5], readings[-1]
    later = options.plays * (len(readings) - 1 - len(readings) // 5) // len(readings)
    growth, leak = ((end - begin) / max(later, 1) for end, begin in zip(last[2:], warm[2:], strict=True))
    print(
        f"{options.plays} plays in {time.monotonic() - begun:.0f} s, {failures} not done; "
        f"threads {last.threads - warm.threads:+d}, descriptors {last.descriptors - warm.descriptors:+d}, "
        f"memory {growth:+.2f} kB a play after warm-up, {leak:+.2f} of it in use"
    )
    grown = last.threads > warm.threads or last.descriptors > warm.descriptors or leak > LEAK_KB
    sys.exit(1 if failures or grown else 0)


if __name__ == "__main__":
    main()
