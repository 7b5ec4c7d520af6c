"""What is expected, and which requirements it proves."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

from msgspec import field

from nros_conformance.formats.durations import Duration
from nros_conformance.suite.moments import Moment
from nros_conformance.suite.schema.words import (
    Base,
    EntityName,
    EntityNames,
    Identifier,
    KindName,
    KindOrAny,
    RequirementId,
)


class Expectation(Base, frozen=True, kw_only=True):
    """Common to all expectations: the requirements that it proves."""

    proves: str | list[RequirementId]

    @property
    def requirements(self) -> tuple[str, ...]:
        """The requirement ids."""
        return (self.proves,) if isinstance(self.proves, str) else tuple(self.proves)


class Never(Expectation, frozen=True, kw_only=True):
    """No such event begins in the window."""

    never: KindOrAny | list[KindName]
    of: EntityNames | Literal["ALL"]
    from_: Moment = field(default=Moment.parse("start"), name="from")
    until: Moment = Moment.parse("end")


class Periodic(Expectation, frozen=True, kw_only=True):
    """From ``since`` on the total grows by one per ``every``, neither early nor late."""

    periodic: KindName
    of: EntityName
    every: Duration
    since: Moment
    until: Moment = Moment.parse("end")


class Total(Expectation, frozen=True, kw_only=True):
    """The running total (sum of changes) at a moment."""

    total: KindName
    of: EntityName
    at: Moment = Moment.parse("end")
    is_: int | None = field(default=None, name="is")
    at_least: int | None = None
    at_most: int | None = None


class Level(Expectation, frozen=True, kw_only=True):
    """alive_count or not_alive_count: ``by`` a moment, or ``from`` one ``until`` another throughout."""

    level: Literal["alive_count", "not_alive_count"]
    of: EntityNames
    is_: int = field(name="is")
    by: Moment | None = None
    from_: Moment | None = field(default=None, name="from")
    until: Moment | None = None


class Returns(Expectation, frozen=True, kw_only=True):
    """What the actions of a label answered: codes by name, ``ANY_ERROR``, ``true``, ``false``, ``DATA``."""

    returns: Identifier
    is_: list[str] = field(name="is")
    some: bool = False
    """One of several actions is enough."""


class Agrees(Expectation, frozen=True, kw_only=True):
    """``supports_event`` says beforehand what registering answers: both labels, pairwise."""

    agrees: Identifier
    with_: Identifier = field(name="with")


class Admitted(Expectation, frozen=True, kw_only=True):
    """Creating this entity answered INCOMPATIBLE_QOS if the backend declares a policy of it unsupported, else OK."""

    admitted: EntityName


class Received(Expectation, frozen=True, kw_only=True):
    """Which of the samples published under this label the subscription's takes returned, in order, once."""

    received: Identifier
    of: EntityName
    is_: Literal["all", "none"] | int = field(default="all", name="is")


class Conserved(Expectation, frozen=True, kw_only=True):
    """Received plus lost equals published, from ``since`` to the last received sample, per publisher."""

    conserved: EntityName
    from_: list[EntityName] = field(name="from")
    since: Moment = Moment.parse("start")


class Inside(Expectation, frozen=True, kw_only=True):
    """An event was delivered inside the drive_io or spin call of this label, with these payload fields."""

    inside: Identifier
    event: KindName
    of: EntityName
    at_least: int = 1
    status: dict[str, int] = {}


class Callback(Expectation, frozen=True, kw_only=True):
    """Whether the callback of this registration ran, and with what."""

    callback: Identifier
    is_: Literal["some", "never"] = field(name="is")
    kind: KindName | None = None
    context: str | None = None
    from_: Moment = field(default=Moment.parse("start"), name="from")
    until: Moment = Moment.parse("end")


class Callbacks(Expectation, frozen=True, kw_only=True):
    """How many callbacks ran inside the calls of this label: together, or in ``each``."""

    callbacks: Identifier
    counting: list[Literal["events", "messages"]] = field(default_factory=lambda: ["events", "messages"])
    each: bool = False
    at_most: int | None = None
    at_least: int | None = None


class Takes(Expectation, frozen=True, kw_only=True):
    """How long each call of this label took."""

    takes: Identifier
    at_most: Duration | None = None
    at_least: Duration | None = None


class Measured(Expectation, frozen=True, kw_only=True):
    """By how much a measured quantity grew from one ``measure`` step to another."""

    measured: Literal["cpu"]
    from_: Identifier = field(name="from")
    to: Identifier
    at_most: Duration


class Counted(Expectation, frozen=True, kw_only=True):
    """The number that a ``measure`` step found: itself, or what it is more than at the step ``since``."""

    counted: Identifier
    since: Identifier | None = None
    is_: int | None = field(default=None, name="is")
    at_least: int | None = None
    at_most: int | None = None


class Cycles(Expectation, frozen=True, kw_only=True):
    """In each turn of a ``cycle``: what a step answered, how many samples an entity took, what an event counted.

    Exactly one of ``step``, ``sampled`` and ``event``. Of events the occurrences count, of
    LivelinessChanged the callbacks.
    """

    cycles: Identifier
    step: Identifier | None = None
    is_: list[str] = field(name="is", default_factory=list)
    sampled: EntityName | None = None
    event: KindName | None = None
    of: EntityName | None = None
    at_least: int = 1


class AnyOf(Expectation, frozen=True, kw_only=True):
    """One of these groups of expectations holds as a whole."""

    any_of: list[list[Any]]


AnyExpectation: TypeAlias = (
    Never
    | Periodic
    | Total
    | Level
    | Returns
    | Agrees
    | Admitted
    | Received
    | Conserved
    | Inside
    | Callback
    | Callbacks
    | Takes
    | Measured
    | Counted
    | Cycles
    | AnyOf
)
EXPECTATIONS: dict[str, type[Expectation]] = {
    "never": Never, "periodic": Periodic, "total": Total, "level": Level, "returns": Returns, "agrees": Agrees,
    "admitted": Admitted, "received": Received, "conserved": Conserved, "inside": Inside, "callback": Callback,
    "callbacks": Callbacks, "takes": Takes, "measured": Measured, "counted": Counted, "cycles": Cycles,
    "any_of": AnyOf,
}  # fmt: skip
