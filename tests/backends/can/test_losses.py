from __future__ import annotations

import pytest

from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import History, Liveliness
from tests.backends.can.conftest import Bench, publisher, subscription, take
from tests.backends.log import Log

COUNTS = [1, 5, 31, 100]


@pytest.mark.parametrize("count", COUNTS)
def test_lost_samples_are_counted_exactly(either: Bench, count: int) -> None:
    talker, listener = publisher(either.session()), subscription(either.session(), depth=500)
    log = Log().watch(listener, EventKind.MESSAGE_LOST)
    either.run()
    talker.publish_raw(b"head" * 20)
    publish = lambda: talker.publish_raw(b"lost" * 20)  # noqa: E731
    assert either.backend.inject("lose", entity=talker, count=count, publish=publish) == ReturnCode.OK
    talker.publish_raw(b"tail" * 20)
    either.run(3)
    assert take(listener) == [b"head" * 20, b"tail" * 20]
    assert log.total == count


@pytest.mark.parametrize("count", [*COUNTS, 32, 33, 64])
def test_samples_and_counts_lost_together_add_up_after_the_next_count(bench: Bench, count: int) -> None:
    session = bench.session()
    talker, listener = publisher(session), subscription(bench.session(), depth=500)
    log = Log().watch(listener, EventKind.MESSAGE_LOST)
    bench.run()
    talker.publish_raw(b"head")
    bench.run()
    bench.backend.inject("block", session=session, direction="out")
    for _ in range(count):
        talker.publish_raw(b"lost")
    bench.backend.inject("heal", session=session)
    talker.publish_raw(b"tail")
    bench.run(250)
    assert len(take(listener)) + log.total == count + 2


def test_samples_lost_without_a_successor_show_with_the_count(bench: Bench) -> None:
    talker, listener = publisher(bench.session()), subscription(bench.session())
    log = Log().watch(listener, EventKind.MESSAGE_LOST)
    bench.run()
    talker.publish_raw(b"head")
    bench.backend.inject("lose", entity=talker, count=3, publish=lambda: talker.publish_raw(b"lost"))
    bench.run(202)
    assert log.total == 3


def test_the_gap_of_one_publisher_is_none_of_the_other(bench: Bench) -> None:
    left, right = publisher(bench.session()), publisher(bench.session())
    listener = subscription(bench.session(), history=History.KEEP_ALL)
    log = Log().watch(listener, EventKind.MESSAGE_LOST)
    bench.run()
    for number in range(20):
        left.publish_raw(b"left")
        right.publish_raw(b"right")
        if number == 10:
            bench.backend.inject("lose", entity=right, count=7, publish=lambda: right.publish_raw(b"lost"))
        bench.run(1)
    assert (len(take(listener)), log.total) == (40, 7)


def test_what_was_sent_before_the_first_sample_is_not_lost(bench: Bench) -> None:
    talker = publisher(bench.session())
    session = bench.session()
    bench.run()
    for _ in range(50):
        talker.publish_raw(b"before")
    bench.clock.wait(None, bench.clock.now_ns() + 1)
    listener = subscription(session)
    log = Log().watch(listener, EventKind.MESSAGE_LOST)
    bench.run(3)
    talker.publish_raw(b"first")
    bench.run(300)
    assert take(listener) == [b"first"]
    assert log.total == 0


def test_overflow_is_reported_by_itself(bench: Bench) -> None:
    talker, listener = publisher(bench.session()), subscription(bench.session(), depth=4)
    log = Log().watch(listener, EventKind.MESSAGE_LOST)
    bench.run()
    for number in range(20):
        talker.publish_raw(bytes((number,)))
    bench.run()
    assert log.total == 16
    assert take(listener) == [bytes((number,)) for number in range(16, 20)]


def test_duplicates_come_once(either: Bench) -> None:
    talker, listener = publisher(either.session()), subscription(either.session(), depth=50)
    log = Log().watch(listener, EventKind.MESSAGE_LOST)
    either.run()
    publish = lambda: talker.publish_raw(b"twice" * 9)  # noqa: E731
    assert either.backend.inject("duplicate", entity=talker, count=5, publish=publish) == ReturnCode.OK
    either.run()
    assert (take(listener), log.total) == ([b"twice" * 9] * 5, 0)


@pytest.mark.parametrize("count", [2**32 - 3, 2**32 - 20, 1_000])
def test_numbers_wrap_without_a_loss_and_with_one(bench: Bench, count: int) -> None:
    talker, listener = publisher(bench.session()), subscription(bench.session(), depth=50)
    log = Log().watch(listener, EventKind.MESSAGE_LOST)
    bench.run()
    talker.publish_raw(b"head")
    assert bench.backend.inject("preset", entity=talker, count=count, kind=None) == ReturnCode.OK
    for _ in range(30):
        talker.publish_raw(b"x")
    bench.run(300)
    assert (len(take(listener)), log.total) == (31, 0)
    bench.backend.inject("preset", entity=talker, count=2**32 - 2, kind=None)
    bench.backend.inject("lose", entity=talker, count=7, publish=lambda: talker.publish_raw(b"lost"))
    talker.publish_raw(b"tail")
    bench.run()
    assert log.total == 7


def test_a_publisher_that_comes_back_loses_nothing(bench: Bench) -> None:
    session = bench.session()
    listener = subscription(bench.session(), depth=100)
    log = Log().watch(listener, EventKind.MESSAGE_LOST)
    for _ in range(3):
        talker = publisher(session)
        bench.run()
        for _ in range(9):
            talker.publish_raw(b"x")
        bench.run()
        talker.destroy()
        bench.run()
    assert (len(take(listener)), log.total) == (27, 0)


def test_a_preset_total_goes_on_from_there(bench: Bench) -> None:
    talker, listener = publisher(bench.session()), subscription(bench.session(), depth=1)
    log = Log().watch(listener, EventKind.MESSAGE_LOST)
    bench.run()
    assert bench.backend.inject("preset", entity=listener, count=2**32 - 2, kind=2) == ReturnCode.OK
    for _ in range(6):
        talker.publish_raw(b"x")
    bench.run()
    assert log.statuses == [(2**32 - 1, 5)]
    assert bench.backend.inject("preset", entity=listener, count=1, kind=3) == ReturnCode.UNSUPPORTED
    assert bench.backend.inject("preset", entity=listener, count=1, kind=None) == ReturnCode.UNSUPPORTED


def test_what_a_publisher_lost_last_is_counted_when_it_goes(bench: Bench) -> None:
    talker, listener = publisher(bench.session()), subscription(bench.session())
    log = Log().watch(listener, EventKind.MESSAGE_LOST)
    bench.run()
    talker.publish_raw(b"head")
    bench.backend.inject("lose", entity=talker, count=3, publish=lambda: talker.publish_raw(b"lost"))
    talker.destroy()
    bench.run()
    assert log.total == 3


def test_a_subject_that_changes_its_topic_costs_the_old_one_nothing(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    from nros_backends.can import herald

    monkeypatch.setattr(herald, "SUBJECT_MAX", 0)
    session, ear = bench.session(), bench.session()
    old, new = subscription(ear, "old"), subscription(ear, "new")
    first = publisher(session, "old")
    bench.run()
    first.publish_raw(b"old")
    first.destroy()
    second = publisher(session, "new")
    bench.run()
    assert second.outlet.subject == first.outlet.subject
    second.publish_raw(b"new")
    bench.backend.inject("lose", entity=second, count=3, publish=lambda: second.publish_raw(b"lost"))
    second.publish_raw(b"tail")
    bench.run(300)
    assert (take(old), take(new)) == ([b"old"], [b"new", b"tail"])
    assert (old.losses.total, new.losses.total) == (0, 3)
    with pytest.raises(RmwError, match="no subject is free") as raised:
        publisher(session, "third")
    assert raised.value.code is ReturnCode.BAD_ALLOC


def test_a_session_that_nobody_drives_does_not_grow(bench: Bench) -> None:
    session = bench.session(driven=False)
    talker = publisher(session, liveliness=Liveliness.MANUAL_BY_TOPIC, lease_ms=1_000)
    before = len(session.herald.said)
    for _ in range(100):
        talker.publish_raw(b"x")
        talker.assert_liveliness()
    assert len(session.herald.said) == before
