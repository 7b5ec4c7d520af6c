"""A declaration drafted from what a library answered: support by return codes, strict values where none tell."""

from __future__ import annotations

import json
from collections.abc import Iterator

from nros_backends.native.survey import CRASHED, DISCOVERY_NS, Answers
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import ReturnCode, code_name
from nros_conformance.rmw.events import EventKind, Side

ADAPTER = "nros_backends.native:NativeBackend"
SESSIONS = 8
_SLACK = 5
_LEAST_MS, _MOST_MS = 100, DISCOVERY_NS // MS


def draft(answers: Answers, file: str) -> str:
    """The text of a ``backend.toml``."""
    return "\n".join(_lines(answers, file)) + "\n"


def discovery_ms(answers: Answers) -> int:
    """A bound: some times what was measured once, 2 s when no sample arrived at all."""
    if answers.discovery_ms is None:
        return _MOST_MS
    return min(max(_LEAST_MS, int(_SLACK * answers.discovery_ms)), _MOST_MS)


def _lines(answers: Answers, file: str) -> Iterator[str]:
    yield f"# Drafted by `nros-conformance declare --native {file}` from what it answered."
    yield "# Support is derived from return codes; what they cannot tell has the strict value."
    yield "# Read every line, correct it, delete this head. Fields: docs/backend-toml.md"
    yield "schema  = 1"
    yield f"name    = {_text(answers.name)}"
    yield f"title   = {_text(answers.name)}"
    yield f"adapter = {_text(ADAPTER)}"
    yield ""
    yield "[subject]"
    yield 'kind = "compiled"'
    yield f"says = {_text(f'the compiled nano-ros backend {answers.name} ({file}), called through its vtable')}"
    for kind in EventKind:
        yield from _event(answers, kind)
    yield ""
    yield "[connection]"
    yield from _ping(answers)
    yield ""
    yield "[bounds]"
    if answers.discovery_ms is None:
        yield f'discovery = "{_MOST_MS} ms"        # no sample arrived within that time'
    else:
        yield f'discovery = "{discovery_ms(answers)} ms"         # the first sample took {answers.discovery_ms:.0f} ms'
    yield f"sessions  = {1 if answers.second_session else SESSIONS}                # at once, in one process"
    yield ""
    yield "[behaviour]"
    yield "derived_support = true          # C has no supports_event"
    yield "callback_cap    = false         # drive_io has no cap of callbacks"
    if not answers.same_session:
        yield "same_session_visible = false    # no sample arrived within one session"
    if answers.second_session:
        yield f'two_sessions = "second_fails"   # creating it {_answer(answers.second_session)}'
    refused = [name for name, code in answers.creating.items() if code == ReturnCode.INCOMPATIBLE_QOS]
    if refused:
        yield ""
        yield "[qos]"
        yield f"unsupported = {json.dumps(refused)}"


def _event(answers: Answers, kind: EventKind) -> Iterator[str]:
    code, slot = answers.registering[kind.label], f"register_{kind.side.value}_event"
    yield ""
    yield f"[events.{kind.label}]"
    if code == ReturnCode.OK:
        yield 'claim = "yes"'
        yield f'how   = "{slot} answers OK"'
        if kind is EventKind.LIVELINESS_LOST:
            yield from _liveliness(answers)
        return
    yield 'claim   = "no"'
    yield 'absent  = "not-wired"'
    yield f"because = {_text(_why(answers, slot, code))}"
    if kind.side is Side.PUBLISHER and kind is EventKind.LIVELINESS_LOST:
        yield from _liveliness(answers)


def _liveliness(answers: Answers) -> Iterator[str]:
    by_topic = answers.creating["liveliness.manual_by_topic"]
    by_node = answers.creating["liveliness.manual_by_node"]
    if by_topic != ReturnCode.OK and by_node != ReturnCode.OK:
        yield f"manual = false                  # creating one {_answer(by_topic)}"
    elif by_node != ReturnCode.OK:
        yield f'manual_by_node = "refused"      # creating one {_answer(by_node)}'


def _ping(answers: Answers) -> Iterator[str]:
    if answers.ping == ReturnCode.OK:
        yield 'ping = "round_trip"'
        return
    yield 'ping    = "no"'
    yield 'absent  = "not-wired"'
    yield f"because = {_text(_why(answers, 'ping_session', answers.ping))}"


def _why(answers: Answers, slot: str, code: int) -> str:
    if slot in answers.null_slots:
        return f"the slot {slot} is NULL"
    return f"{slot} {_answer(code)}"


def _answer(code: int) -> str:
    return "crashes" if code == CRASHED else f"answers {code_name(code)}"


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)  # a basic string of TOML escapes as JSON does
