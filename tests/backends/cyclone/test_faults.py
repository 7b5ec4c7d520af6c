"""The faults that `CycloneBackend.inject` can do."""

from __future__ import annotations

from typing import Any

import pytest

from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import Reliability
from tests.backends.cyclone.conftest import Stage

BEST_EFFORT = {"reliability": Reliability.BEST_EFFORT, "depth": 64}


@pytest.mark.parametrize("count", [1, 7])
def test_exactly_so_many_samples_are_lost(stage: Stage, count: int) -> None:
    publisher, subscription = stage.pair(**BEST_EFFORT)
    lost = stage.log(subscription, EventKind.MESSAGE_LOST)
    numbers = iter(range(100))

    def publish() -> int:
        return publisher.publish_raw(bytes([next(numbers)]))

    assert publish() == ReturnCode.OK
    assert stage.backend.inject("lose", entity=publisher, count=count, publish=publish) == ReturnCode.OK
    assert publish() == ReturnCode.OK
    assert stage.receive(subscription, 2) == [bytes([0]), bytes([count + 1])]
    stage.near.drive_io(0)
    assert lost.total == count


def test_the_wire_is_whole_again_when_publishing_fails(stage: Stage) -> None:
    publisher, subscription = stage.pair(**BEST_EFFORT)

    def publish() -> int:
        raise ValueError("no sample")

    with pytest.raises(ValueError, match="no sample"):
        stage.backend.inject("lose", entity=publisher, count=1, publish=publish)
    assert publisher.publish_raw(b"heard") == ReturnCode.OK
    assert stage.receive(subscription, 1) == [b"heard"]


@pytest.mark.parametrize(("fault", "out", "into"), [
    ({"fault": "partition"}, False, False),
    ({"fault": "block", "direction": "out"}, False, True),
    ({"fault": "block", "direction": "in"}, True, False),
])  # fmt: skip
def test_what_passes_between_a_session_and_the_others(
    stage: Stage, fault: dict[str, Any], out: bool, into: bool
) -> None:
    sent, received = stage.pair(**BEST_EFFORT)
    answer, heard = (stage.publisher(stage.near, "u", **BEST_EFFORT), stage.subscription(stage.far, "u", **BEST_EFFORT))
    stage.match(answer, heard)
    stage.drive()
    assert stage.backend.inject(session=stage.far, **fault) == ReturnCode.OK
    assert sent.publish_raw(b"out") == answer.publish_raw(b"in") == ReturnCode.OK
    stage.pause(100)
    assert (stage.take_all(received), stage.take_all(heard)) == ([b"out"] * out, [b"in"] * into)
    assert stage.backend.inject("heal", session=stage.far) == ReturnCode.OK
    assert sent.publish_raw(b"out") == answer.publish_raw(b"in") == ReturnCode.OK
    stage.until(lambda: received.has_data() is True and heard.has_data() is True)


def test_other_faults_and_foreign_or_closed_sessions_are_refused(stage: Stage) -> None:
    publisher = stage.publisher()
    inject = stage.backend.inject
    assert inject("duplicate", entity=publisher, count=1, publish=lambda: 0) == ReturnCode.UNSUPPORTED
    assert inject("preset", entity=publisher, count=1, kind=None) == ReturnCode.UNSUPPORTED
    assert inject("partition", session=object()) == ReturnCode.UNSUPPORTED
    stage.far.destroy()
    assert inject("partition", session=stage.far) == ReturnCode.INVALID_ARGUMENT
    assert inject("lose", entity=publisher, count=1, publish=lambda: 0) == ReturnCode.INVALID_ARGUMENT
