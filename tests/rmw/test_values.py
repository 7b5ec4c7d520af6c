from __future__ import annotations

from datetime import timedelta

import pytest

from nros_conformance.rmw.codes import PUBLISHED_CODES, ReturnCode, RmwError, code_name
from nros_conformance.rmw.events import EventKind, Side, kind_label
from nros_conformance.rmw.qos import PROFILES, QosProfile, milliseconds


def test_return_codes_are_the_published_ones() -> None:
    assert sorted(PUBLISHED_CODES) == list(range(-19, 1))
    assert (code_name(-5), code_name(-77)) == ("UNSUPPORTED", "unpublished code -77")
    assert str(RmwError(ReturnCode.INVALID_CONFIG, "no room")) == "INVALID_CONFIG (-19): no room"


def test_kinds_have_the_values_sides_and_names_of_the_headers() -> None:
    assert [(kind.value, kind.label, kind.side) for kind in EventKind] == [
        (0, "LivelinessChanged", Side.SUBSCRIPTION), (1, "RequestedDeadlineMissed", Side.SUBSCRIPTION),
        (2, "MessageLost", Side.SUBSCRIPTION), (3, "LivelinessLost", Side.PUBLISHER),
        (4, "OfferedDeadlineMissed", Side.PUBLISHER),
    ]  # fmt: skip
    assert kind_label(255) == "kind 255"


@pytest.mark.parametrize("wrong", [
    {"depth": 65536}, {"depth": -1}, {"deadline_ms": 2**32}, {"lease_ms": -1}, {"lifespan_ms": 60 * 86_400_000},
])  # fmt: skip
def test_values_that_the_abi_cannot_represent_are_invalid_arguments(wrong: dict[str, int]) -> None:
    with pytest.raises(RmwError) as caught:
        QosProfile(**wrong).check()  # type: ignore[arg-type]
    assert caught.value.code == ReturnCode.INVALID_ARGUMENT


def test_standard_profiles_are_representable_and_sub_milliseconds_round_up() -> None:
    for profile in PROFILES.values():
        profile.check()
    assert milliseconds(timedelta(microseconds=1)) == 1
    assert milliseconds(0.015) == 15
    assert milliseconds(timedelta()) == 0
