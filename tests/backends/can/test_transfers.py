from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nros_backends.can.frames import segment
from nros_backends.can.transfers import NUMBERS, TRANSFER_ID_TIMEOUT_NS, Assembly, Numbering

FRAMES = segment(bytes(range(30)), 5, 8)
NEXT = segment(b"later", 6, 8)


def received(frames: list[bytes], limit: int = 1_000) -> list[bytes]:
    assembly = Assembly(limit)
    return [transfer.payload for frame in frames if (transfer := assembly.frame(frame)) is not None]


@pytest.mark.parametrize("missing", range(len(FRAMES)))
def test_a_transfer_without_one_of_its_frames_does_not_come(missing: int) -> None:
    assert received([*FRAMES[:missing], *FRAMES[missing + 1 :], *NEXT]) == [b"later"]


@pytest.mark.parametrize("twice", range(len(FRAMES)))
def test_a_frame_that_comes_twice_counts_once(twice: int) -> None:
    assert received([*FRAMES[: twice + 1], *FRAMES[twice:], *NEXT]) == [bytes(range(30)), b"later"]


@pytest.mark.parametrize("broken", range(len(FRAMES)))
def test_a_flipped_bit_is_found(broken: int) -> None:
    frame = bytes((FRAMES[broken][0] ^ 4,)) + FRAMES[broken][1:]
    assert received([*FRAMES[:broken], frame, *FRAMES[broken + 1 :], *NEXT]) == [b"later"]


@pytest.mark.parametrize("frames", [[b""], [b"\xc0"], [b"data\x40"], [b"data\x20"], [b"\xa0", b"\x40"]])
def test_what_is_no_transfer_is_dropped(frames: list[bytes]) -> None:
    assert received([*frames, *NEXT]) == [b"later"]


def test_an_endless_transfer_ends_at_the_limit() -> None:
    assert received(segment(bytes(2_000), 0, 8), limit=1_000) == []
    assert len(received(segment(bytes(990), 0, 8), limit=1_000)[0]) == 990


@pytest.mark.parametrize("lost", [0, 1, 5, 30])
def test_up_to_thirty_lost_transfers_show_with_the_next(lost: int) -> None:
    numbering = Numbering(count=10)
    assert numbering.transfer(10, 0) == 0
    assert numbering.transfer((11 + lost) % 32, 0) == lost


@pytest.mark.parametrize("lost", [31, 32, 33, 62, 100, 2_744])
def test_more_lost_transfers_show_with_the_count(lost: int) -> None:
    numbering = Numbering(count=0)
    assert numbering.transfer(0, 0) == 0
    came = numbering.transfer((1 + lost) % 32, 0)
    sent = 1 + lost + 1
    received = 1 + (came is not None)
    assert (came or 0) + numbering.status(sent) == sent - received
    assert numbering.transfer(sent % 32, 0) == 0


def test_a_count_before_the_next_transfer_leaves_nothing_in_doubt() -> None:
    numbering = Numbering(count=0)
    assert numbering.status(100) == 100
    assert numbering.transfer(100 % 32, 0) == 0


def test_the_first_transfer_of_a_stranger_synchronises() -> None:
    numbering = Numbering()
    assert numbering.transfer(17, 0) == 0
    assert numbering.transfer(18, 0) == 0
    assert numbering.transfer(18, 1) is None
    assert numbering.transfer(18, TRANSFER_ID_TIMEOUT_NS) == 31


def test_a_repeated_transfer_of_one_who_counts_stays_a_repetition() -> None:
    numbering = Numbering(count=4)
    assert numbering.transfer(4, 0) == 0
    assert numbering.transfer(4, 10 * TRANSFER_ID_TIMEOUT_NS) is None


def test_numbers_wrap_without_loss() -> None:
    numbering = Numbering(count=NUMBERS - 2)
    for number in (NUMBERS - 2, NUMBERS - 1, 0, 1):
        assert numbering.transfer(number % 32, 0) == 0
    assert numbering.status(2) == 0
    assert numbering.status(NUMBERS - 1) == 0, "an old one"
    assert numbering.status(9) == 7


def test_another_number_is_no_loss_when_said() -> None:
    numbering = Numbering(count=3)
    numbering.rebase(1_000)
    assert numbering.transfer(1_000 % 32, 0) == 0


@given(st.lists(st.booleans(), max_size=400), st.integers(1, 30))
def test_received_and_lost_add_up_to_sent(arrivals: list[bool], every: int) -> None:
    numbering, lost, received = Numbering(count=0), 0, 0
    for number, arrives in enumerate(arrivals):
        if arrives:
            missing = numbering.transfer(number % 32, 0)
            received += missing is not None
            lost += missing or 0
        if (number + 1) % every == 0:
            lost += numbering.status(number + 1)
    lost += numbering.status(len(arrivals))
    assert received == sum(arrivals), "counts in time leave no transfer in doubt"
    assert received + lost == len(arrivals)
