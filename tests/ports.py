"""Ports that nobody else has, also between two lives of what listens on them."""

from __future__ import annotations

import atexit
import contextlib
import functools

from nros_conformance.play.leases import lease_ports

_held = contextlib.ExitStack()


@functools.cache
def leased_ports() -> range:
    """Those of this test process. One that the kernel chooses may be taken as soon as it is free for a moment."""
    atexit.register(_held.close)
    return _held.enter_context(lease_ports())
