"""Adapters that break in one way each when a subscription is created while another one has an unread sample."""

from __future__ import annotations

import ctypes
import time

from nros_backends.reference.backend import ReferenceBackend, ReferenceSession, ReferenceSubscription
from nros_conformance.rmw.backend import SessionOptions
from nros_conformance.rmw.qos import QosProfile


class Session(ReferenceSession):
    def breaks(self) -> None:
        raise AssertionError

    def create_subscription(self, topic: str, type_name: str, qos: QosProfile) -> ReferenceSubscription:
        if any(isinstance(one, ReferenceSubscription) and one.has_data() is True for one in self.entities):
            self.breaks()
        return super().create_subscription(topic, type_name, qos)


class _Segfault(Session):
    def breaks(self) -> None:
        ctypes.string_at(0)


class _Sleep(Session):
    def breaks(self) -> None:
        time.sleep(3600)


class _Raise(Session):
    def breaks(self) -> None:
        raise ValueError("a sample is left")


class Segfaults(ReferenceBackend):
    session: type[ReferenceSession] = _Segfault

    def create_session(self, options: SessionOptions) -> ReferenceSession:
        return self.session(self, options)


class Sleeps(Segfaults):
    session = _Sleep


class Raises(Segfaults):
    session = _Raise
