"""What the reference adds to the model: faults, capacity, announcements of messages."""

from __future__ import annotations

import pytest

from nros_backends.reference import ReferenceBackend
from nros_conformance.rmw.backend import Host, SessionOptions
from nros_conformance.rmw.clock import VirtualClock
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import CountStatus, EventKind, EventStatus, LivelinessChangedStatus
from nros_conformance.rmw.qos import QosProfile

LOST = int(EventKind.MESSAGE_LOST)


class Talk:
    """A publisher, a subscription, and what was reported to it."""

    def __init__(self, depth: int = 10) -> None:
        self.backend = ReferenceBackend(Host(VirtualClock()))
        self.session = self.backend.create_session(SessionOptions())
        self.publisher = self.session.create_publisher("t", "T", QosProfile(depth=depth))
        self.subscription = self.session.create_subscription("t", "T", QosProfile(depth=depth))
        self.seen: list[EventStatus] = []
        self.watch(EventKind.MESSAGE_LOST)

    def watch(self, kind: EventKind) -> None:
        code = self.subscription.register_event(int(kind), 0, lambda _kind, status, _: self.seen.append(status), None)
        assert code == ReturnCode.OK

    def publish(self, count: int = 1) -> None:
        for number in range(count):
            assert self.publisher.publish_raw(bytes([number])) == ReturnCode.OK

    def drive(self) -> list[EventStatus]:
        self.seen.clear()
        assert self.session.drive_io(0) == ReturnCode.OK
        return list(self.seen)


def test_a_lost_sample_shows_with_the_next_one_and_is_not_announced() -> None:
    talk, announced = Talk(), []
    talk.subscription.set_message_callback(lambda _: announced.append(talk.subscription.try_recv_raw(99)), None)
    talk.publish()
    send = lambda: talk.publisher.publish_raw(b"lost")  # noqa: E731
    assert talk.backend.inject("lose", entity=talk.publisher, count=3, publish=send) == ReturnCode.OK
    assert talk.drive() == []
    talk.publish()
    assert talk.drive() == [CountStatus(3, 3)]
    assert announced == [b"\0", b"\0"]


def test_numbers_wrap_and_totals_saturate() -> None:
    talk = Talk(depth=4)
    assert talk.backend.inject("preset", entity=talk.publisher, count=2**32 - 2, kind=None) == ReturnCode.OK
    assert talk.backend.inject("preset", entity=talk.subscription, count=2**32 - 3, kind=LOST) == ReturnCode.OK
    talk.publish(4)
    assert talk.drive() == []
    talk.publish(6)
    assert talk.drive() == [CountStatus(2**32 - 1, 6)]


def test_alive_count_saturates_and_one_who_comes_still_shows() -> None:
    talk = Talk()
    talk.watch(EventKind.LIVELINESS_CHANGED)
    talk.drive()
    kind = int(EventKind.LIVELINESS_CHANGED)
    assert talk.backend.inject("preset", entity=talk.subscription, count=2**16 - 1, kind=kind) == ReturnCode.OK
    talk.session.create_publisher("t", "T", QosProfile())
    assert talk.drive() == [LivelinessChangedStatus(2**16 - 1, 0, 1, 0)]


@pytest.mark.parametrize("fault", ["partition", "duplicate", "lose"])
def test_other_faults_are_refused(fault: str) -> None:
    talk = Talk()
    assert talk.backend.inject(fault, entity=talk.subscription, count=1) == ReturnCode.UNSUPPORTED


def test_a_sample_beyond_the_capacity_is_refused() -> None:
    talk = Talk()
    assert talk.publisher.publish_raw(bytes(2**20)) == ReturnCode.OK
    assert talk.publisher.publish_raw(bytes(2**20 + 1)) == ReturnCode.MESSAGE_TOO_LARGE


def test_a_sample_that_was_pushed_out_is_not_announced_in_the_place_of_a_later_one() -> None:
    talk, order = Talk(depth=1), []
    talk.subscription.set_message_callback(lambda _: order.append("message"), None)
    talk.publish(3)  # two of them are lost
    for _ in range(4):
        before = len(talk.seen) + len(order)
        talk.session.drive_io(0, 1)
        assert len(talk.seen) + len(order) - before <= 1
    assert (talk.seen, order) == ([CountStatus(2, 2)], ["message"])
