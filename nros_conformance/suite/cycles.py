"""What cycles and measurements must keep to."""

from __future__ import annotations

from nros_conformance.formats.places import Path_
from nros_conformance.suite import schema
from nros_conformance.suite.names import Names, word

_ONCE = (schema.Parallel, schema.Idle, schema.Cycle, schema.Fault, schema.Spin, schema.Measure)


def check_cycle(names: Names, path: Path_, step: schema.Cycle) -> None:
    """Raise `FormatError` unless every step can be played again and again, and summed up."""
    error = names.document.error
    if step.cycle < 1:
        raise error((*path, "cycle"), f"cycle: {step.cycle} is less than 1")
    if not step.script:
        raise error(path, "cycle without a step", "add one to its script:")
    for index, one in enumerate(step.script):
        here = (*path, "script", index)
        if isinstance(one, _ONCE):
            raise error(here, f"a step with {word(type(one))} cannot be repeated", "write it before or after the cycle")
        if one.at is not None:
            raise error((*here, "at"), "at: each cycle does its steps one after the other", "remove it")


def check_measure(names: Names, path: Path_, step: schema.Measure) -> None:
    """Quantities of a process say nothing while others share it, and virtual time costs no processor time."""
    if step.what not in ("cpu", "threads", "descriptors", "memory"):
        return  # the peer tells it
    needs = names.scenario.needs
    if needs.process != "own":
        raise names.document.error(path, "others share the process", "add needs: {process: own}")
    if step.what == "cpu" and needs.clock != "real":
        raise names.document.error(path, "virtual time costs no processor time", "add needs: {clock: real}")


def check_cycles(names: Names, path: Path_, part: schema.Cycles) -> None:
    """One thing at a time is expected of the cycles."""
    error = names.document.error
    if sum(one is not None for one in (part.step, part.sampled, part.event)) != 1:
        raise error(path, "cycles: says not what to expect", "add one of step:, sampled: and event:")
    if (part.step is not None) is not bool(part.is_):
        raise error(path, "cycles: is: belongs to step:", "write both or neither")
    if (part.event is None) is not (part.of is None):
        raise error(path, "cycles: of: belongs to event:", "write both or neither")
    if part.sampled is not None:
        names.check_entities((*path, "sampled"), [part.sampled])
