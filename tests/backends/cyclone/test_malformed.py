"""The fault ``inject``: what goes over the wire, and that it does no harm."""

from __future__ import annotations

import dataclasses
import random
import socket
import struct
from collections.abc import Iterator
from typing import Any

import pytest

from nros_conformance.rmw.backend import Host
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import Reliability
from tests.backends.cyclone.conftest import Stage

KINDS = 55
"""In one round."""


@pytest.fixture
def host(host: Host) -> Host:
    return dataclasses.replace(host, faults=frozenset({"inject"}))


def heard(session: Any) -> bytes:
    announcement: bytes = session.ear.announcement(session.guid.bytes[:12], 5.0)
    return announcement


def datagrams(stage: Stage, publisher: Any, subscription: Any, seed: int) -> Iterator[bytes]:
    from nros_backends.cyclone.malformed import malformed

    writers, readers = [publisher.guid.bytes], [subscription.guid.bytes]
    return malformed(writers, readers, heard(stage.near), random.Random(seed), KINDS)


def send(session: Any, datagram: bytes) -> None:
    from nros_backends.cyclone.ear import unicast_ports

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for port in unicast_ports(heard(session)):
            sender.sendto(datagram, ("127.0.0.1", port))


@pytest.mark.parametrize("reliability", [Reliability.RELIABLE, Reliability.BEST_EFFORT])
def test_no_datagram_of_any_kind_costs_the_sample_after_it_or_fires_anything(
    stage: Stage, reliability: Reliability
) -> None:
    publisher, subscription = stage.pair(reliability=reliability)
    logs = [stage.log(subscription, kind) for kind in (EventKind.LIVELINESS_CHANGED, EventKind.MESSAGE_LOST)]
    *harmless, behind_all_numbers, _oversized = datagrams(stage, publisher, subscription, seed=reliability)
    assert b"\xff\xff\xff\xff\xfd\xff\xff\xff" in behind_all_numbers
    for number, datagram in enumerate(harmless):
        send(stage.near, datagram)
        send(stage.far, datagram)
        sample = number.to_bytes(2, "little")
        assert publisher.publish_raw(sample) == ReturnCode.OK
        assert stage.receive(subscription, 1) == [sample], f"after {datagram.hex()}"
    stage.near.drive_io(20)
    assert [len(log.events) for log in logs] == [1, 0]
    assert logs[0].counts == (1, 0)


def test_a_reliable_reader_believes_in_a_negative_heartbeat(stage: Stage) -> None:
    """C4: fails as soon as Cyclone refuses it."""
    publisher, subscription = stage.pair()
    publisher.publish_raw(b"before")
    assert stage.receive(subscription, 1) == [b"before"]
    *_, behind_all_numbers, _oversized = datagrams(stage, publisher, subscription, seed=1)
    send(stage.near, behind_all_numbers)
    stage.pause(50)
    publisher.publish_raw(b"after")
    stage.near.drive_io(300)
    assert stage.take_all(subscription) == []


def test_injected_datagrams_are_the_same_for_a_seed(stage: Stage) -> None:
    publisher, subscription = stage.pair()
    first, again, other = ([*datagrams(stage, publisher, subscription, seed)] for seed in (3, 3, 4))
    assert first == again != other
    assert len(first) == KINDS + 1
    assert len(first[-1]) > 60_000


def test_an_announcement_of_nobody_brings_no_participant(stage: Stage) -> None:
    from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsParticipant

    stage.pair()
    assert stage.backend.inject("inject", session=stage.near, count=500, seed=11) == ReturnCode.OK
    stage.pause(50)
    reader = BuiltinDataReader(stage.near._participant, BuiltinTopicDcpsParticipant)  # type: ignore[arg-type]
    assert {found.key for found in reader.take(100)} == {stage.near.guid, stage.far.guid}


def test_the_ports_are_those_that_others_are_told_by_the_middleware(stage: Stage) -> None:
    from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsParticipant

    from nros_backends.cyclone.ear import unicast_ports

    stage.pair()
    reader = BuiltinDataReader(stage.near._participant, BuiltinTopicDcpsParticipant)  # type: ignore[arg-type]
    (told,) = [str(found.qos) for found in reader.take(10) if found.key == stage.far.guid]
    (port,) = unicast_ports(heard(stage.far))
    assert f"udp/127.0.0.1:{port}" in told


def test_locators_of_a_torn_announcement_are_those_that_it_still_has() -> None:
    from nros_backends.cyclone.ear import parameters, unicast_ports

    locator = struct.pack("<HHiI16s", 0x0031, 24, 1, 7411, bytes(12) + b"\x7f\0\0\1")
    other = struct.pack("<HHiI16s", 0x0032, 24, 2, 7412, bytes(16))
    data = bytes(20) + b"\x15\1\0\0" + bytes(24) + locator + other + b"\1\0\0\0" + locator
    assert parameters(data) == 48
    assert unicast_ports(data) == [7411]
    assert unicast_ports(data[:40]) == unicast_ports(b"") == unicast_ports(bytes(20) + b"\x09\1\xff\xff") == []


def test_without_an_ear_nothing_is_injected(stage: Stage) -> None:
    stage.near.ear, ear = None, stage.near.ear
    assert stage.backend.inject("inject", session=stage.near, count=1, seed=1) == ReturnCode.UNSUPPORTED
    stage.near.ear = ear
    stage.near.destroy()
    assert stage.backend.inject("inject", session=stage.near, count=1, seed=1) == ReturnCode.INVALID_ARGUMENT
