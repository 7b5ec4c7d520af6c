"""Names of a suite's vocabulary, and what all its parts have in common."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from msgspec import Meta, Struct

Profile: TypeAlias = Literal["smoke", "standard", "publish"]
PROFILES: tuple[Profile, ...] = ("smoke", "standard", "publish")
"""Each one includes those before it."""

KindName: TypeAlias = Literal[
    "LivelinessChanged", "RequestedDeadlineMissed", "MessageLost", "LivelinessLost", "OfferedDeadlineMissed"
]
KindOrAny: TypeAlias = KindName | Literal["ANY"]
Identifier: TypeAlias = Annotated[str, Meta(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")]
EntityName: TypeAlias = Annotated[str, Meta(pattern=r"^[A-Za-z][A-Za-z0-9_-]*(\[[0-9]+\])?$")]
"""An entity where it is referred to; ``crowd[0]`` is one of an entity with a count."""
RequirementId: TypeAlias = Annotated[str, Meta(pattern=r"^[A-Z]{3}-[0-9]{3}$")]
ScenarioId: TypeAlias = Annotated[str, Meta(pattern=r"^[a-z]+\.[a-z0-9-]+$")]
# Alone it is plain text, without the pattern: a union of a list and a text with a pattern makes msgspec (0.19 to
# 0.22) crash in every third process that ends (https://github.com/msgspec/msgspec/issues/717 has the same picture).
EntityNames: TypeAlias = str | list[EntityName]
Labels: TypeAlias = str | list[Identifier]
FaultName: TypeAlias = Literal[
    "crash", "freeze", "thaw", "lose", "duplicate", "reorder", "delay", "block", "partition", "heal", "stall",
    "overflow", "stop", "start", "bus_off", "inject", "clock_step", "preset", "load",
]  # fmt: skip


class Base(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """What all parts of a suite have in common: frozen, and a key that is not known is an error."""
