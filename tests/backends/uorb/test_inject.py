"""The faults ``preset`` and ``inject``, asked for through `Backend.inject`."""

from __future__ import annotations

import pytest

from nros_backends.uorb import UorbBackend
from nros_conformance.rmw.backend import Session
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.events import CountStatus, EventKind
from tests.backends.uorb.conftest import MakeTalk


def test_a_preset_generation_loses_nothing(backend: UorbBackend, make_talk: MakeTalk) -> None:
    talk = make_talk(10)
    assert backend.inject("preset", entity=talk.publisher, count=2**32 - 2, kind=None) == ReturnCode.OK
    talk.publish(5)
    assert talk.take() == [0, 1, 2, 3, 4]
    talk.drive()
    assert talk.losses == []


def test_a_preset_total_is_counted_on_from_and_saturates(backend: UorbBackend, make_talk: MakeTalk) -> None:
    talk = make_talk(2)
    preset = backend.inject("preset", entity=talk.subscription, count=2**32 - 3, kind=int(EventKind.MESSAGE_LOST))
    assert preset == ReturnCode.OK
    for total in (2**32 - 2, 2**32 - 1, 2**32 - 1):
        talk.publish(3 if not talk.losses else 1)
        talk.drive()
        assert talk.losses[-1] == CountStatus(total, 1)


@pytest.mark.parametrize("fault", ["lose", "partition", "overflow"])
def test_other_faults_are_refused(backend: UorbBackend, make_talk: MakeTalk, fault: str) -> None:
    entity = make_talk(1).subscription
    assert backend.inject(fault, entity=entity, count=1, kind=None) == ReturnCode.UNSUPPORTED


def test_other_counters_are_refused(backend: UorbBackend, make_talk: MakeTalk) -> None:
    talk = make_talk(1)
    for entity, kind in ((talk.subscription, EventKind.LIVELINESS_CHANGED), (talk.publisher, EventKind.MESSAGE_LOST)):
        assert backend.inject("preset", entity=entity, count=1, kind=int(kind)) == ReturnCode.UNSUPPORTED
    assert backend.inject("preset", entity=object(), count=1, kind=None) == ReturnCode.UNSUPPORTED


def test_what_a_foreign_module_gets_wrong_reaches_nobody(backend: UorbBackend, make_talk: MakeTalk) -> None:
    talk = make_talk(depth=4)
    talk.publish(2)
    (node,) = backend._domains[0]._bus._nodes.values()
    before = node.generation
    assert backend.inject("inject", session=talk.session, count=100, seed=7) == ReturnCode.OK
    assert node.generation == before
    talk.drive()
    talk.publish(2)
    assert talk.take() == [0, 1, 2, 3]
    talk.drive()
    assert talk.losses == []


def test_nothing_is_injected_into_an_empty_bus_or_a_destroyed_session(backend: UorbBackend, session: Session) -> None:
    assert backend.inject("inject", session=session, count=5, seed=7) == ReturnCode.OK
    session.destroy()
    assert backend.inject("inject", session=session, count=5, seed=7) == ReturnCode.INVALID_ARGUMENT
