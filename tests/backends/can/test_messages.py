from __future__ import annotations

import dataclasses

import pytest

from nros_backends.can.frames import segment
from nros_backends.can.messages import Endpoint, Heartbeat, Sign, SignKind, Status, digest
from nros_conformance.rmw.qos import Durability, Liveliness, Reliability

ENDPOINT = Endpoint(
    number=7, subject=1234, is_reader=False, topic=digest("a"), type=digest("b"), reliability=Reliability.RELIABLE,
    durability=Durability.VOLATILE, liveliness=Liveliness.MANUAL_BY_NODE, lease_ms=2**32 - 2, node_lease_ms=1000,
    deadline_ms=5, lifespan_ms=6, count=2**32 - 1, silent_ms=9, round=255,
)  # fmt: skip
READER = dataclasses.replace(ENDPOINT, is_reader=True, reliability=Reliability.BEST_EFFORT, liveliness=Liveliness.NONE)
MESSAGES = [
    ENDPOINT,
    READER,
    Heartbeat(2**32 - 1, 200),
    Status(8191, 2**32 - 1),
    Status(1, 0, rebased=True),
    *(Sign(kind, 65_535, 255) for kind in SignKind),
]


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_what_was_said_is_understood_also_with_padding(message: Endpoint | Heartbeat | Status | Sign) -> None:
    data = message.encode()
    assert type(message).decode(data + bytes(3)) == message
    assert [type(message).decode(data[:size]) for size in range(len(data))] == [None] * len(data)


def test_heartbeat_and_count_take_one_classic_frame() -> None:
    assert Heartbeat(0x01020304, 5).encode().hex() == "04030201000005"
    assert len(segment(Heartbeat(1, 2).encode(), 0, 8)) == len(segment(Status(1, 2).encode(), 0, 8)) == 1


def test_another_version_or_kind_is_not_understood() -> None:
    assert Endpoint.decode(b"\2" + ENDPOINT.encode()[1:]) is None
    assert Sign.decode(b"\x09\0\0\0") is None
