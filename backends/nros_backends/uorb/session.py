"""Sessions: entities on one bus, and the loop that dispatches for them."""

from __future__ import annotations

import random

from nros_backends.uorb.domain import Domain
from nros_backends.uorb.entities import Surroundings, UorbPublisher, UorbSubscription
from nros_backends.uorb.qos import in_force
from nros_conformance.rmw.backend import Publisher, Session, Subscription
from nros_conformance.rmw.clock import Clock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.driving import Driving
from nros_conformance.rmw.qos import QosProfile


class UorbSession(Session):
    """A PX4 module, so to say: it shares the bus with the others of its domain."""

    def __init__(self, domain: Domain, clock: Clock) -> None:
        self._here = Surroundings(domain, clock)
        self._clock = clock
        self._closed = False
        self._driving = Driving(clock)

    def create_publisher(self, topic: str, type_name: str, qos: QosProfile) -> Publisher:
        self._check_open()
        return UorbPublisher(self._here, topic, type_name, in_force(qos))

    def create_subscription(self, topic: str, type_name: str, qos: QosProfile) -> Subscription:
        self._check_open()
        return UorbSubscription(self._here, topic, type_name, in_force(qos))

    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        """Dispatch, waiting for something to dispatch or to take for at most ``timeout_ms``.

        A sample ends the waiting once, when it arrives, whether or not it is then taken. A negative
        timeout is none (C10). WOULD_BLOCK when this session is being driven already.
        """
        if self._closed:
            return ReturnCode.INVALID_ARGUMENT
        return self._driving.drive(timeout_ms, max_callbacks, self._drive)

    def ping(self, timeout_ms: int, attempts: int = 1) -> int:
        """UNSUPPORTED: there is no peer."""
        return ReturnCode.INVALID_ARGUMENT if self._closed else super().ping(timeout_ms, attempts)

    def destroy(self) -> int:
        self._closed = True
        for entity in tuple(self._here.entities):
            entity.destroy()
        self._here.wake.set()
        return ReturnCode.OK

    def _drive(self, until_ns: int, max_callbacks: int | None) -> None:
        while not self._closed:
            woken = self._here.wake.is_set()
            self._here.wake.clear()
            for entity in tuple(self._here.entities):
                if isinstance(entity, UorbSubscription):
                    entity.collect()
            if self._here.ready.drain(max_callbacks) or woken or self._clock.now_ns() >= until_ns:
                return
            self._clock.wait(self._here.wake, until_ns)

    def disturb(self, chance: random.Random, count: int) -> int:
        """Harness: see `Domain.disturb`. OK, or INVALID_ARGUMENT."""
        if self._closed:
            return ReturnCode.INVALID_ARGUMENT
        self._here.domain.disturb(chance, count)
        return ReturnCode.OK

    def _check_open(self) -> None:
        if self._closed:
            raise RmwError(ReturnCode.INVALID_ARGUMENT, "the session is destroyed")
