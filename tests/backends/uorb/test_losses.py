from __future__ import annotations

from itertools import cycle
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nros_backends.uorb import UorbBackend
from nros_backends.uorb.bus import Bus, Metadata
from nros_conformance.rmw.backend import Host, Session, SessionOptions
from nros_conformance.rmw.clock import VirtualClock
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import CountStatus
from nros_conformance.rmw.qos import DEFAULT, QosProfile

if TYPE_CHECKING:
    from tests.backends.uorb.conftest import MakeTalk, Talk


@pytest.mark.parametrize("depth", [1, 4, 10, 128])
@pytest.mark.parametrize("excess", [1, 5, 31, 100])
def test_received_plus_lost_is_sent(make_talk: MakeTalk, depth: int, excess: int) -> None:
    talk = make_talk(depth)
    talk.publish(depth + excess)
    talk.drive()
    assert talk.losses == [CountStatus(excess, excess)]  # one callback, before anything is taken
    assert talk.take() == list(range(excess, talk.sent))
    talk.drive()
    assert talk.lost == excess


@pytest.mark.parametrize("depth", [1, 10, 128])
def test_a_full_queue_is_no_loss(make_talk: MakeTalk, depth: int) -> None:
    talk = make_talk(depth)
    for _ in range(3):
        talk.publish(depth)
        talk.drive()
        assert len(talk.take()) == depth
    assert talk.losses == []


def test_overflow_is_reported_by_the_next_drive_even_if_nothing_follows(talk: Talk) -> None:
    talk.publish(17)
    assert talk.losses == []
    talk.drive()
    assert talk.losses == [CountStatus(7, 7)]
    talk.drive()
    assert len(talk.losses) == 1


def test_losses_add_up_over_gaps_and_drives(talk: Talk) -> None:
    for _ in range(30):
        talk.publish(12)
        talk.take()
    talk.drive()
    assert talk.losses == [CountStatus(60, 60)]
    talk.publish(12)
    talk.take(3)
    talk.publish(12)
    talk.drive()
    assert talk.losses[1:] == [CountStatus(71, 11)]


def test_two_publishers_share_the_queue_and_make_no_false_gap(session: Session, talk: Talk) -> None:
    other = session.create_publisher("/sensor", "Sample", DEFAULT)
    talk.publish(40)
    talk.take()
    lost = talk.sent - 10
    for _ in range(50):
        talk.publish(4, other)
        talk.publish(6)
        assert talk.take() == list(range(talk.sent - 10, talk.sent))
    talk.drive()
    assert talk.lost == lost == 30


def test_each_subscription_has_its_own_depth_and_losses(session: Session, make_talk: MakeTalk) -> None:
    deep, shallow = make_talk(100), make_talk(3)
    deep.publish(60)
    shallow.publish(60)
    session.drive_io(0)
    assert (deep.lost, shallow.lost) == (20, 117)
    assert (len(deep.take()), len(shallow.take())) == (100, 3)


@pytest.mark.parametrize("depth", [1, 5, 10, 16])
def test_nothing_is_lost_and_the_order_kept_across_the_wrap(
    backend: UorbBackend, make_talk: MakeTalk, depth: int
) -> None:
    talk = make_talk(depth)
    assert backend.preset(talk.subscription, 2**32 - 3) == ReturnCode.OK
    for start in range(10):
        talk.publish(1)
        assert talk.take() == [start]
    talk.drive()
    assert talk.losses == []


@pytest.mark.parametrize("back", [1, 3, 8, 20])
def test_overflow_across_the_wrap_counts_the_true_difference(
    backend: UorbBackend, make_talk: MakeTalk, back: int
) -> None:
    talk = make_talk(10)
    talk.publish(4)
    assert backend.preset(talk.publisher, 2**32 - back) == ReturnCode.OK
    talk.publish(11)
    talk.drive()
    assert talk.losses == [CountStatus(5, 5)]
    assert talk.take() == list(range(5, 15))


def test_a_late_subscription_finds_one_sample_which_is_history(session: Session, make_talk: MakeTalk) -> None:
    early = make_talk()
    early.publish(5)
    late = make_talk()
    assert late.take() == [4]
    late.drive()
    assert late.losses == []


@pytest.mark.parametrize(("sent", "lost"), [(1, 0), (2, 1), (6, 5)])
def test_history_that_is_overwritten_is_not_lost(make_talk: MakeTalk, sent: int, lost: int) -> None:
    make_talk(topic="/latched").publish(5)
    late = make_talk(depth=1, topic="/latched")
    late.publish(sent)
    late.drive()
    assert late.lost == lost
    assert late.take() == [sent - 1]


def test_after_history_has_been_taken_every_overwritten_sample_is_lost(make_talk: MakeTalk) -> None:
    make_talk(topic="/latched").publish(5)
    late = make_talk(depth=2, topic="/latched")
    assert late.take() == [4]
    late.publish(5)
    late.drive()
    assert late.lost == 3


def test_a_new_publisher_after_the_old_one_is_no_loss(session: Session, make_talk: MakeTalk) -> None:
    first = make_talk(topic="/again")
    first.publish(3)
    first.publisher.destroy()
    second = make_talk(topic="/again")
    second.take()
    second.publish(1)
    assert second.take() == [0]
    session.drive_io(0)
    assert first.losses == second.losses == []


def test_a_destroyed_publisher_hides_nothing(session: Session, talk: Talk) -> None:
    other = session.create_publisher("/sensor", "Sample", DEFAULT)
    talk.publish(3)
    talk.publish(3, other)
    other.destroy()
    assert talk.take(2) == [0, 1]
    talk.publisher.destroy()
    assert talk.take() == [2, 3, 4, 5]
    talk.drive()
    assert talk.losses == []


def test_a_sample_too_large_for_the_buffer_is_dropped_and_counted(talk: Talk) -> None:
    talk.publisher.publish_raw(bytes(64))
    talk.publisher.publish_raw(bytes(8))
    assert talk.subscription.try_recv_raw(16) == ReturnCode.BUFFER_TOO_SMALL
    assert talk.subscription.try_recv_raw(16) == bytes(8)
    assert talk.subscription.try_recv_raw(16) == ReturnCode.NO_DATA
    talk.drive()
    assert talk.losses == [CountStatus(1, 1)]


def test_history_too_large_for_the_buffer_is_dropped_and_not_counted(make_talk: MakeTalk) -> None:
    make_talk().publish(1)
    late = make_talk()
    assert late.subscription.try_recv_raw(3) == ReturnCode.BUFFER_TOO_SMALL
    late.drive()
    assert late.losses == []


def test_losses_before_the_registration_are_in_the_first_change(session: Session) -> None:
    publisher = session.create_publisher("/sensor", "Sample", DEFAULT)
    subscription = session.create_subscription("/sensor", "Sample", DEFAULT)
    for _ in range(15):
        publisher.publish_raw(b"")
    seen: list[Any] = []
    subscription.register_event(2, 0, lambda kind, status, context: seen.append(status), None)
    session.drive_io(0)
    assert seen == [CountStatus(5, 5)]


@given(
    queue=st.sampled_from([1, 2, 4, 16]),
    start=st.sampled_from([0, 2**32 - 1, 2**32 - 30]),
    steps=st.lists(st.tuples(st.integers(0, 40), st.integers(0, 40)), max_size=12),
)
def test_counted_at_publication_or_at_the_take_the_total_is_the_same(
    queue: int, start: int, steps: list[tuple[int, int]]
) -> None:
    bus = Bus()
    bus.define(Metadata("t", 1, queue))
    node, lazy = bus.advertise("t"), bus.subscribe("t")
    assert lazy is not None
    backend = UorbBackend(Host(VirtualClock()))
    session = backend.create_session(SessionOptions())
    publisher = session.create_publisher("t", "T", DEFAULT)
    eager = session.create_subscription("t", "T", QosProfile(depth=queue))
    seen: list[Any] = []
    eager.register_event(2, 0, lambda kind, status, context: seen.append(status), None)
    node.preset(start)
    backend.preset(eager, start)
    numbers = cycle(range(256))
    jumped = sent = received = 0
    for published, taken in [*steps, (0, 500)]:
        for _ in range(published):
            sample = bytes([next(numbers)])
            node.publish(sample)
            publisher.publish_raw(sample)
            sent += 1
        for _ in range(taken):
            unread, before = lazy.unread, lazy.last
            wanted = lazy.update()
            jumped += (lazy.last - before - 1) % 2**32 if unread else 0
            got = eager.try_recv_raw(1)
            assert got == (ReturnCode.NO_DATA if wanted is None else wanted)
            received += wanted is not None
        session.drive_io(0)
    assert (seen[-1].total_count if seen else 0) == jumped == sent - received
