"""The bus against recorded results of ShawnFeng0/uorb (tests/vectors/uorb)."""

from __future__ import annotations

import errno
import json
from pathlib import Path
from typing import Any

import pytest

from nros_backends.uorb.bus import PX4, Bus, Metadata, Node, Rules, Subscription
from nros_backends.uorb.interval import SubscriptionInterval

VECTORS = Path(__file__).parents[2] / "vectors" / "uorb"
RECORDED = Rules(instances=4, rounding_limit=32768, unadvertise_hides=False)
INTERVAL_FILES = ["interval_periodic", "interval_queue_1", "interval_queue_4"]
INTERVAL_QUEUES = {"it1": 1, "it4": 4}
FILES = sorted(
    file.stem
    for file in VECTORS.glob("*.json")
    if not file.stem.startswith("px4_log_") and file.stem not in (*INTERVAL_FILES, "queue_rounding")
)
REFUSED = {"ok": False, "errno": errno.ENOMEM}


class Replay:
    """Runs recorded operations on a bus; every method answers in the form of the recording."""

    def __init__(self, rules: Rules) -> None:
        self.bus = Bus(rules)
        self.publishers: dict[str, Node] = {}
        self.subscriptions: dict[str, Subscription] = {}
        self.intervals: dict[str, SubscriptionInterval] = {}
        self.now_us = 0
        for topic, queue in INTERVAL_QUEUES.items():
            self.bus.define(Metadata(topic, 8, queue))

    def run(self, operation: dict[str, Any]) -> dict[str, Any]:
        arguments = {name: value for name, value in operation.items() if name not in ("op", "result")}
        result: dict[str, Any] = getattr(self, operation["op"])(**arguments)
        return result

    def node(self, topic: str, instance: int) -> Node:
        subscription = self.bus.subscribe(topic, instance)
        assert subscription is not None
        node = subscription.node
        assert node is not None
        subscription.detach()
        return node

    def topic(self, topic: str, size: int, queue: int) -> dict[str, Any]:
        self.bus.define(Metadata(topic, size, queue))
        return {"ok": True}

    def advertise(self, pub: str, topic: str, multi: bool) -> dict[str, Any]:
        node = self.bus.advertise_multi(topic) if multi else self.bus.advertise(topic)
        if node is None:
            return REFUSED
        self.publishers[pub] = node
        return {"ok": True, "instance": node.instance} if multi else {"ok": True}

    def unadvertise(self, pub: str) -> dict[str, Any]:
        self.publishers.pop(pub).unadvertise()
        return {"ok": True}

    def publish(self, pub: str, data: str) -> dict[str, Any]:
        return {"ok": self.publishers[pub].publish(bytes.fromhex(data))}

    def publish_anonymous(self, topic: str, data: str) -> dict[str, Any]:
        return {"ok": self.node(topic, 0).publish(bytes.fromhex(data))}

    def subscribe(self, sub: str, topic: str, instance: int) -> dict[str, Any]:
        subscription = self.bus.subscribe(topic, instance)
        if subscription is None:
            return REFUSED
        self.subscriptions[sub] = subscription
        return {"ok": True, "updates": subscription.unread}

    def unsubscribe(self, sub: str) -> dict[str, Any]:
        self.subscriptions.pop(sub).detach()
        return {"ok": True}

    def check(self, sub: str) -> dict[str, Any]:
        subscription = self.subscriptions[sub]
        return {"updated": subscription.updated(), "updates": subscription.unread}

    def copy(self, sub: str) -> dict[str, Any]:
        subscription = self.subscriptions[sub]
        before = subscription.unread
        data = subscription.copy()
        counts = {"updates_before": before, "updates_after": subscription.unread}
        if data is None:
            return {"ok": False} | counts
        skipped = before - counts["updates_after"] - 1 if before else 0
        return {"ok": True, "data": data.hex(), "skipped": skipped} | counts

    def copy_anonymous(self, topic: str) -> dict[str, Any]:
        subscription = self.bus.subscribe(topic)
        assert subscription is not None
        result = _sample(subscription.copy())
        subscription.detach()
        return result

    def exists(self, topic: str, instance: int) -> dict[str, Any]:
        return {"exists": self.bus.exists(topic, instance)}

    def group_count(self, topic: str) -> dict[str, Any]:
        return {"count": self.bus.group_count(topic)}

    def status(self, topic: str, instance: int) -> dict[str, Any]:
        node = self.bus.find(topic, instance)
        if node is None:
            return {"ok": False}
        return {
            "ok": True,
            "queue_size": node.queue,
            "subscribers": len(node.subscriptions),
            "publishers": node.publishers,
            "generation": node.generation,
        }

    def poll(self, subs: list[str], timeout_ms: int) -> dict[str, Any]:
        assert timeout_ms == 0
        flags = [int(self.subscriptions[sub].updated()) for sub in subs]
        return {"ready": sum(flags), "revents": flags}

    def set_generation(self, topic: str, instance: int, generation: int) -> dict[str, Any]:
        self.node(topic, instance).preset(generation)
        return {"ok": True}

    def set_time(self, us: int) -> dict[str, Any]:
        self.now_us = us
        return {"ok": True}

    def subscribe_interval(self, sub: str, topic: str, interval_us: int) -> dict[str, Any]:
        self.intervals[sub] = SubscriptionInterval(Subscription(self.bus, topic), interval_us)
        return {"ok": True}

    def interval_updated(self, sub: str) -> dict[str, Any]:
        return {"updated": self.intervals[sub].updated(self.now_us)}

    def interval_update(self, sub: str) -> dict[str, Any]:
        return _sample(self.intervals[sub].update(self.now_us))

    def interval_copy(self, sub: str) -> dict[str, Any]:
        return _sample(self.intervals[sub].copy(self.now_us))


def _sample(data: bytes | None) -> dict[str, Any]:
    return {"ok": False} if data is None else {"ok": True, "data": data.hex()}


def operations(name: str) -> list[dict[str, Any]]:
    recording: dict[str, Any] = json.loads((VECTORS / f"{name}.json").read_text(encoding="utf-8"))
    assert recording["n_ops"] == len(recording["ops"])
    found: list[dict[str, Any]] = recording["ops"]
    return found


def mismatches(name: str, rules: Rules) -> list[dict[str, Any]]:
    replay = Replay(rules)
    found = []
    for operation in operations(name):
        got = replay.run(operation)
        if got != operation["result"]:
            found.append(operation | {"got": got})
    return found


@pytest.mark.parametrize("name", [*FILES, *INTERVAL_FILES])
def test_every_recorded_result_is_reproduced(name: str) -> None:
    assert mismatches(name, RECORDED) == []


def test_there_are_9192_recorded_results_and_1621_of_rate_limited_subscriptions() -> None:
    assert len(FILES) == 16
    assert sum(len(operations(name)) for name in FILES) == 9192
    assert sum(len(operations(name)) for name in INTERVAL_FILES) == 1621


@pytest.mark.parametrize("name", INTERVAL_FILES)
def test_px4_rules_give_every_recorded_result_of_rate_limited_subscriptions(name: str) -> None:
    assert mismatches(name, PX4) == []


def test_px4_rules_share_9009_recorded_results_when_queue_lengths_are_powers_of_two() -> None:
    differing = {name: found for name in FILES if (found := mismatches(name, Rules(rounding_limit=32768)))}
    assert {name: len(found) for name, found in differing.items()} == {"anonymous": 47, "multi_instance": 136}
    # Nothing differs where nobody unadvertises, publishes without advertising, or asks for instance 4 to 9.
    assert 9192 - 47 - 136 == 9009


def test_px4_rules_take_a_queue_length_as_it_is_defined() -> None:
    differing = {name: len(found) for name in FILES if (found := mismatches(name, PX4))}
    assert differing == {
        "anonymous": 47,
        "multi_instance": 136,
        "queue_requested_100": 262,
        "queue_requested_5": 138,
        "wrap_queue_5": 169,
    }


def test_requested_queue_lengths_round_as_recorded() -> None:
    table = json.loads((VECTORS / "queue_rounding.json").read_text(encoding="utf-8"))["table"]
    assert len(table) > 30
    assert [[requested, RECORDED.queue_length(requested)] for requested, _ in table] == table
