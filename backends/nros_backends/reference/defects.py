"""Defective variants of the reference, one defect each, named after it."""

from __future__ import annotations

from nros_backends.reference.backend import ReferenceBackend, ReferenceSession
from nros_conformance.rmw.backend import SessionOptions
from nros_conformance.rmw.clock import MS

_LAG = 250 * MS
"""More than the judge's late tolerance at the scale that the control plays at, T = 130 ms."""


class _LateSession(ReferenceSession):
    """Reports everything that occurred, but only `_LAG` afterwards."""

    def poll(self) -> bool:
        now = self.clock.now_ns()
        with self.backend.lock:
            self.backend.advance()
            for entity in self.entities:
                ready = [source.ready_ns for source in entity.sources.values() if source.ready_ns is not None]
                if ready and max(ready) + _LAG <= now:
                    entity.registry.poll()
        return len(self.queue) > 0

    def next_due_ns(self) -> int:
        return self.clock.now_ns() + 10 * MS


class FiresLate(ReferenceBackend):
    """Every event comes 250 ms after it was due (D-RDM-08)."""

    def create_session(self, options: SessionOptions) -> ReferenceSession:
        return _LateSession(self, options)
