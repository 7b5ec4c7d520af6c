"""What steps about the connection must keep to: ping, until, repeat, and what the peer is asked."""

from __future__ import annotations

from nros_conformance.formats.places import Path_
from nros_conformance.rmw.events import Side
from nros_conformance.suite import schema
from nros_conformance.suite.names import Names
from nros_conformance.suite.walk import base_name, session_of

_UNTIL: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "heard": (("by", "of"), ()),
    "reported": (("session",), ("by",)),
    "reachable": ((), ()),
    "connected": (("session",), ()),
}
"""By what is waited for: the keys that it needs, and those that it may have beside."""


def check_connection(names: Names, path: Path_, step: schema.Step) -> None:
    """Raise `FormatError` for the first thing that is wrong with a step of these kinds."""
    error = names.document.error
    if isinstance(step, schema.Ping):
        if step.session is not None:
            names.check_session((*path, "session"), step.session)
        if step.attempts < 1:
            raise error((*path, "attempts"), f"attempts: {step.attempts} is less than 1")
    if isinstance(step, schema.Until):
        _check_until(names, path, step)
    if isinstance(step, schema.Repeat):
        if step.repeat < 1:
            raise error((*path, "repeat"), f"repeat: {step.repeat} is less than 1")
        if not step.script:
            raise error(path, "repeat without a step", "add one or more to its script:")
    if isinstance(step, schema.Measure):
        if step.what == "listed" and step.of is None:
            raise error(path, "listed without of:", "add of: and an entity")
        if step.what != "listed" and step.of is not None:
            raise error((*path, "of"), f"of: {step.what} is of no single entity", "remove it")
        if step.of is not None:
            names.check_entities((*path, "of"), [step.of])


def _check_until(names: Names, path: Path_, step: schema.Until) -> None:
    error, (needed, allowed) = names.document.error, _UNTIL[step.until]
    for key in ("by", "of", "session"):
        given = getattr(step, key) is not None
        if key in needed and not given:
            raise error(path, f"{step.until} without {key}:", f"add {key}:")
        if given and key not in needed and key not in allowed:
            raise error((*path, key), f"{key}: {step.until} has no use for it", "remove it")
    if step.session is not None:
        names.check_session((*path, "session"), step.session)
    if step.by is not None:
        names.check_entities((*path, "by"), [step.by], Side.PUBLISHER)
    if step.of is not None:
        here = (*path, "of")
        names.check_entities(here, [step.of], Side.SUBSCRIPTION)
        if names.scenario.entities[base_name(step.of)].take != "always":
            raise error(here, f"of: {step.of!r} takes nothing by itself", "add take: always to the entity")
    for key, session_ in (
        ("session", step.session),
        *((key, _session(names, getattr(step, key))) for key in ("by", "of")),
    ):
        if session_ in names.scenario.sessions and names.scenario.sessions[session_].process == "own":
            raise error((*path, key), f"{key}: session {session_!r} is in a process of its own", "name one that is not")
    if step.until == "connected":
        session = names.scenario.sessions.get(step.session or "")
        if session is None or not session.reconnector:
            raise error((*path, "session"), f"session: {step.session!r} has no reconnector", "add reconnector: true")


def _session(names: Names, entity: str | None) -> str | None:
    return None if entity is None else session_of(names.scenario.entities[base_name(entity)])
