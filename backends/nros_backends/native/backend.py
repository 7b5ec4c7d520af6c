"""The adapter of compiled backends: a shared library that fills the nano-ros vtable, unmodified.

What it decides, where the boundary leaves something open:

- **Support** is derived: C has no ``supports_event``. The survey registers each kind on a throw-away
  entity; what it answers there is what `supports_event` says here.
- **Destroyed handles** answer INVALID_ARGUMENT without a call: in C their memory is gone, and the
  runtime's types forbid it.
- **Domains and nodes.** Scenarios that are played together get domains of their own, two each, from
  ``--domain`` on, and nodes of their own: a client may be known to its agent by its node's name alone.
- **Release.** Callback and context are let go when their entity is destroyed or their registration
  replaced, by the adapter: C has no unregister. A library that calls later still is told of (`callbacks`).
- **Locks.** Every call gives the GIL away, so that a callback on whatever thread gets it.
"""

from __future__ import annotations

import dataclasses
import hashlib
import weakref
from collections import deque
from collections.abc import Mapping
from pathlib import Path

from nros_backends.native.callbacks import Registration
from nros_backends.native.library import load
from nros_backends.native.options import Options
from nros_backends.native.session import NativeSession
from nros_conformance.rmw.backend import Backend, Host, Session, SessionOptions

DOMAINS = 2
"""Of each scenario: its own and its neighbour."""
REMEMBERED = 512
"""Released registrations of a play whose late calls are told as theirs; each takes about half a kilobyte."""


class NativeBackend(Backend):
    """A compiled backend; ``host.options`` says which (`Options`)."""

    def __init__(self, host: Host) -> None:
        super().__init__(host)
        self._options = Options.read(host.options)
        self._sessions: weakref.WeakSet[NativeSession] = weakref.WeakSet()
        self._released: deque[Registration] = deque(maxlen=REMEMBERED)

    def create_session(self, options: SessionOptions) -> Session:
        """Raises `RmwError`; `LibraryError` when the library does not load any more."""
        domain = self._options.domain + DOMAINS * self.host.network + options.domain_id
        options = dataclasses.replace(options, node_name=f"{options.node_name}_{self.host.network}")
        session = NativeSession(load(self._options), options, domain, self._released)
        self._sessions.add(session)
        return session

    def close(self) -> None:
        for session in tuple(self._sessions):
            session.destroy()
        self._sessions.clear()
        self._released.clear()

    def versions(self) -> Mapping[str, str]:
        """The file, by its content."""
        file = Path(self._options.library)
        return {file.name: hashlib.sha256(file.read_bytes()).hexdigest()[:12]}
