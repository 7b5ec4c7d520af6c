"""The requirement catalogue: ``suites/requirements.yaml``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, TypeAlias

from msgspec import Meta, Struct

from nros_conformance.formats.places import Document, nearest
from nros_conformance.formats.yaml12 import read_yaml
from nros_conformance.suite.schema import RequirementId

Level: TypeAlias = Literal["must", "should", "may"]
ConflictId: TypeAlias = Annotated[str, Meta(pattern=r"^C[0-9]{2}$")]


class _Entry(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    id: RequirementId
    level: Level
    statement: str
    source: str
    conflict: list[ConflictId] = []
    resolution: str = ""


class _File(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    version: str
    sources: dict[str, str]
    groups: dict[str, str]
    requirements: list[_Entry]


class Requirement(Struct, frozen=True, kw_only=True):
    """One normative statement."""

    id: str
    """``RDM-003``."""
    level: Level
    group: str
    """``RDM``; `Requirements.groups` has its title."""
    statement: str
    source: str
    """Where it comes from; `Requirements.sources` expands the abbreviations."""
    conflicts: tuple[str, ...] = ()
    """Where sources contradict each other: ``C02``."""
    resolution: str = ""
    """What holds where sources contradict each other or leave a point open."""


class Requirements:
    """The catalogue: by id, and iterable in its own order."""

    def __init__(
        self, requirements: tuple[Requirement, ...], version: str, sources: dict[str, str], groups: dict[str, str]
    ) -> None:
        self.version = version
        """The version of the suites, such as ``1.0``."""
        self.sources = sources
        """Abbreviation -> what it stands for."""
        self.groups = groups
        """Group -> title, in the order of the catalogue."""
        self._by_id = {one.id: one for one in requirements}

    def __getitem__(self, id_: str) -> Requirement:
        """KeyError for an unknown id."""
        return self._by_id[id_]

    def __contains__(self, id_: object) -> bool:
        return id_ in self._by_id

    def __iter__(self) -> Iterator[Requirement]:
        return iter(self._by_id.values())

    def __len__(self) -> int:
        return len(self._by_id)

    def level(self, id_: str) -> Level:
        """must, should or may. KeyError for an unknown id."""
        return self._by_id[id_].level

    @property
    def levels(self) -> dict[str, Level]:
        """Id -> level, in order."""
        return {one.id: one.level for one in self}

    @property
    def by_id(self) -> Mapping[str, Requirement]:
        """The same as a read-only mapping."""
        return MappingProxyType(self._by_id)


def load_requirements(file: Path, text: str | None = None) -> Requirements:
    """Read and check a catalogue (or ``text`` in its place). Raises `FormatError`."""
    document = read_yaml(file, text)
    whole = document.read(_File)
    _check(document, whole)
    return Requirements(
        tuple(
            Requirement(
                id=one.id, level=one.level, group=one.id[:3], statement=one.statement, source=one.source,
                conflicts=tuple(one.conflict), resolution=one.resolution,
            )
            for one in whole.requirements
        ),
        whole.version, whole.sources, whole.groups,
    )  # fmt: skip


def _check(document: Document, whole: _File) -> None:
    lines: dict[str, int] = {}
    for index, one in enumerate(whole.requirements):
        here: tuple[Any, ...] = ("requirements", index)
        if one.id in lines:
            raise document.error(
                (*here, "id"), f"the requirement {one.id} stands here twice", f"the first is in line {lines[one.id]}"
            )
        lines[one.id] = document.line((*here, "id"))
        if one.id[:3] not in whole.groups:
            raise document.error(
                (*here, "id"), f"{one.id}: unknown group {one.id[:3]!r}", nearest(one.id[:3], list(whole.groups))
            )
        for key in ("statement", "source"):
            if not getattr(one, key):
                raise document.error((*here, key), f"{one.id}: the {key} is empty")
        if one.conflict and not one.resolution:
            raise document.error(here, f"{one.id}: a conflict without its resolution", "add resolution: ...")
