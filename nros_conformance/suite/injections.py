"""The faults that `Backend.inject` can be asked for: what each one hits, and what has to be said of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from typing import Literal

from nros_conformance.formats.places import Path_
from nros_conformance.rmw.events import Side
from nros_conformance.suite.names import Names
from nros_conformance.suite.schema import Fault


@dataclasses.dataclass(frozen=True, slots=True)
class Injection:
    """One fault. ``declared``: the keys of ``[faults]`` by any of which a backend says that it can."""

    of: Literal["publisher", "entity", "session"]
    declared: tuple[str, ...]
    counted: bool = False
    publishes: bool = False
    """Whether the step itself publishes ``count`` samples, under its label."""
    directed: bool = False
    lasting: bool = False
    """Whether ``by:`` says how long."""


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
    "inject": Injection("session", ("inject",), counted=True),
    "clock_step": Injection("session", ("clock_step",), lasting=True),
    "crash": Injection("session", ("crash",)),
    "freeze": Injection("session", ("freeze",)),
    "thaw": Injection("session", ("freeze",)),
}
"""By the name of the fault, for backends that declare it. What is done to a process of its own, the last four, a
backend declares only if its processes are simulated, or share what they must not."""


def injectable(fault: str, declared: Collection[str]) -> bool:
    """Whether a backend that declares these faults can be asked for this one."""
    return fault in INJECTIONS and any(key in declared for key in INJECTIONS[fault].declared)


def publishes(step: object) -> bool:
    """Whether a step is a fault that publishes."""
    return isinstance(step, Fault) and step.fault in INJECTIONS and INJECTIONS[step.fault].publishes


def check_injection(names: Names, path: Path_, step: Fault) -> None:
    """Raise `FormatError` unless the fault says whom it hits, and how often."""
    error, injection = names.document.error, INJECTIONS.get(step.fault)
    if step.kind is not None and step.fault != "preset":
        raise error((*path, "kind"), f"kind: {step.fault} is about no event", "remove it")
    if injection is None:
        return
    if step.of is None:
        raise error(path, f"{step.fault} without of:", f"add of: and a {injection.of}")
    here = (*path, "of")
    if injection.of == "session":
        names.check_session(here, step.of)
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
