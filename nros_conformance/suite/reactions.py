"""What the reactions of a scenario must keep to: calls on the callback's own session, made at once."""

from __future__ import annotations

from nros_conformance.formats.places import Path_
from nros_conformance.suite import schema
from nros_conformance.suite.names import SUBJECTS, Names, word
from nros_conformance.suite.walk import base_name, fields, reaction_steps, session_of, steps

_CALLS = (
    schema.Publish, schema.Assert, schema.Take, schema.HasData, schema.Register, schema.Supports, schema.Create,
    schema.Destroy, schema.Call, schema.Raise,
)  # fmt: skip


def check_reactions(names: Names) -> None:
    """Raise `FormatError` for the first thing that is wrong."""
    scenario, error = names.scenario, names.document.error
    for index, reaction in enumerate(scenario.react):
        here = ("react", index)
        names.check_entities((*here, "of"), [reaction.of])
        names.check_side((*here, "of"), reaction.to, reaction.of)
        if reaction.times < 1:
            raise error((*here, "times"), f"times: {reaction.times} is less than 1")
        if not reaction.script:
            raise error(here, "a reaction that does nothing", "add a step to its script:")
    for _, reaction, path, step in reaction_steps(scenario):
        if not isinstance(step, _CALLS):
            raise error(path, f"a callback cannot do a step with {word(type(step))}", "leave it to the script:")
        if step.at is not None:
            raise error((*path, "at"), "at: a callback does its steps at once", "remove it")
        if isinstance(step, schema.Repeated) and step.every.terms:
            raise error((*path, "every"), "every: a callback does its steps at once", "remove it")
        if isinstance(step, schema.Raise) and step is not reaction.script[-1]:
            raise error(path, "nothing happens after do: raise", "make it the last step")
        _check_session(names, path, reaction, step)
    inside = {step.as_ for _, _, _, step in reaction_steps(scenario)} - {None}
    for path, step in steps(scenario):
        if isinstance(step, schema.Raise) and path[0] != "react":
            raise error(path, "only a callback can raise", "write it under react:")
        if step.at is not None and step.at.label in inside:
            raise error((*path, "at"), f"at: {step.at.label!r} may never happen", "wait for a step of the script")


def _check_session(names: Names, path: Path_, reaction: schema.Reaction, step: schema.Step) -> None:
    own = session_of(names.scenario.entities[base_name(reaction.of)])
    key, other = "", own
    if isinstance(step, schema.Call):
        key, other = "session", step.session
    elif isinstance(step, schema.Destroy) and step.of in names.sessions:
        key, other = "of", step.of
    elif type(step) in SUBJECTS or isinstance(step, schema.Destroy):
        key = "of" if isinstance(step, schema.Destroy) else SUBJECTS[type(step)][0]
        other = session_of(names.scenario.entities[base_name(dict(fields(step))[key])])
    if other != own:
        raise names.document.error(
            (*path, key),
            f"{key}: the callback runs on the session {own!r}, and this is of {other!r}",
            "it can only call what is of its own session",
        )
