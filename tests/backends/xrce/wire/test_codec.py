from __future__ import annotations

import contextlib
import tracemalloc

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from nros_backends.xrce.wire import Header, Malformed, Message, decode, decode_body, encode, encode_body
from nros_backends.xrce.wire import messages as m
from nros_backends.xrce.wire.binary import decode_binary
from nros_backends.xrce.wire.ids import Kind, ObjectId
from tests.backends.xrce.wire.strategies import messages, submessages

WRITER = ObjectId(1, Kind.DATAWRITER)


@given(messages)
def test_a_message_comes_back_as_it_was(message: Message) -> None:
    datagram = encode(message)
    assume(datagram[-8:] != bytes(8) or len(message.submessages) != 1)  # the liveliness answer has no header
    assert decode(datagram) == message


@given(st.lists(submessages, max_size=3))
def test_joined_fragments_come_back_as_they_were(parts: list[m.Submessage]) -> None:
    assert decode_body(encode_body(parts)) == tuple(parts)


@given(st.binary(max_size=200))
@example(b"")
@example(bytes.fromhex("80000000000110005852434501000100ffffffff8101ffffffff"))
def test_arbitrary_bytes_raise_nothing_but_malformed(datagram: bytes) -> None:
    with contextlib.suppress(Malformed):
        decode(datagram)


@given(st.binary(max_size=60), st.sampled_from(Kind), st.booleans())
def test_arbitrary_binary_bodies_raise_nothing_but_malformed(body: bytes, kind: Kind, little: bool) -> None:
    with contextlib.suppress(Malformed):
        decode_binary(kind, body, little)


@given(messages, st.integers(0, 400), st.integers(0, 255))
def test_a_message_with_one_byte_changed_raises_nothing_but_malformed(message: Message, place: int, value: int) -> None:
    datagram = bytearray(encode(message))
    datagram[place % len(datagram)] = value
    with contextlib.suppress(Malformed):
        decode(bytes(datagram))


@pytest.mark.parametrize(
    ("datagram", "text"),
    [
        ("8000", "at byte 2: sequence number needs 2 bytes, 0 are left"),
        ("00000000aabb", "at byte 4: client key needs 4 bytes, 2 are left"),
        ("81000000030104000001", "at byte 8: submessage 3 states 4 bytes, 2 are left"),
        ("810000000301020000010000", "at byte 10: object id needs 2 bytes, 0 are left"),
        ("818000000801080000010016010002ff", "at byte 14: has content filter is 2, a bool is 0 or 1"),
        ("8180000001051000000a001101070000020000000000" + "00" * 8,
         "at byte 14: representation format 7 is none of 1 (REF), 2 (XML), 3 (BIN)"),
        ("8180000001050c00000a001101030000ffffff7f",
         "at byte 20: binary representation needs 2147483647 bytes, 0 are left"),
        ("8180000001050e00000a0012020200000200000041420011", "at byte 22: XML does not end with NUL"),
        ("8180000001050e00000a00120202000002000000ff000011", "at byte 22: XML is not UTF-8"),
    ],
)  # fmt: skip
def test_what_is_malformed_is_refused_with_place_and_reason(datagram: str, text: str) -> None:
    with pytest.raises(Malformed) as caught:
        decode(bytes.fromhex(datagram))
    assert str(caught.value) == f"malformed XRCE message {text}"


def test_a_declared_length_of_two_gigabytes_costs_no_memory() -> None:
    datagram = bytes.fromhex("8180000001050c00000a001101030000ffffff7f")
    tracemalloc.start()
    try:
        with pytest.raises(Malformed):
            decode(datagram)
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()


def test_a_sample_too_long_for_the_length_field_states_zero() -> None:
    sample = m.WriteData(request=1, object=WRITER, data=bytes(70_000))
    datagram = encode(Message(Header(0x81, 0x80), (sample,)))
    assert datagram[6:8] == b"\0\0"
    assert decode(datagram).submessages == (sample,)


def test_the_key_has_to_agree_with_the_session_id() -> None:
    for header in (Header(0x01), Header(0x81, key=5)):
        with pytest.raises(ValueError, match="exactly if its session id is below 0x80"):
            encode(Message(header))


def test_a_number_without_room_is_an_overflow_and_not_another_number() -> None:
    with pytest.raises(OverflowError):
        encode_body([m.Acknack(first_unacked=0x10000, missing=0, stream=0x80)])


def test_the_time_of_the_wire_is_seconds_and_nanoseconds() -> None:
    assert m.Time.of(1_500_000_001) == m.Time(1, 500_000_001)
    assert m.Time(1, 500_000_001).ns == 1_500_000_001
