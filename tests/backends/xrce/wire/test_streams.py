from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nros_backends.xrce.streams import (
    MODULUS,
    BestEffortInput,
    BestEffortOutput,
    Packet,
    ReliableInput,
    ReliableOutput,
    later,
)
from nros_backends.xrce.wire import encode_body
from nros_backends.xrce.wire.ids import Kind, ObjectId
from nros_backends.xrce.wire.messages import Acknack, Heartbeat, WriteData

MS = 1_000_000
WRITER = ObjectId(1, Kind.DATAWRITER)


def sample(number: int, size: int = 0) -> bytes:
    data = number.to_bytes(4, "little") + bytes(size)
    return encode_body([WriteData(request=number % MODULUS, object=WRITER, data=data)])


def output(capacity: int = 508, window: int = 16, resend_all: bool = False) -> ReliableOutput:
    return ReliableOutput(0x80, capacity, window, 100 * MS, resend_all)


@given(st.integers(0, MODULUS - 1), st.integers(1, MODULUS // 2 - 1))
def test_a_number_is_later_than_those_of_the_half_range_before_it(one: int, ahead: int) -> None:
    assert later((one + ahead) % MODULUS, one)
    assert not later(one, (one + ahead) % MODULUS)
    assert not later(one, one)


@settings(max_examples=80, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    sizes=st.lists(st.sampled_from((0, 3, 40, 200)), min_size=1, max_size=40),
    resend_all=st.booleans(),
    window=st.sampled_from((4, 8, 16)),
)
def test_a_link_that_loses_repeats_and_reorders_still_delivers_in_order_and_once(
    seed: int, sizes: list[int], resend_all: bool, window: int
) -> None:
    sender, receiver = output(60, window, resend_all), ReliableInput(0x80)
    sent = [sample(number, size) for number, size in enumerate(sizes)]
    assert carry(sender, receiver, sent, random.Random(seed)) == sent
    assert receiver.lost == 0


def test_nothing_is_lost_where_sequence_numbers_wrap() -> None:
    sender, receiver = output(), ReliableInput(0x80)
    for _ in range(MODULUS - 20):
        sender.push(b"")
        (packet,) = sender.take(0)
        receiver.receive(packet.sequence, packet.body)
        sender.acknack(receiver.acknack().first_unacked, 0, 0)
    sent = [sample(number) for number in range(40)]
    assert carry(sender, receiver, sent, random.Random(1)) == sent
    assert receiver.acknack().first_unacked == 20


def carry(sender: ReliableOutput, receiver: ReliableInput, bodies: list[bytes], chance: random.Random) -> list[bytes]:
    """What comes out of a link that loses a fifth, repeats a tenth and reorders everything."""
    for body in bodies:
        sender.push(body)
    link: list[Packet | Heartbeat | Acknack] = []
    got: list[bytes] = []
    now = 0
    for _ in range(50_000):
        if sender.settled:
            return got
        link += sender.take(now)
        heartbeat = sender.heartbeat(now)
        if heartbeat is not None:
            link.append(heartbeat)
        if not link:
            now = sender.wakeup_ns or now
            continue
        item = link.pop(chance.randrange(len(link)))
        now += MS
        if chance.random() < 0.1:
            link.append(item)
        if chance.random() < 0.2:
            continue
        match item:
            case Packet(sequence=sequence, body=body):
                got += receiver.receive(sequence, body)
                link.append(receiver.acknack())
            case Heartbeat(first=first, last=last):
                got += receiver.heartbeat(first, last)
                link.append(receiver.acknack())
            case Acknack(first_unacked=first, missing=missing):
                sender.acknack(first, missing, now)
    raise AssertionError("the streams never settle")


def test_no_more_than_the_window_is_sent_before_an_acknowledgement() -> None:
    sender = output(window=4)
    for number in range(6):
        sender.push(sample(number))
    assert [packet.sequence for packet in sender.take(0)] == [0, 1, 2, 3]
    assert sender.free == 0
    assert sender.take(0) == []
    sender.acknack(2, 0, 0)
    assert [packet.sequence for packet in sender.take(0)] == [4, 5]


def test_only_what_is_missing_is_sent_again() -> None:
    sender = output()
    for number in range(4):
        sender.push(sample(number))
    sender.take(0)
    sender.acknack(1, 0b101, 0)
    assert [packet.sequence for packet in sender.take(0)] == [1, 3]
    assert sender.take(0) == []


def test_a_sender_that_resends_all_does_so_for_any_bit() -> None:
    sender = output(resend_all=True)
    for number in range(4):
        sender.push(sample(number))
    sender.take(0)
    sender.acknack(1, 0b100, 0)
    assert [packet.sequence for packet in sender.take(0)] == [1, 2, 3]


def test_an_acknowledgement_of_what_was_never_sent_is_ignored() -> None:
    sender = output()
    sender.push(sample(0))
    sender.take(0)
    sender.acknack(2, 0xFFFF, 0)
    assert sender.announce() == Heartbeat(first=0, last=0, stream=0x80)
    assert sender.take(0) == []


def test_a_heartbeat_is_due_one_period_after_the_sending_and_again() -> None:
    sender = output()
    sender.push(sample(0))
    sender.take(5 * MS)
    assert sender.wakeup_ns == 105 * MS
    due = [now for now in range(200) if sender.heartbeat(now * MS) is not None]
    assert due == [105]
    assert sender.heartbeat(205 * MS) == Heartbeat(first=0, last=0, stream=0x80)


def test_no_heartbeat_is_due_once_everything_is_acknowledged() -> None:
    sender = output()
    sender.push(sample(0))
    sender.take(5 * MS)
    sender.acknack(1, 0, 110 * MS)
    assert sender.wakeup_ns is None
    assert sender.settled


def test_what_is_larger_than_a_message_goes_in_fragments_of_the_recorded_size() -> None:
    sender, receiver = output(508 - 4), ReliableInput(0x80)
    body = sample(1, 2001)
    sender.push(body)
    packets = sender.take(0)
    assert [len(packet.body) - 4 for packet in packets] == [500, 500, 500, 500, 13]
    assert [packet.body[1] for packet in packets] == [1, 1, 1, 1, 3]
    got = [body for packet in packets for body in receiver.receive(packet.sequence, packet.body)]
    assert got == [body]


def test_a_stream_without_room_for_a_fragment_is_refused() -> None:
    with pytest.raises(ValueError, match="4 octets hold no fragment"):
        output(4)


def test_what_is_outside_the_window_is_neither_kept_nor_asked_for() -> None:
    receiver = ReliableInput(0x80)
    assert receiver.receive(16, sample(16)) == []
    assert receiver.acknack() == Acknack(first_unacked=0, missing=0, stream=0x80)


def test_what_the_sender_no_longer_has_is_given_up_and_counted() -> None:
    receiver = ReliableInput(0x80)
    receiver.receive(2, sample(2))
    assert receiver.heartbeat(5, 6) == [sample(2)]
    assert receiver.lost == 4
    assert receiver.acknack() == Acknack(first_unacked=5, missing=0b11, stream=0x80)


def test_fragments_with_a_gap_are_thrown_away_and_the_next_sample_is_whole() -> None:
    sender, receiver = output(64), ReliableInput(0x80)
    for number in range(2):
        sender.push(sample(number, 120))
    packets = sender.take(0)
    assert len(packets) == 6
    got = receiver.receive(packets[0].sequence, packets[0].body)
    got += receiver.heartbeat(2, packets[-1].sequence)
    for packet in packets[2:]:
        got += receiver.receive(packet.sequence, packet.body)
    assert got == [sample(1, 120)]
    assert receiver.lost == 1


def test_after_a_gap_no_fragment_is_taken_for_a_first_one() -> None:
    sender, receiver = output(64), ReliableInput(0x80)
    sender.push(sample(0, 120))
    sender.push(sample(1))
    packets = sender.take(0)
    got = receiver.heartbeat(1, packets[-1].sequence)
    for packet in packets[1:]:
        got += receiver.receive(packet.sequence, packet.body)
    assert got == [sample(1)]


def test_fragments_without_end_are_not_stored_without_end() -> None:
    sender, receiver = output(64), ReliableInput(0x80, largest=200)
    sender.push(sample(0, 1000))
    sender.push(sample(1, 100))
    got = []
    for packet in iter_all(sender):
        got += receiver.receive(packet.sequence, packet.body)
    assert got == [sample(1, 100)]


def iter_all(sender: ReliableOutput) -> list[Packet]:
    packets: list[Packet] = []
    while not sender.settled:
        packets += sender.take(0)
        sender.acknack((packets[-1].sequence + 1) % MODULUS, 0, 0)
    return packets


def test_best_effort_drops_what_is_old_and_counts_what_is_missing() -> None:
    receiver = BestEffortInput(0x01)
    assert [receiver.receive(sequence) for sequence in (0, 5, 3, 5, 6)] == [True, True, False, False, True]
    assert receiver.lost == 4


def test_best_effort_numbers_wrap() -> None:
    sender, receiver = BestEffortOutput(0x01), BestEffortInput(0x01)
    for _ in range(MODULUS + 3):
        assert receiver.receive(sender.send(b"").sequence)
    assert sender.send(b"").sequence == 3
    assert receiver.lost == 0


def test_a_reset_takes_both_ends_of_both_kinds_back_to_zero() -> None:
    sender, receiver = output(), ReliableInput(0x80)
    sender.push(sample(0))
    (packet,) = sender.take(0)
    receiver.receive(packet.sequence, packet.body)
    sender.reset()
    receiver.reset()
    assert sender.settled
    assert sender.wakeup_ns is None
    sender.push(sample(1))
    assert [one.sequence for one in sender.take(0)] == [0]
    assert receiver.acknack() == Acknack(first_unacked=0, missing=0, stream=0x80)
    best = BestEffortOutput(0x01)
    best.send(b"")
    best.reset()
    assert best.send(b"").sequence == 0
    incoming = BestEffortInput(0x01)
    incoming.receive(7)
    incoming.reset()
    assert incoming.receive(0)
