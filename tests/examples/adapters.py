"""Backends on which the examples have to fall back, or fail. Each is named after its defect."""

from __future__ import annotations

from nros_backends.reference import ReferenceBackend
from nros_backends.reference.backend import ReferencePublisher, ReferenceSession, ReferenceSubscription
from nros_conformance.rmw.backend import SessionOptions
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import EventCallback
from nros_conformance.rmw.qos import QosProfile


class RefusesEveryEvent(ReferenceBackend):
    """As a backend whose event slots are NULL."""

    def create_session(self, options: SessionOptions) -> ReferenceSession:
        return _RefusingSession(self, options)


class RefusesManualLiveliness(ReferenceBackend):
    """Reports events, but a publisher cannot fall silent without leaving."""

    def create_session(self, options: SessionOptions) -> ReferenceSession:
        return _AutomaticSession(self, options)


class NeverFires(ReferenceBackend):
    """Claims and accepts everything, and reports nothing."""

    def create_session(self, options: SessionOptions) -> ReferenceSession:
        return _SilentSession(self, options)


class FiresTwice(ReferenceBackend):
    """Tells every event again."""

    def create_session(self, options: SessionOptions) -> ReferenceSession:
        return _RepeatingSession(self, options)


class LosesEverything(ReferenceBackend):
    """A publisher that accepts samples and sends none."""

    def create_session(self, options: SessionOptions) -> ReferenceSession:
        return _DeadSession(self, options)


class _RefusingSubscription(ReferenceSubscription):
    def supports_event(self, kind: int) -> bool:
        return False

    def register_event(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        return ReturnCode.UNSUPPORTED


class _RefusingSession(ReferenceSession):
    subscription_type = _RefusingSubscription


class _AutomaticSession(ReferenceSession):
    def create_publisher(self, topic: str, type_name: str, qos: QosProfile) -> ReferencePublisher:
        if qos.liveliness.is_manual:
            raise RmwError(ReturnCode.INCOMPATIBLE_QOS, "only AUTOMATIC")
        return super().create_publisher(topic, type_name, qos)


class _SilentSubscription(ReferenceSubscription):
    def register_event(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        return ReturnCode.OK


class _SilentSession(ReferenceSession):
    subscription_type = _SilentSubscription


class _RepeatingSubscription(ReferenceSubscription):
    def register_event(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        assert callback is not None
        return super().register_event(
            kind, deadline_ms, lambda *event: (callback(*event), callback(*event))[0], context
        )  # fmt: skip


class _RepeatingSession(ReferenceSession):
    subscription_type = _RepeatingSubscription


class _DeadPublisher(ReferencePublisher):
    def publish_raw(self, data: bytes) -> int:
        return ReturnCode.OK


class _DeadSession(ReferenceSession):
    publisher_type = _DeadPublisher
