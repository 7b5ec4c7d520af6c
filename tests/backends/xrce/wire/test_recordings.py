from __future__ import annotations

import pytest

from nros_backends.xrce.wire import Malformed, decode, encode
from nros_backends.xrce.wire.binary import ParticipantBody, Qos, WriterBody, decode_binary, encode_binary
from nros_backends.xrce.wire.ids import CLIENT, Kind, ObjectId
from nros_backends.xrce.wire.messages import Binary, Create, CreateClient, LivelinessAnswer
from tests.backends.xrce.captures import conversations

TRUNCATED = ("raw_bad_create", "8000000000011000585243450100")
"""The one recorded datagram that is not a message: a CREATE_CLIENT that somebody cut."""


@pytest.mark.parametrize("name", sorted(conversations()))
def test_recorded_datagrams_decode_and_encode_to_the_same_bytes(name: str) -> None:
    for datagram in conversations()[name].datagrams:
        if (name, datagram.payload.hex()) != TRUNCATED:
            assert encode(decode(datagram.payload)) == datagram.payload


def test_all_recordings_are_here() -> None:
    assert len(conversations()) == 72
    assert sum(len(one.datagrams) for one in conversations().values()) == 2703


def test_the_cut_datagram_is_refused_with_place_and_reason() -> None:
    with pytest.raises(Malformed) as caught:
        decode(bytes.fromhex(TRUNCATED[1]))
    assert str(caught.value) == "malformed XRCE message at byte 8: submessage 0 states 16 bytes, 6 are left"


def test_recorded_binary_representations_encode_to_the_same_bytes() -> None:
    seen = set()
    for conversation in conversations().values():
        for datagram in conversation.datagrams:
            if not datagram.to_agent or (conversation.name, datagram.payload.hex()) == TRUNCATED:
                continue
            for create in decode(datagram.payload).submessages:
                if isinstance(create, Create) and isinstance(create.representation, Binary):
                    body = decode_binary(create.kind, create.representation.body, create.little)
                    assert encode_binary(body, create.little) == create.representation.body
                    seen.add((create.kind, create.little))
    assert {kind for kind, _ in seen} == {Kind(number) for number in range(1, 7)}
    assert {little for _, little in seen} == {False, True}


def test_what_a_recorded_participant_and_writer_say() -> None:
    creates = [
        one for one in decode(conversations()["entities_bin_reliable"].datagrams[2].payload).submessages
        if isinstance(one, Create)
    ]  # fmt: skip
    bodies = {
        one.kind: decode_binary(one.kind, one.representation.body)
        for one in creates
        if isinstance(one.representation, Binary)
    }
    assert bodies[Kind.PARTICIPANT] == ParticipantBody(None, "xrce_participant")
    writer = bodies[Kind.DATAWRITER]
    assert isinstance(writer, WriterBody)
    assert writer.qos is not None
    assert writer.topic == ObjectId(1, Kind.TOPIC)
    assert writer.qos.flags == Qos.RELIABLE | Qos.KEEP_LAST | Qos.TRANSIENT_LOCAL
    assert (writer.qos.depth, writer.qos.deadline_ms) == (None, None)


def test_the_wrong_length_of_create_client_with_properties_is_taken_and_kept() -> None:
    (request,) = decode(conversations()["hard_liveliness_property_10000"].datagrams[0].payload).submessages
    assert isinstance(request, CreateClient)
    assert request.properties == (("uxr_hl", "010000"),)
    assert request.mtu == 508
    assert request.understated
    (correct,) = decode(conversations()["raw_hl_answers"].datagrams[0].payload).submessages
    assert isinstance(correct, CreateClient)
    assert not correct.understated


def test_the_liveliness_answer_without_a_submessage_header_is_known() -> None:
    assert decode(bytes.fromhex("810000000000000000000000")).submessages == (LivelinessAnswer(),)


def test_ids_read_as_people_write_them() -> None:
    assert str(ObjectId(1, Kind.DATAWRITER)) == "DATAWRITER#1"
    assert CLIENT.number << 4 | CLIENT.kind == 0xFFFE
