"""The recordings of real traffic (tests/vectors/zenoh)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import xxhash
import zenoh

from nros_backends.zenoh import keys
from nros_backends.zenoh.attachment import Attachment, decode, encode, find_number
from nros_backends.zenoh.numbers import HOLD_NS, Numbers
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.events import Side
from nros_conformance.rmw.qos import DEFAULT, Durability, Liveliness, QosProfile, Reliability

VECTORS = Path(__file__).parents[2] / "vectors" / "zenoh"


def vectors(name: str) -> Any:
    return json.loads((VECTORS / f"{name}.json").read_text())


KEYS = vectors("keyexprs")


def by_name(row: dict[str, Any]) -> str:
    return str(row.get("name") or row.get("note") or row["attachment_hex"][:16])


@pytest.mark.parametrize("row", vectors("attachments")["rows"], ids=by_name)
def test_an_attachment_reads_as_recorded(row: dict[str, Any]) -> None:
    data = None if row["attachment_hex"] is None else bytes.fromhex(row["attachment_hex"])
    expected = row["decoded"] and Attachment(
        row["decoded"]["sequence_number"], row["decoded"]["source_timestamp_ns"], bytes.fromhex(row["decoded"]["gid"])
    )
    assert decode(data, bytes.fromhex(row["payload_hex"])) == expected
    if expected is not None and len(data or b"") == 33:
        assert encode(expected) == data
        assert find_number(b"in front of it" + encode(expected) + b"behind", expected.gid) == expected.number


def test_an_attachment_of_another_payload_is_none() -> None:
    (row,) = [row for row in vectors("attachments")["rows"] if row["attachment_len"] == 37]
    assert decode(bytes.fromhex(row["attachment_hex"]), b"another") is None


@pytest.mark.parametrize("row", KEYS["tokens"], ids=by_name)
def test_a_token_reads_as_recorded(row: dict[str, Any]) -> None:
    fields, token = row["fields"], keys.parse_token(row["keyexpr"])
    if fields["entity_kind"] == "NN":
        assert token is None
        return
    assert token is not None
    assert token.side is (Side.PUBLISHER if fields["entity_kind"] == "MP" else Side.SUBSCRIPTION)
    assert (token.session, token.type_name) == (fields["session_id"], fields["type"])
    assert token.topic.replace("/", "%") == fields["topic"]


def test_the_qos_of_a_token_reads_as_recorded() -> None:
    chunks = {row["name"]: row["fields"].get("qos", "") for row in KEYS["tokens"]}
    assert keys.parse_qos(chunks["pico_pub"]) == QosProfile(depth=7)
    assert keys.parse_qos(chunks["nano_pub_id1"]) == QosProfile(reliability=Reliability.BEST_EFFORT, depth=1)
    assert keys.parse_qos(chunks["deadline_pub"]) == QosProfile(
        reliability=Reliability.BEST_EFFORT, depth=1, deadline_ms=100,
        liveliness=Liveliness.MANUAL_BY_NODE, lease_ms=1500,
    )  # fmt: skip


def test_our_tokens_and_data_are_spelled_like_those() -> None:
    row = next(row for row in KEYS["tokens"] if row["name"] == "doc_pub")
    fields = row["fields"]
    key = keys.entity_key(
        2, fields["session_id"], 10, Side.PUBLISHER, "talker", "chatter", "std_msgs/msg/String", QosProfile(depth=7)
    )
    assert key.replace(keys.NO_HASH, fields["type_hash"]) == row["keyexpr"]
    node = next(row for row in KEYS["tokens"] if row["name"] == "doc_node")
    assert keys.node_key(2, node["fields"]["session_id"], "listener") == node["keyexpr"]
    plain, unhashed, spaced, _ = KEYS["data_keyexprs"]
    assert keys.data_key(0, "/chatter", "std_msgs/msg/String") == unhashed
    assert keys.data_key(0, "chatter", "std_msgs/msg/String", plain.rpartition("/")[2]) == plain
    assert keys.data_key(0, "robot1/chatter", "std_msgs/msg/String", spaced.rpartition("/")[2]) == spaced
    wanted = zenoh.KeyExpr(keys.data_key(0, "chatter", "std_msgs/msg/String", "*"))
    assert [wanted.intersects(zenoh.KeyExpr(key)) for key in KEYS["data_keyexprs"]] == [True, True, False, False]


@pytest.mark.parametrize("row", [*KEYS["token_wildcards"], *KEYS["data_wildcards"]], ids=lambda row: row["expr"])
def test_wildcards_meet_what_they_met(row: dict[str, Any]) -> None:
    names = {token["name"]: token["keyexpr"] for token in KEYS["tokens"]}
    expression = zenoh.KeyExpr(row["expr"])
    assert {name: expression.intersects(zenoh.KeyExpr(names.get(name, name))) for name in row["matches"]} == row[
        "matches"
    ]


@pytest.mark.parametrize(
    "qos",
    [
        DEFAULT,
        QosProfile(depth=42, durability=Durability.TRANSIENT_LOCAL, lifespan_ms=2**32 - 2),
        QosProfile(liveliness=Liveliness.MANUAL_BY_TOPIC, lease_ms=1500, deadline_ms=1),
    ],
)
def test_a_qos_survives_its_chunk(qos: QosProfile) -> None:
    assert keys.parse_qos(keys.qos_chunk(qos)) == qos


@pytest.mark.parametrize("chunk", ["", "::", "::,x:,:,:,,", "9::,7:,:,:,,", "::,7:,:,:,", "::,7:,:,:,,:"])
def test_a_malformed_chunk_is_none(chunk: str) -> None:
    assert keys.parse_qos(chunk) is None


def test_a_gid_is_the_hash_of_the_token_low_half_first() -> None:
    # The digest of the XXH3 test vectors is the high half first, big-endian.
    assert keys.gid_of("") == bytes.fromhex("99aa06d3014798d86001c324468d497f")[::-1]
    assert keys.gid_of("@ros2_lv/0/x")[::-1] == xxhash.xxh3_128_digest(b"@ros2_lv/0/x")


@pytest.mark.parametrize("row", vectors("message_lost_traces")["rows"], ids=by_name)
def test_losses_are_counted_as_they_were(row: dict[str, Any]) -> None:
    numbers = Numbers()
    received = [decode(bytes.fromhex(text), b"") for text in row["received_attachments"]]
    delivered = [numbers.accept(sample, 1_000 + at) for at, sample in enumerate(received) if sample is not None]
    numbers.update(HOLD_NS + MS)
    # A rule of gaps cannot see a loss before the first and after the last sample. It sees one where there is
    # none when a sample was overtaken; holding the gap open for a moment mends that.
    expected = 0 if row["name"] == "reordered" else row["count_by_rule"]["per_gid_forward_gaps"]
    assert numbers.losses.total == expected
    assert delivered.count(False) == (row["name"] == "duplicate")


def test_a_gap_that_stays_open_becomes_a_loss_and_is_not_filled_afterwards() -> None:
    numbers, gid = Numbers(), bytes(16)
    assert numbers.accept(Attachment(1, 1, gid), 0)
    assert numbers.accept(Attachment(4, 4, gid), MS)
    numbers.update(HOLD_NS)
    assert (numbers.losses.total, numbers.next_due_ns) == (0, MS + HOLD_NS)
    assert numbers.accept(Attachment(2, 2, gid), 2 * MS)
    numbers.update(MS + HOLD_NS)
    assert (numbers.losses.total, numbers.losses.ready_ns) == (1, MS)
    assert not numbers.accept(Attachment(3, 3, gid), 2 * HOLD_NS)


def test_what_the_very_first_sample_overtook_is_delivered_and_no_restart() -> None:
    numbers, gid = Numbers(), bytes(16)
    assert [numbers.accept(Attachment(number, number, gid), 0) for number in (4, 1, 2, 3, 3, 5)] == [
        True, True, True, True, False, True,
    ]  # fmt: skip
    numbers.update(HOLD_NS)
    assert numbers.losses.total == 0


def test_a_publisher_out_of_sight_loses_nothing_and_repeats_nothing() -> None:
    numbers, gid = Numbers(), bytes(16)
    assert numbers.accept(Attachment(1, 1, gid), 0)
    numbers.resume(gid)
    assert not numbers.accept(Attachment(1, 1, gid), 0)
    assert numbers.accept(Attachment(9, 9, gid), 0)
    assert numbers.accept(Attachment(11, 11, gid), 0)
    numbers.update(HOLD_NS)
    assert numbers.losses.total == 1
