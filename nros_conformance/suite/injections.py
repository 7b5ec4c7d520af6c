"""The faults that `Backend.inject` can be asked for: what each one hits, and what has to be said of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from typing import Literal

from nros_conformance.formats.places import Path_
from nros_conformance.rmw.events import Side
from nros_conformance.suite.names import Names
from nros_conformance.suite.schema import Fault, Session


@dataclasses.dataclass(frozen=True, slots=True)
class Injection:
    """One fault. ``declared``: the keys of ``[faults]`` by any of which a backend says that it can."""

    of: Literal["publisher", "entity", "session", "peer"]
    declared: tuple[str, ...]
    counted: bool = False
    publishes: bool = False
    """Whether the step itself publishes ``count`` samples, under its label."""
    directed: bool = False
    lasting: bool = False
    """Whether ``by:`` says how long."""
    apart: bool = False
    """Whether it hits the process of the session, so that this needs one of its own."""


INJECTIONS = {
    "lose": Injection("publisher", ("lose",), counted=True, publishes=True),
    "duplicate": Injection("publisher", ("duplicate",), counted=True, publishes=True),
    "reorder": Injection("publisher", ("reorder",), counted=True, publishes=True),
    "preset": Injection("entity", ("preset",), counted=True),
    "partition": Injection("session", ("partition",)),
    "block": Injection("session", ("block",), directed=True),
    "delay": Injection("session", ("delay",), lasting=True),
    "stall": Injection("session", ("stall",)),
    "bus_off": Injection("session", ("bus_off",)),
    "heal": Injection("session", ("partition", "block", "delay", "stall", "bus_off")),
    "crash": Injection("session", ("crash",), apart=True),
    "freeze": Injection("session", ("freeze",), apart=True),
    "thaw": Injection("session", ("freeze",), apart=True),
    "clock_step": Injection("session", ("clock_step",), lasting=True, apart=True),
    "inject": Injection("session", ("inject",), counted=True),
    "stop": Injection("peer", ("stop",)),
    "start": Injection("peer", ("stop",)),
}
"""By the name of the fault."""


def injectable(fault: str, declared: Collection[str]) -> bool:
    """Whether a backend that declares these faults can be asked for this one."""
    return fault in INJECTIONS and any(key in declared for key in INJECTIONS[fault].declared)


def about_the_peer(step: Fault) -> bool:
    """Whether a fault hits the peer and no session."""
    return step.fault in INJECTIONS and INJECTIONS[step.fault].of == "peer"


def publishes(step: object) -> bool:
    """Whether a step is a fault that publishes."""
    return isinstance(step, Fault) and step.fault in INJECTIONS and INJECTIONS[step.fault].publishes


def check_injection(names: Names, path: Path_, step: Fault) -> None:
    """Raise `FormatError` unless the fault says whom it hits, and how often."""
    error, injection = names.document.error, INJECTIONS.get(step.fault)
    if step.kind is not None and step.fault != "preset":
        raise error((*path, "kind"), f"kind: {step.fault} is about no event", "remove it")
    if step.kill and step.fault != "stop":
        raise error((*path, "kill"), f"kill: {step.fault} ends no peer", "remove it")
    if injection is None:
        return
    if injection.of == "peer":
        if step.of is not None:
            raise error((*path, "of"), f"of: {step.fault} is about the peer, which has no name", "remove it")
        return
    if step.of is None:
        raise error(path, f"{step.fault} without of:", f"add of: and a {injection.of}")
    here = (*path, "of")
    if injection.of == "session":
        names.check_session(here, step.of)
        if injection.apart and names.scenario.sessions.get(step.of, Session()).process != "own":
            remedy = f"add sessions: {{{step.of}: {{process: own}}}}"
            raise error(here, f"{step.fault} hits a process, and session {step.of!r} shares one", remedy)
    else:
        names.check_entities(here, [step.of], Side.PUBLISHER if injection.of == "publisher" else None)
    if step.kind is not None:
        names.check_side(here, step.kind, step.of)
    needed_keys = (("count", injection.counted), ("direction", injection.directed), ("by", injection.lasting))
    for key, needed in needed_keys:
        if needed and getattr(step, key) is None:
            raise error(path, f"{step.fault} without {key}:", f"add {key}:")
    least = 1 if injection.publishes else 0
    if step.count is not None and step.count < least:
        raise error((*path, "count"), f"count: {step.count} is less than {least}")
