"""A worker process: plays scenarios of one backend, many at once, and writes their traces.

Started by `pool`. It may crash or hang as its backend pleases: the harness looks at what is left.
"""

from __future__ import annotations

import faulthandler
import gc
import itertools
import os
import queue
import signal
import socket
import sys
import threading
import time
from pathlib import Path

import msgspec

from nros_conformance.play.adapters import load_adapter
from nros_conformance.play.forked import die_with_parent
from nros_conformance.play.plan import Plan
from nros_conformance.play.player import play
from nros_conformance.play.starvation import Watch
from nros_conformance.play.wire import Beat, Broken, Finished, Job, Report, Started, decode_job, encode
from nros_conformance.rmw.backend import Backend
from nros_conformance.rmw.clock import Clock, MonotonicClock, VirtualClock
from nros_conformance.trace.files import TraceWriter
from nros_conformance.trace.records import End

BEAT_S = 0.5
"""How often the worker shows that its interpreter runs."""

SETUPS = 2
"""Stages set up at once. Setting up is what costs time (sockets, threads, discovery): 48 at once made each
last 230 ms instead of 20, and delayed the deadline timers of those that were already playing."""


PLACES = 32
"""In the network of a row: a worker's plays have those from its first on, plays that hang keep theirs."""


class Worker:
    """Plays one job over one connection to the harness."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._lock = threading.Lock()
        self._hung = False
        self._gate = threading.Semaphore(SETUPS)
        self._watch = Watch()

    def run(self, job: Job) -> None:
        """Play all plans; tells the harness about each."""
        threading.Thread(target=self._beat, name="beat", daemon=True).start()
        try:
            adapter = load_adapter(job.plans[0].adapter)
        except Exception as error:
            self.tell(Broken(f"{type(error).__name__}: {error}"))
            return
        if job.virtual:
            for plan in job.plans:
                self._play(plan, adapter, VirtualClock())
        else:
            self._play_together(job, adapter)

    def tell(self, message: Report) -> None:
        """Say something to the harness; without a harness there is no reason to live."""
        try:
            with self._lock:
                self._connection.sendall(encode(message))
        except OSError:
            os._exit(1)

    @property
    def hung(self) -> bool:
        """Whether a thread of this process is stuck in a backend, so that an orderly exit may not work."""
        return self._hung

    def _play_together(self, job: Job, adapter: type[Backend]) -> None:
        self._watch.start(at_hand=job.concurrency > 1)  # one that plays alone may count its descriptors
        if job.concurrency > 1:
            # A full collection holds the GIL, for 0.1 to 0.7 s once 80,000 objects of ended plays have gathered,
            # and every session of the process stands still: a lease of 390 ms ran out. What 400 plays leave is 35 MB.
            # Where one is asked for all the same, it need not look at modules.
            gc.disable()
            gc.freeze()
        waiting: queue.SimpleQueue[Plan] = queue.SimpleQueue()
        for plan in job.plans:
            waiting.put(plan)

        def work(network: int) -> None:
            while True:
                try:
                    plan = waiting.get_nowait()
                except queue.Empty:
                    return
                here = msgspec.structs.replace(plan, network=plan.network + network)
                end = self._play(here, adapter, MonotonicClock())
                if end.outcome == "hang":
                    # Its threads still use this place in the network: nobody else may have it.
                    network = next(spare)

        spare = itertools.count(PLACES)
        threads = [threading.Thread(target=work, args=(n,), name=f"stage {n}") for n in range(job.concurrency)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    def _play(self, plan: Plan, adapter: type[Backend], clock: Clock) -> End:
        self.tell(Started(plan.key))
        begin = time.monotonic()
        with TraceWriter(Path(plan.trace)) as writer:
            if isinstance(clock, VirtualClock):
                end = clock.run(lambda: play(plan, adapter, clock, writer.write))
            else:
                end = play(plan, adapter, clock, writer.write, self._gate, self._watch)
        self._hung |= end.outcome == "hang"
        self.tell(Finished(plan.key, end.outcome, time.monotonic() - begin))
        return end

    def _beat(self) -> None:
        while True:
            self.tell(Beat())
            time.sleep(BEAT_S)


def main() -> None:
    """Entry of ``python -m nros_conformance.play FD``."""
    die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the harness decides what an interrupt means
    faulthandler.enable()
    # A thread that another one asks for the GIL gives it away only where it blocks. With the default of 5 ms it
    # may lose it between the backend's last look and the note that drive_io has returned, for as long as a busy
    # host lets the other thread wait for a core: that would look like a late backend.
    sys.setswitchinterval(1.0)
    connection = socket.socket(fileno=int(sys.argv[1]))
    with connection.makefile("rb") as lines:
        job = decode_job(lines.readline())
        worker = Worker(connection)
        worker.run(job)
    if worker.hung:
        os._exit(0)
