"""What callbacks do at the script's behest, on the reference in virtual time."""

from __future__ import annotations

from typing import Any

import pytest

from nros_backends.reference import ReferenceBackend
from nros_backends.reference.backend import ReferenceSession
from nros_conformance.rmw.backend import SessionOptions
from nros_conformance.trace.records import Act, End, Event, Spin, State
from tests.play.scripts import PAIR, T, acts, of, play

ECHO = {**PAIR, "echo": {"publisher": "u", "session": "sub"}, "ear": {"subscription": "u", "session": "pub"}}
SILENCE = ["settle", {"do": "publish", "by": "talker", "as": "one"}, {"drive": "3.5T"}]


def reacting(*script: dict[str, Any], times: int = 1) -> dict[str, Any]:
    return {"react": [{"to": "RequestedDeadlineMissed", "of": "listener", "times": times, "script": list(script)}]}


def test_a_callback_makes_its_calls_at_once_and_says_that_it_did() -> None:
    records = play(SILENCE, ECHO, **reacting({"do": "publish", "by": "echo", "times": 2, "as": "answer"}, times=2))
    answers, events = acts(records, "answer"), of(records, Event)
    assert [act.within for act in answers] == ["listener/RequestedDeadlineMissed"] * 4
    assert [(act.index, act.args["sequence"], act.result) for act in answers] == [(n, n + 1, 0) for n in range(4)]
    assert [act.begin for act in answers] == [events[0].t] * 2 + [events[1].t] * 2
    assert len(events) == 3


def test_what_a_callback_does_is_recorded_after_the_event_that_it_reacts_to() -> None:
    records = play(SILENCE, **reacting({"do": "take", "from": "listener", "as": "taken"}))
    (taken,) = acts(records, "taken")
    first = next(record for record in records if isinstance(record, Event))
    assert taken.result == 1
    assert records.index(first) < records.index(taken)


def test_drive_io_within_a_callback_is_no_spin_and_no_callback_is_nested_in_the_reference() -> None:
    records = play(SILENCE, **reacting({"do": "drive", "timeout": "1T", "as": "inner"}, times=9))
    inner = acts(records, "inner")
    assert [(act.op, act.result, act.begin - act.end) for act in inner] == [("drive", -11, 0)] * 3
    assert not any(event.nested for event in of(records, Event))
    assert sum(spin.callbacks for spin in of(records, Spin)) == 3


class _Reenters(ReferenceBackend):
    """Runs callbacks from inside a callback (D-DSP-15)."""

    def create_session(self, options: SessionOptions) -> ReferenceSession:
        class Reentering(ReferenceSession):
            def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
                self.queue.busy = False
                return super().drive_io(timeout_ms, max_callbacks)

        return Reentering(self, options)


def test_a_callback_inside_another_one_is_told_apart() -> None:
    entities = {**PAIR, "other": {"subscription": "t", "registration_deadline": "1T"}}
    expect = [{"never": "RequestedDeadlineMissed", "of": ["listener", "other"], "proves": "RDM-001"}]
    records = play(
        SILENCE, entities, adapter=_Reenters, expect=expect, **reacting({"do": "drive", "timeout": 0, "as": "inner"})
    )
    assert [event.entity for event in of(records, Event) if event.nested] == ["other"]


def test_a_callback_that_raises_ends_its_drive_and_not_the_play() -> None:
    records = play(SILENCE, **reacting({"do": "raise", "as": "boom"}))
    (boom,) = acts(records, "boom")
    assert (boom.op, boom.within, boom.result, boom.raised) == ("raise", "listener/RequestedDeadlineMissed", None, "")
    assert [spin.raised for spin in of(records, Spin) if spin.raised] == ["boom"]
    assert len(of(records, Event)) == 3


def test_a_drive_that_the_script_calls_answers_nothing_when_a_callback_raised() -> None:
    script = [*SILENCE[:2], {"drive": "0.5T"}, {"do": "drive", "timeout": "1T", "as": "call"}]
    (call,) = acts(play(script, **reacting({"do": "raise"})), "call")
    assert (call.result, call.raised) == (None, "")


def test_a_backend_that_wraps_what_a_callback_raised_has_let_it_out() -> None:
    class Wraps(ReferenceBackend):
        def create_session(self, options: SessionOptions) -> ReferenceSession:
            class Wrapping(ReferenceSession):
                def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
                    try:
                        return super().drive_io(timeout_ms, max_callbacks)
                    except Exception as error:
                        raise RuntimeError("a callback failed") from error

            return Wrapping(self, options)

    records = play(SILENCE, adapter=Wraps, **reacting({"do": "raise", "as": "boom"}))
    assert [spin.raised for spin in of(records, Spin) if spin.raised] == ["boom"]


def test_a_backend_that_fails_while_a_callback_raises_is_blamed() -> None:
    class Stumbles(ReferenceBackend):
        def create_session(self, options: SessionOptions) -> ReferenceSession:
            class Stumbling(ReferenceSession):
                def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
                    try:
                        return super().drive_io(timeout_ms, max_callbacks)
                    except Exception:
                        raise KeyError("stumbled")  # noqa: B904 - a bug, not a wrapper

            return Stumbling(self, options)

    end = play(SILENCE, adapter=Stumbles, outcome="raised", **reacting({"do": "raise"}))[-1]
    assert end.detail.startswith("drive_io raised KeyError: 'stumbled' at test_reactions.py:")


def test_a_callback_may_destroy_its_entity() -> None:
    records = play(SILENCE, **reacting({"do": "destroy", "of": "listener", "as": "gone"}))
    (gone,) = acts(records, "gone")
    assert gone.result == 0
    assert [state.what for state in of(records, State) if state.entity == "listener"] == ["created", "destroyed"]
    assert len(of(records, Event)) == 1


def test_an_entity_that_does_not_exist_yet_is_an_error_of_the_script() -> None:
    entities = {**ECHO, "echo": {"publisher": "u", "session": "sub", "deferred": True}}
    end = play(SILENCE, entities, outcome="error", **reacting({"do": "publish", "by": "echo"}))[-1]
    assert end == End(outcome="error", t=end.t, detail="the script uses echo before it exists")


def test_a_destroyed_session_is_opened_again_by_creating_in_it() -> None:
    script = [{"do": "destroy", "of": "sub"}, {"drive": "1T"}, {"do": "create", "entity": "listener"}, *SILENCE]
    records = play(script)
    states = [(state.entity, state.what) for state in of(records, State) if state.session == "sub"]
    assert states == [
        ("", "created"), ("listener", "created"), ("", "destroyed"), ("", "created"), ("listener", "created"),
        ("", "destroyed"),
    ]  # fmt: skip
    assert len(of(records, Event)) == 3


def test_settling_waits_for_nobody_who_is_gone() -> None:
    script = [{"do": "destroy", "of": "listener"}, {"do": "settle", "as": "settled"}]
    (settled,) = acts(play(script), "settled")
    assert settled.result == 0


@pytest.mark.parametrize("times", [1, 3])
def test_so_many_callbacks_react_and_no_more(times: int) -> None:
    records = play(SILENCE, **reacting({"do": "has_data", "of": "listener", "as": "asked"}, times=times))
    assert len(acts(records, "asked")) == times
    (one,) = acts(records, "one")
    assert [event.t - one.end for event in of(records, Event)] == [T, 2 * T, 3 * T]
    assert all(isinstance(act, Act) for act in acts(records, "asked"))
