from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nros_backends.can.frames import MTU_CLASSIC, MTU_FD, can_id, crc, parse_id, segment
from nros_backends.can.transfers import Assembly, Transfer

CASES: list[dict[str, Any]] = json.loads((Path(__file__).parent / "cyphal_can_frames.json").read_text())["cases"]


def test_there_are_64_recorded_transfers() -> None:
    assert len(CASES) == 64


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case['can_id']:x}-{len(case['payload']) // 2}")
def test_frames_are_those_of_both_reference_stacks(case: dict[str, Any]) -> None:
    payload, mtu = bytes.fromhex(case["payload"]), MTU_FD if case["fd"] else MTU_CLASSIC
    assert can_id(case["priority"], case["subject"], case["node"]) == case["can_id"]
    assert parse_id(case["can_id"]) == (case["priority"], case["subject"], case["node"])
    assert [frame.hex() for frame in segment(payload, case["transfer_id"], mtu)] == case["frames"]

    assembly = Assembly(10_000)
    *unfinished, last = (assembly.frame(bytes.fromhex(frame)) for frame in case["frames"])
    assert not any(unfinished)
    assert last is not None
    assert last.transfer_id == case["transfer_id"]
    assert last.payload.startswith(payload)
    assert not any(last.payload[len(payload) :])


@given(st.binary(max_size=300), st.integers(0, 2**32 - 1))
def test_a_classic_transfer_keeps_its_length(payload: bytes, number: int) -> None:
    assembly = Assembly(400)
    *_, last = (assembly.frame(frame) for frame in segment(payload, number, MTU_CLASSIC))
    assert last == Transfer(number % 32, payload)


@pytest.mark.parametrize(("size", "comes_back"), [(7, 7), (8, 11), (9, 11), (16, 19), (62, 63), (70, 72), (1024, 1025)])
def test_fd_pads_what_its_frames_cannot_hold_exactly(size: int, comes_back: int) -> None:
    assembly = Assembly(2_000)
    *_, last = (assembly.frame(frame) for frame in segment(b"\1" * size, 0, MTU_FD))
    assert last is not None
    assert last.payload == b"\1" * size + bytes(comes_back - size)


@pytest.mark.parametrize("bit", [7, 23, 24, 25, 29])
def test_an_identifier_of_something_else_is_no_message(bit: int) -> None:
    assert parse_id(can_id(4, 100, 5)) is not None
    assert parse_id(can_id(4, 100, 5) | 1 << bit) is None


def test_the_crc_is_ccitt_false() -> None:
    assert crc(b"123456789") == 0x29B1
    assert crc(b"123456789\x29\xb1") == 0
