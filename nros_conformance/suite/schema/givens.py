"""What must have happened for the rest to mean anything."""

from __future__ import annotations

from typing import Literal, TypeAlias

from msgspec import field

from nros_conformance.formats.durations import Duration
from nros_conformance.suite.moments import Moment
from nros_conformance.suite.schema.words import Base, EntityName, Identifier, Labels


class GapGiven(Base, frozen=True, kw_only=True):
    """Between consecutive actions of this label, or of these together, at most ``max`` and at least ``min``."""

    gap: Labels
    max: Duration | None = None
    min: Duration | None = None


class ReturnsGiven(Base, frozen=True, kw_only=True):
    """The actions of this label answered one of these codes."""

    returns: Identifier
    is_: list[str] = field(name="is")


class ReceivedGiven(Base, frozen=True, kw_only=True):
    """As the expectation: which of the samples published under this label were received."""

    received: Identifier
    of: EntityName
    is_: Literal["all", "none"] | int = field(default="all", name="is")


class DrivenGiven(Base, frozen=True, kw_only=True):
    """This session was driven at least this often between two moments."""

    driven: Identifier
    max: Duration
    from_: Moment = field(default=Moment.parse("start"), name="from")
    until: Moment = Moment.parse("end")


AnyGiven: TypeAlias = GapGiven | ReturnsGiven | ReceivedGiven | DrivenGiven
GIVENS: dict[str, type[Base]] = {
    "gap": GapGiven, "returns": ReturnsGiven, "received": ReceivedGiven, "driven": DrivenGiven,
}  # fmt: skip
