"""Whether there can be evidence about an event at all: claimed, registered, and what refused it."""

from __future__ import annotations

from typing import Literal, NamedTuple

from nros_conformance.judge.findings import Judged, code_words
from nros_conformance.judge.index import Index
from nros_conformance.rmw.events import KIND_BY_LABEL, kind_label


class Standing(NamedTuple):
    """``reason`` says why not ``registered``."""

    state: Literal["registered", "unclaimed", "refused", "absent", "unknown"]
    reason: str = ""


def answered(call: str, code: int) -> str:
    """``register answered UNSUPPORTED (-5)``."""
    return f"{call} answered {code_words(code)}"


def number(kind: object) -> int | None:
    """The value of a kind as registrations record it, by number or by name."""
    return KIND_BY_LABEL.get(kind) if isinstance(kind, str) else kind if isinstance(kind, int) else None


def standing(index: Index, entity: str, kind: str) -> Standing:
    """Of a kind on an entity. In the scenario that proves its absence it is judged whatever was answered."""
    if index.scenario.refusal == kind:
        return Standing("registered")
    if index.header.claims.get(kind) == "no":
        return Standing("unclaimed", f"{kind} is not claimed")
    value = KIND_BY_LABEL[kind]
    codes = [one.code for _, one in index.registered if one.entity == entity and one.kind == value]
    codes += [
        act.result
        for _, act in index.all_acts
        if act.op == "register" and act.entity == entity and number(act.args.get("kind")) == value
        if isinstance(act.result, int)
    ]
    if 0 in codes:
        return Standing("registered")
    if not index.whole:
        return Standing("unknown", f"{kind} is not yet registered on {entity}")
    if codes:
        return Standing("refused", answered("register", codes[-1]))
    refusals = [one.code for _, one in index.states if one.what == "refused" and one.entity == entity]
    if refusals:
        return Standing("refused", answered(f"creating {entity}", refusals[-1]))
    return Standing("absent", f"{kind_label(value)} is not registered on {entity}")


def excused(index: Index, entity: str, kind: str, *, needs_event: bool) -> Judged | None:
    """The judgement when there is no registration to judge by, None when there is one.

    A claimed event whose registration was refused fails whatever ``needs_event``; without it silence
    proves nothing.
    """
    state, reason = standing(index, entity, kind)
    if state == "registered":
        return None
    if state == "refused" and needs_event:
        return Judged("fail", got=reason)
    return Judged("unclear" if state == "unknown" else "none", got=reason)
