"""Adapters that break in one way each, on subscriptions whose depth is 4 and nowhere else."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
import time

from nros_backends.reference.backend import ReferenceBackend, ReferenceSession
from nros_conformance.rmw.backend import Host, SessionOptions


class Session(ReferenceSession):
    def breaks(self) -> None:
        raise AssertionError

    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        if any(entity.qos.depth == 4 for entity in self.entities):
            self.breaks()
        return super().drive_io(timeout_ms, max_callbacks)


class _Segfault(Session):
    def breaks(self) -> None:
        ctypes.string_at(0)


class _Exit(Session):
    def breaks(self) -> None:
        os._exit(7)


class _Sleep(Session):
    def breaks(self) -> None:
        time.sleep(3600)


class _HoldInterpreter(Session):
    def breaks(self) -> None:
        ctypes.PyDLL(None).sleep(3600)


class _Raise(Session):
    def breaks(self) -> None:
        raise ValueError("no such sample")


class _Spin(Session):
    def breaks(self) -> None:
        while True:
            pass


class Segfaults(ReferenceBackend):
    session: type[ReferenceSession] = _Segfault

    def create_session(self, options: SessionOptions) -> ReferenceSession:
        return self.session(self, options)


class Exits(Segfaults):
    session = _Exit


class Sleeps(Segfaults):
    session = _Sleep


class HoldsInterpreter(Segfaults):
    session = _HoldInterpreter


class Raises(Segfaults):
    session = _Raise


class SpinsForEver(Segfaults):
    session = _Spin


class DiesAtOnce(Segfaults):
    def __init__(self, host: Host) -> None:
        os._exit(3)


class Healthy(Segfaults):
    session = ReferenceSession


class SaysWhoCollects(Healthy):
    def __init__(self, host: Host) -> None:
        super().__init__(host)
        sys.stderr.write(f"garbage is {'' if gc.isenabled() else 'not '}collected\n")
        sys.stderr.flush()


class SaysWhereItIs(Healthy):
    def __init__(self, host: Host) -> None:
        super().__init__(host)
        sys.stderr.write(f"process {os.getpid()}\n")
        sys.stderr.flush()
