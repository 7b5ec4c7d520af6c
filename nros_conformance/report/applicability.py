"""What a declaration restricts, and which requirements it makes not applicable.

REQUIREMENTS section 4 lists what it may; there is nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from nros_conformance.rmw.declaration import Declaration
from nros_conformance.rmw.events import EventKind

_LVC, _RDM, _MSL, _LVL, _ODM = EventKind
_COUNTED = (_RDM, _MSL, _LVL, _ODM)
_TIMED = (_RDM, _LVL, _ODM)
_ANY = tuple(EventKind)

GROUP_KINDS: Mapping[str, EventKind] = {"LVC": _LVC, "RDM": _RDM, "MSL": _MSL, "LVL": _LVL, "ODM": _ODM}
"""Groups of requirements that belong to one event."""

_NEEDS: Mapping[str, tuple[EventKind, ...]] = {
    "REG-005": _ANY, "REG-006": _ANY, "REG-007": _ANY, "REG-008": (_RDM, _ODM), "REG-009": (_LVC,),
    "DSP-001": _ANY, "DSP-002": _ANY, "DSP-003": _ANY, "DSP-004": _ANY, "DSP-007": _TIMED, "DSP-009": _ANY,
    "CNT-001": _COUNTED, "CNT-002": _COUNTED, "CNT-003": _ANY, "CNT-004": (_LVC,), "CNT-005": (_LVC,),
    "CNT-006": _ANY, "CNT-007": _ANY, "LIF-003": _ANY,
}  # fmt: skip
"""Base rules about the callbacks or payload of events: refused if all of these events are refused."""


def limits(declaration: Declaration, kind: EventKind) -> dict[str, object]:
    """What restricts the claim of an event: the declared limit, and choices that are restrictions by themselves."""
    event = declaration.event(kind)
    found: dict[str, object] = dict(event.limit)
    if event.dispatch == "own_call":
        found["dispatch"] = "own_call"
    if kind is _LVC and event.presence_only:
        found["presence_only"] = True
    return found


def is_limited(declaration: Declaration, kind: EventKind) -> bool:
    """Whether a claimed event prints *limited* at best."""
    claim = declaration.event(kind).claim
    return claim == "limited" or (claim == "yes" and bool(limits(declaration, kind)))


def _no_overflow(declaration: Declaration) -> bool:
    event = declaration.event(_MSL)
    return "overflow" not in event.sources or "overflow" not in event.limit.get("sources", ["overflow"])


def _no_manual(declaration: Declaration) -> bool:
    return not declaration.event(_LVL).manual


def _no_peer(declaration: Declaration) -> bool:
    return declaration.connection.peer == "none"


def _no_ping(declaration: Declaration) -> bool:
    return declaration.connection.ping == "no"


def _no_hard_liveliness(declaration: Declaration) -> bool:
    return declaration.connection.hard_liveliness.claim == "no"


_MAY: Mapping[str, tuple[tuple[Callable[[Declaration], bool], str], ...]] = {
    "REG-001": ((lambda d: d.behaviour.derived_support, "supports_event is derived from return codes"),),
    "DSP-008": ((lambda d: not d.behaviour.callback_cap, "callback_cap = false"),),
    "DSP-011": ((lambda d: d.behaviour.two_sessions == "second_fails", 'two_sessions = "second_fails"'),),
    "LVL-003": ((_no_manual, "manual = false"),),
    "LVL-004": ((_no_manual, "manual = false"),),
    "LVL-006": ((_no_manual, "manual = false"),),
    "MSL-007": ((_no_overflow, "overflow is not a declared source"),),
    # CON-001 is asked of everyone: without a round trip ping answers UNSUPPORTED.
    "CON-002": ((_no_ping, 'ping = "no"'),),
    "CON-003": ((_no_ping, 'ping = "no"'),),
    "CON-004": ((_no_peer, 'peer = "none"'),),
    "CON-005": ((_no_peer, 'peer = "none"'),),
    "CON-006": ((_no_peer, 'peer = "none"'),),
    "CON-007": ((_no_peer, 'peer = "none"'),),
    "CON-008": ((_no_hard_liveliness, 'hard_liveliness.claim = "no"'),),
    "CON-009": ((_no_hard_liveliness, 'hard_liveliness.claim = "no"'),),
    "CON-010": ((_no_hard_liveliness, 'hard_liveliness.claim = "no"'),),
}


def not_applicable(requirement: str, declaration: Declaration) -> str:
    """Why a requirement leaves the count; empty when it applies."""
    group = requirement.partition("-")[0]
    kinds = (GROUP_KINDS[group],) if group in GROUP_KINDS else _NEEDS.get(requirement, ())
    if kinds and all(declaration.event(kind).claim == "no" for kind in kinds):
        return f"{kinds[0].label} is not claimed" if len(kinds) == 1 else "none of its events is claimed"
    return next((reason for holds, reason in _MAY.get(requirement, ()) if holds(declaration)), "")
