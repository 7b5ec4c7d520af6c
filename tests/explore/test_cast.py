from __future__ import annotations

import msgspec
import pytest

from nros_conformance.explore.cast import Cast, cast_for
from nros_conformance.explore.stand import left_out
from nros_conformance.rmw.declaration import Declaration
from nros_conformance.rmw.discovery import find_backend
from nros_conformance.rmw.events import EventKind
from nros_conformance.rmw.qos import Liveliness

LVC, RDM, MSL, LVL, ODM = EventKind


def declared(name: str) -> Declaration:
    found = find_backend(name).declaration
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("name", "kinds", "lacking", "leases"),
    [
        ("reference", (LVC, RDM, MSL, LVL, ODM), set(), True),
        ("cyclone", (LVC, RDM, MSL, LVL, ODM), set(), True),
        ("xrce", (RDM, ODM), {"assert"}, False),
        ("uorb", (MSL,), {"assert", "lose"}, False),
    ],
)
def test_what_a_backend_does_not_claim_or_cannot_do_is_left_out(
    name: str, kinds: tuple[EventKind, ...], lacking: set[str], leases: bool
) -> None:
    cast = cast_for(declared(name))
    assert cast.kinds == kinds
    assert set(Cast().verbs) - set(cast.verbs) == lacking
    assert cast.leases is leases
    assert (cast.qos("manual").liveliness is Liveliness.MANUAL_BY_TOPIC) is leases
    assert cast.without == {}


@pytest.mark.parametrize(
    ("kind", "fields", "why"),
    [
        (RDM, {"armed_at": "create"}, "the model does not arm deadlines at creation"),
        (ODM, {"armed_at": "create"}, "the model does not arm deadlines at creation"),
        (RDM, {"after_publisher_gone": "stops"}, "the model does not stop deadlines with the publisher"),
        (LVC, {"presence_only": True}, "the model counts publishers, not presence"),
        (LVL, {"publish_asserts": False}, "to the model a publish asserts liveliness"),
    ],
)
def test_a_choice_that_the_model_does_not_know_is_left_out_and_said(
    kind: EventKind, fields: dict[str, object], why: str
) -> None:
    base = declared("reference")
    event = msgspec.structs.replace(base.event(kind), **fields)
    cast = cast_for(msgspec.structs.replace(base, events={**base.events, kind.label: event}))
    assert kind not in cast.kinds
    assert cast.without == {kind: why}
    assert left_out([cast]) == [f"{kind.label}: {why}"]


def test_a_token_that_goes_does_not_say_why() -> None:
    assert cast_for(declared("zenoh")).forgets
    assert cast_for(declared("cyclone")).shared(cast_for(declared("zenoh"))).forgets
    assert not cast_for(declared("cyclone")).forgets


def test_two_share_what_both_can_do() -> None:
    shared = cast_for(declared("cyclone")).shared(cast_for(declared("xrce")))
    assert (shared.kinds, shared.leases, "assert" in shared.verbs, "lose" in shared.verbs) == (
        (RDM, ODM), False, False, True,
    )  # fmt: skip
