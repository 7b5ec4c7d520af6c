"""What a scenario must keep to beyond the types of its parts, so that it can be played and judged."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nros_conformance.formats.durations import Duration
from nros_conformance.formats.places import Document, Path_, nearest
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.declaration import Declaration, Subject
from nros_conformance.rmw.events import KIND_BY_LABEL, CountStatus, EventKind, LivelinessChangedStatus, Side
from nros_conformance.suite import schema
from nros_conformance.suite.anchors import check_anchors
from nros_conformance.suite.catalogue import Requirements
from nros_conformance.suite.connection import check_connection
from nros_conformance.suite.cycles import check_cycle, check_cycles, check_measure
from nros_conformance.suite.injections import check_injection, publishes
from nros_conformance.suite.kinds import expected_entities, expected_kinds
from nros_conformance.suite.names import Names, word
from nros_conformance.suite.reactions import check_reactions
from nros_conformance.suite.walk import base_name, expectations, fields, givens, moments, parts, session_of, steps

ANSWERS = (*(code.name for code in ReturnCode), "ANY_ERROR", "DATA", "true", "false")
"""What ``returns`` may ask for."""

COUNT_MAX = 1000
"""Entities of one entry: far more than any backend carries, few enough to be named one by one."""

_CALLS = (schema.Call, schema.Spin)
_ANSWERING = (
    schema.Publish, schema.Assert, schema.Take, schema.HasData, schema.Register, schema.Supports, schema.Create,
    schema.Destroy, schema.Released, schema.Ping, schema.Until, *_CALLS,
)  # fmt: skip
_LABELS: dict[type[schema.Base], tuple[tuple[str, tuple[type[schema.Step], ...]], ...]] = {
    schema.GapGiven: (("gap", (*_ANSWERING, schema.Measure)),),
    schema.Agrees: (("agrees", (schema.Supports,)), ("with", (schema.Register,))),
    schema.Received: (("received", (schema.Publish,)),),
    schema.ReceivedGiven: (("received", (schema.Publish,)),),
    schema.Inside: (("inside", _CALLS),),
    schema.Callback: (("callback", (schema.Register,)),),
    schema.Callbacks: (("callbacks", _CALLS),),
    schema.Takes: (("takes", (*_ANSWERING, schema.Settle)),),
    schema.Measured: (("from", (schema.Measure,)), ("to", (schema.Measure,))),
    schema.Counted: (("counted", (schema.Measure,)), ("since", (schema.Measure,))),
    schema.Cycles: (("cycles", (schema.Cycle,)), ("step", (*_ANSWERING, schema.Settle))),
    schema.Released: (("registration", (schema.Register,)),),
}
"""Which fields name labels, and of which steps."""


def check(document: Document, scenario: schema.Scenario, requirements: Requirements) -> None:
    """Raise `FormatError` for the first thing that is wrong; ``document`` holds the plain data."""
    _Check(document, scenario, requirements).run()


class _Check:
    def __init__(self, document: Document, scenario: schema.Scenario, requirements: Requirements) -> None:
        self.document = document
        self.error = document.error
        self.scenario = scenario
        self.requirements = requirements
        for name, entity in scenario.entities.items():
            self._shape(("entities", name), name, entity)
        self.names = Names(document, scenario)

    def run(self) -> None:
        self._scale_and_needs()
        for name, session in self.scenario.sessions.items():
            self._durations(("sessions", name), session)
        for name, entity in self.scenario.entities.items():
            self._entity(("entities", name), name, entity)
        for path, step in steps(self.scenario):
            self._step(path, step)
        check_reactions(self.names)
        self._sessions_are_used()
        for path, given in givens(self.scenario):
            self._given(path, given)
        if not self.scenario.expect:
            raise self.error(("expect",), "the scenario expects nothing", "say what it proves")
        for path, expectation in expectations(self.scenario):
            self._expectation(path, expectation)
        for path, part in parts(self.scenario):
            self._durations(path, part)
            for key, moment in moments(part):
                self.names.check_moment((*path, key), moment)
        check_anchors(self.document, self.scenario)

    # --- who takes part -----------------------------------------------------------------------------

    def _shape(self, path: Path_, name: str, entity: schema.Entity) -> None:
        if entity.publisher is not None and entity.subscription is not None:
            raise self.error(path, f"{name!r} is both a publisher and a subscription", "keep one of the two keys")
        if entity.publisher is None and entity.subscription is None:
            raise self.error(
                path, f"{name!r} is neither a publisher nor a subscription", "add publisher: or subscription:"
            )
        self._not_below((*path, "count"), entity.count, 1)
        if entity.count > COUNT_MAX:
            raise self.error((*path, "count"), f"count: {entity.count} is more than {COUNT_MAX}")

    def _entity(self, path: Path_, name: str, entity: schema.Entity) -> None:
        for kind in entity.register if isinstance(entity.register, list) else ():
            self.names.check_side((*path, "register"), kind, name)
        self._durations(path, entity)
        self._durations((*path, "qos"), entity.qos)

    def _scale_and_needs(self) -> None:
        scale, here = self.scenario.scale.T, ("scale", "T")
        if scale.names:
            raise self.error(here, f"T: {scale} depends on {min(scale.names)}", "give a plain duration such as 130ms")
        if scale.ns({}) <= 0:
            raise self.error(here, f"T: {scale} is not a positive duration")
        known = _capabilities()
        for name in self.scenario.needs.declares:
            if name not in known:
                raise self.error(
                    ("needs", "declares", name), f"declarations have no field {name!r}", nearest(name, known)
                )

    def _sessions_are_used(self) -> None:
        """Sessions come into being by being named, so one with an entry that nothing names is misspelt somewhere."""
        populated = {session_of(entity) for entity in self.scenario.entities.values()}
        named = {value for _, part in parts(self.scenario) for _, value in fields(part) if isinstance(value, str)}
        for name in self.scenario.sessions:
            if name not in populated | named:
                remedy = nearest(name, sorted(populated)) or "put an entity into it"
                raise self.error(("sessions", name), f"nothing names the session {name!r}", remedy)

    # --- what happens -------------------------------------------------------------------------------

    def _step(self, path: Path_, step: schema.Step) -> None:
        self.names.check_subjects(path, step)
        if isinstance(step, schema.Parallel):
            self._groups((*path, "parallel"), "branch", step.parallel)
        check_connection(self.names, path, step)
        if isinstance(step, schema.Repeated):
            self._not_below((*path, "times"), step.times, 1)
        if isinstance(step, schema.Cycle):
            check_cycle(self.names, path, step)
        if isinstance(step, _CALLS):
            self.names.check_session((*path, "session"), step.session)
        self._labels(path, step)
        sessions = self.names.sessions
        if isinstance(step, (schema.Destroy, schema.Fault)) and step.of is not None and step.of not in sessions:
            self.names.check_entities((*path, "of"), [step.of], others=sessions)
        if isinstance(step, schema.Create):
            self._create((*path, "entity"), base_name(step.entity))
        if isinstance(step, schema.Fault):
            check_injection(self.names, path, step)
        if isinstance(step, schema.Measure):
            check_measure(self.names, path, step)

    def _create(self, path: Path_, name: str) -> None:
        entity = self.scenario.entities[name]
        gone = {base_name(step.of) for _, step in steps(self.scenario) if isinstance(step, schema.Destroy)}
        if not entity.deferred and not gone & {name, session_of(entity)}:
            raise self.error(path, f"{name!r} exists from the start", "add deferred: true to the entity")

    # --- what is expected ---------------------------------------------------------------------------

    def _given(self, path: Path_, given: schema.Base) -> None:
        self._labels(path, given)
        self.names.check_subjects(path, given)
        if isinstance(given, schema.DrivenGiven):
            self.names.check_session((*path, "driven"), given.driven)
        if isinstance(given, schema.ReturnsGiven):
            self._returns(path, given)
        if isinstance(given, schema.GapGiven) and given.max is None and given.min is None:
            raise self.error(path, "gap without a bound", "add max: or min:")

    def _expectation(self, path: Path_, expectation: schema.Expectation) -> None:
        known = [one.id for one in self.requirements]
        for requirement in expectation.requirements:
            if requirement not in known:
                raise self.names.unknown((*path, "proves"), "requirement", requirement, known)
        self._labels(path, expectation)
        self.names.check_subjects(path, expectation)
        self._events(path, expectation)
        if isinstance(expectation, schema.Conserved):
            self.names.check_entities((*path, "from"), expectation.from_, Side.PUBLISHER)
        if isinstance(expectation, schema.Returns):
            self._returns(path, expectation)
        if isinstance(expectation, schema.Admitted):
            self._admitted((*path, "admitted"), expectation.admitted)
        if isinstance(expectation, schema.AnyOf):
            self._groups((*path, "any_of"), "group", expectation.any_of)
        if isinstance(expectation, schema.Inside):
            self._status(path, expectation)
        if isinstance(expectation, schema.Cycles):
            check_cycles(self.names, path, expectation)
            self._answers(path, expectation.is_)
        if isinstance(expectation, schema.Level):
            window = (expectation.from_ is not None, expectation.until is not None)
            if window != ((False, False) if expectation.by is not None else (True, True)):
                raise self.error(path, "level needs either by:, or from: and until:")
        if isinstance(expectation, schema.Takes) and expectation.at_most is None and expectation.at_least is None:
            raise self.error(path, "takes without a bound", "add at_most: or at_least:")
        if isinstance(expectation, (schema.Total, schema.Callbacks, schema.Counted)):
            self._numbers(path, expectation)

    def _admitted(self, path: Path_, name: str) -> None:
        self.names.check_entities(path, [name])
        if not self.scenario.entities[base_name(name)].may_fail:
            raise self.error(path, f"admitted: {name!r} may not fail", "add may_fail: true to the entity")

    def _events(self, path: Path_, expectation: schema.Expectation) -> None:
        """The entities exist, the kinds are of their side, and somebody registers what must fire."""
        kinds, names = expected_kinds(expectation), expected_entities(expectation)
        here = (*path, "conserved" if isinstance(expectation, schema.Conserved) else "of")
        self.names.check_entities(here, names)
        for kind in kinds:
            for name in names:
                self.names.check_side(here, kind, name)
                if not isinstance(expectation, schema.Never) and not self._is_registered(kind, name):
                    raise self.error(path, f"nothing registers {kind} on {name!r}", "add a register step")
            side = KIND_BY_LABEL[kind].side
            if not names and side not in self.names.sides.values():
                raise self.error(here, f"{kind} is an event of a {side.value}, and there is none")

    def _is_registered(self, kind: str, name: str) -> bool:
        register = self.scenario.entities[base_name(name)].register
        if register != "none" and (isinstance(register, str) or kind in register):
            return True
        return any(
            isinstance(step, schema.Register)
            and base_name(step.of) == base_name(name)
            and step.kind in (kind, int(KIND_BY_LABEL[kind]))
            for _, step in steps(self.scenario)
        )

    def _status(self, path: Path_, inside: schema.Inside) -> None:
        lively = inside.event == EventKind.LIVELINESS_CHANGED.label
        known = LivelinessChangedStatus._fields if lively else CountStatus._fields
        for name in inside.status:
            if name not in known:
                raise self.names.unknown((*path, "status", name), f"field of {inside.event}", name, known)

    def _numbers(self, path: Path_, expectation: schema.Total | schema.Callbacks | schema.Counted) -> None:
        exact = None if isinstance(expectation, schema.Callbacks) else expectation.is_
        least, most = expectation.at_least, expectation.at_most
        if exact is None and least is None and most is None:
            head = type(expectation).__name__.lower()
            callbacks = isinstance(expectation, schema.Callbacks)
            raise self.error(
                path, f"{head} without a number", f"add {'' if callbacks else 'is:, '}at_least: or at_most:"
            )
        if exact is not None and (least is not None or most is not None):
            raise self.error((*path, "is"), "is: stands beside a bound", "keep is: alone, or the bounds")
        for key, value in (("is", exact), ("at_least", least), ("at_most", most)):
            if value is not None:
                self._not_below((*path, key), value, 0)
        if least is not None and most is not None and least > most:
            raise self.error((*path, "at_most"), f"at_least: {least} is more than at_most: {most}")

    def _labels(self, path: Path_, part: schema.Base) -> None:
        for key, wanted in _LABELS.get(type(part), ()):
            here, named = (*path, key), dict(fields(part))[key]
            for label in named if isinstance(named, list) else [named] if named is not None else []:
                step = self.names.step(here, label)
                if not isinstance(step, wanted) and not (schema.Publish in wanted and publishes(step)):
                    words = " or ".join(map(word, wanted)) if len(wanted) <= 2 else "do:"
                    is_ = f"{key}: {label!r} is a step with {word(type(step))}"
                    raise self.error(here, is_, f"name one with {words}")

    def _returns(self, path: Path_, part: schema.Returns | schema.ReturnsGiven) -> None:
        here, name = (*path, "returns"), part.returns
        entity, session = self.scenario.entities.get(name), self.scenario.sessions.get(name)
        if not (entity and entity.may_fail) and not (session and session.may_fail):
            step = self.names.step(here, name)
            if not isinstance(step, _ANSWERING) and not publishes(step):
                raise self.error(here, f"returns: {name!r} is a step with {word(type(step))}, which answers nothing")
        if not part.is_:
            raise self.error((*path, "is"), "is: no answer is listed", "list one or more")
        self._answers(path, part.is_)

    def _answers(self, path: Path_, answers: Sequence[str]) -> None:
        for answer in answers:
            if answer not in ANSWERS:
                raise self.names.unknown((*path, "is"), "answer", answer, ANSWERS)

    # --- any part -----------------------------------------------------------------------------------

    def _groups(self, path: Path_, noun: str, groups: Sequence[Sequence[Any]]) -> None:
        if not groups:
            raise self.error(path, f"{path[-1]} without a {noun}", "add one or more, each a list")
        for index, group in enumerate(groups):
            if not group:
                raise self.error((*path, index), f"{path[-1]}: an empty {noun}", "fill it or remove it")

    def _durations(self, path: Path_, part: schema.Base) -> None:
        for key, value in fields(part):
            if not isinstance(value, Duration):
                continue
            sign = self._sign(value)
            steps_back = isinstance(part, schema.Fault) and part.fault == "clock_step" and key == "by"
            if sign < 0 and not steps_back:
                raise self.error((*path, key), f"{key}: the duration {value.text!r} is negative")
            if sign == 0 and isinstance(part, schema.Periodic):
                raise self.error((*path, key), f"{key}: the period is 0", "events repeat after a positive time")
            if sign == 0 and isinstance(part, schema.Session) and key == "slice":
                raise self.error((*path, key), f"{key}: drive_io would not wait at all", "give it some milliseconds")

    def _sign(self, duration: Duration) -> int:
        """-1, 0 or 1; 1 also when it depends on what a backend declares."""
        if duration.names <= {"T"}:
            value = duration.ns({"T": self.scenario.scale.T.ns({})})
            return (value > 0) - (value < 0)
        return -1 if all(factor < 0 for _, factor in duration.terms) else 1

    def _not_below(self, path: Path_, value: int, least: int) -> None:
        if value < least:
            raise self.error(path, f"{path[-1]}: {value} is less than {least}")


def _capabilities() -> list[str]:
    nobody = Declaration(schema=1, name="", title="", adapter="", subject=Subject(kind="model", says="", not_=""))
    return sorted(nobody.capabilities())
