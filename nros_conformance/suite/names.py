"""The names of a scenario: entities, sessions and labels, and whether what refers to them fits."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from nros_conformance.formats.places import Document, FormatError, Path_, nearest
from nros_conformance.rmw.events import KIND_BY_LABEL, Side
from nros_conformance.suite import schema
from nros_conformance.suite.moments import Moment
from nros_conformance.suite.walk import base_name, fields, members, session_of, steps

RESERVED = ("start", "end")
"""Moments that every script has."""

SUBJECTS: dict[type[schema.Base], tuple[str, Side | None]] = {
    schema.Publish: ("by", Side.PUBLISHER),
    schema.Assert: ("by", Side.PUBLISHER),
    schema.Take: ("from", Side.SUBSCRIPTION),
    schema.HasData: ("of", Side.SUBSCRIPTION),
    schema.Register: ("of", None),
    schema.Supports: ("of", None),
    schema.Create: ("entity", None),
    schema.Level: ("of", Side.SUBSCRIPTION),
    schema.Received: ("of", Side.SUBSCRIPTION),
    schema.ReceivedGiven: ("of", Side.SUBSCRIPTION),
    schema.Conserved: ("conserved", Side.SUBSCRIPTION),
}
"""Which field of a step or expectation names its entities, and of which side they must be."""


class Names:
    """What may be referred to. Raises `FormatError` for a name that is given twice or is reserved."""

    def __init__(self, document: Document, scenario: schema.Scenario) -> None:
        self.document = document
        self.scenario = scenario
        self.sides = {
            name: Side.SUBSCRIPTION if entity.publisher is None else Side.PUBLISHER
            for name, entity in scenario.entities.items()
        }
        self.members = {one for name, entity in scenario.entities.items() for one in members(name, entity)}
        self.sessions = {session_of(entity) for entity in scenario.entities.values()} | set(scenario.sessions)
        self.labels: dict[str, schema.Step] = {}
        for name in scenario.entities:
            if name in (*RESERVED, "ALL", "ANY"):
                raise document.error(("entities", name), f"{name!r} is reserved", "choose another name for this entity")
            if name in self.sessions:
                raise document.error(
                    ("entities", name), f"{name!r} names an entity and a session", "rename one of the two"
                )
        self._turns = {id(step): 1 for _, step in steps(scenario)}
        """How often a step is played, by the repeats around it."""
        for path, step in steps(scenario):
            if isinstance(step, schema.Repeat):
                for other, inner in steps(scenario):
                    if other[: len(path)] == path and inner is not step:
                        self._turns[id(inner)] *= max(step.repeat, 1)
        self._collect_labels()

    def _collect_labels(self) -> None:
        lines: dict[str, int] = {}
        for path, step in steps(self.scenario):
            if (label := step.as_) is None:
                continue
            here = (*path, "as")
            if label in RESERVED:
                raise self.document.error(here, f"the label {label!r} is reserved", "choose another one")
            if label in self.sides:
                line = self.document.line(("entities", label))
                raise self.document.error(
                    here, f"the label {label!r} is also an entity", f"rename one of the two; that one is in line {line}"
                )
            if label in self.labels:
                raise self.document.error(
                    here, f"the label {label!r} stands here twice", f"the first is in line {lines[label]}"
                )
            self.labels[label], lines[label] = step, self.document.line(here)

    # --- what refers to them: each raises `FormatError` ---------------------------------------------

    def check_subjects(self, path: Path_, part: schema.Base) -> None:
        """The entities that a step or expectation is about exist and are of the right side."""
        if type(part) in SUBJECTS:
            key, side = SUBJECTS[type(part)]
            value = dict(fields(part))[key]
            self.check_entities((*path, key), [value] if isinstance(value, str) else value, side)

    def check_entities(
        self, path: Path_, names: Iterable[str], side: Side | None = None, others: Iterable[str] = ()
    ) -> None:
        """These entities exist, and are of this side; ``others`` would have done as well."""
        for name in names:
            if name not in self.members and name not in self.sides:
                known = [*self.sides, *sorted(self.members - set(self.sides)), *sorted(others)]
                raise self.unknown(path, "entity", name, known)
            found = self.sides[base_name(name)]
            if side is not None and found is not side:
                raise self.document.error(path, f"{path[-1]}: {name!r} is a {found.value}", f"name a {side.value}")

    def check_session(self, path: Path_, name: str) -> None:
        """This session exists."""
        if name not in self.sessions:
            raise self.unknown(path, "session", name, sorted(self.sessions))

    def check_side(self, path: Path_, kind: str, name: str) -> None:
        """This kind can be registered on this entity."""
        side, wanted = self.sides[base_name(name)], KIND_BY_LABEL[kind].side
        if side is not wanted:
            raise self.document.error(
                path, f"{kind} is an event of a {wanted.value}, {name!r} is a {side.value}", f"name a {wanted.value}"
            )

    def step(self, path: Path_, label: str) -> schema.Step:
        """The step with this label."""
        if label not in self.labels:
            raise self.unknown(path, "label", label, list(self.labels))
        return self.labels[label]

    def check_moment(self, path: Path_, moment: Moment) -> None:
        """There is such a moment."""
        label, wrong = moment.label, ""
        if label in RESERVED:
            if moment.kind is not None or moment.index is not None or moment.edge not in (None, "settled"):
                wrong = f"{label!r} is one moment"
        elif label in self.labels:
            wrong = self._step_moment(moment, self.labels[label])
        elif label in self.members or label in self.sides:
            wrong = self._entity_moment(path, moment)
        else:
            raise self._unknown_moment(path, moment)
        if wrong:
            raise self.document.error(path, f"{path[-1]}: there is no moment {moment.text!r}: {wrong}")

    def unknown(self, path: Path_, what: str, name: str, known: Sequence[str]) -> FormatError:
        """An error to raise, with the nearest name as the remedy."""
        remedy = nearest(name, known) or f"the scenario has no {what}"
        return self.document.error(path, f"unknown {what} {name!r}", remedy)

    # --- moments ------------------------------------------------------------------------------------

    def _step_moment(self, moment: Moment, step: schema.Step) -> str:
        label = moment.label
        if moment.kind is not None or moment.edge == "created":
            return f"{label!r} is a step and not an entity"
        if moment.edge == "settled" and not isinstance(step, schema.Settle):
            return f"{label!r} is a step with {word(type(step))} and not with do: settle"
        times = self._times(step)
        if moment.index is not None and not -times <= moment.index < times:
            return f"{label!r} happens {'once' if times == 1 else f'{times} times'}"
        return ""

    def _times(self, step: schema.Step) -> int:
        """How many calls a step makes: one for each entity that it names, each time."""
        times = step.times if isinstance(step, schema.Repeated) else 1
        if isinstance(step, schema.Fault):
            times = step.count or 1
        times *= self._turns[id(step)]
        key = "of" if isinstance(step, schema.Destroy) else SUBJECTS.get(type(step), ("", None))[0]
        entity = self.scenario.entities.get(dict(fields(step)).get(key, ""))
        return times * (entity.count if entity else 1)

    def _entity_moment(self, path: Path_, moment: Moment) -> str:
        name = moment.label
        if moment.kind is None:
            if moment.edge not in ("created", "settled") or moment.index is not None:
                return f"{name!r} is an entity; write {name}.created, {name}.settled or {name}.EVENT[0]"
        elif moment.kind not in KIND_BY_LABEL:
            raise self.unknown(path, "event", moment.kind, list(KIND_BY_LABEL))
        else:
            self.check_side(path, moment.kind, name)
        return ""

    def _unknown_moment(self, path: Path_, moment: Moment) -> FormatError:
        label = moment.label
        known = [*self.labels, *self.sides, *RESERVED]
        for cut, character in enumerate(label):
            if character == "-" and label[:cut] in known:  # labels may contain hyphens
                spaced = f"{label[:cut]} - {label[cut + 1 :]}"
                return self.document.error(path, f"unknown label {label!r}", f"to subtract, write spaces: {spaced}")
        return self.unknown(path, "label", label, known)


def word(type_: type[schema.Base]) -> str:
    """How a suite writes a step of this type: ``do: publish``, ``idle:``."""
    doing = next((word for word, known in schema.DOINGS.items() if known is type_), None)
    return f"do: {doing}" if doing else next(f"{word}:" for word, known in schema.STEPS.items() if known is type_)
