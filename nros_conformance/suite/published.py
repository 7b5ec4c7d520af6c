"""A support table that somebody else has published: ``suites/published.yaml``. It is no suite."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Literal, TypeAlias

import msgspec
from msgspec import Struct

from nros_conformance.formats.places import Document, FormatError, nearest
from nros_conformance.formats.yaml12 import read_yaml
from nros_conformance.rmw.declaration import Event
from nros_conformance.rmw.events import KIND_BY_LABEL, EventKind
from nros_conformance.suite.loader import PUBLISHED, REQUIREMENTS, shipped_suites

SubjectKind: TypeAlias = Literal["library", "protocol", "model", "compiled", "device"]


class _Part(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    pass


class About(_Part, frozen=True, kw_only=True):
    """What the table is a statement about."""

    says: str
    kinds: list[SubjectKind]
    """Kinds of subject of the rows that run the same; a row of another kind contradicts no cell."""


class Word(_Part, frozen=True, kw_only=True):
    """A word of the table's legend."""

    mark: str
    """What the table prints for it."""
    says: str
    means: Literal["works", "absent"]


class Detail(_Part, frozen=True, kw_only=True):
    """What a remark says beyond the word of its cell."""

    about: str
    holds: str
    """The requirement that, where it holds, shows that it is otherwise in what was observed."""
    observed: str
    """How it is there."""
    unless: str = ""
    """A flag of the event's declaration, for what the remark says: where it is set, the requirement shows nothing."""


class Documented(_Part, frozen=True, kw_only=True):
    """One cell."""

    word: str
    remark: str
    """The table's own."""
    details: list[Detail] = []


class Answers(_Part, frozen=True, kw_only=True):
    """Return codes of registering."""

    right_side: int
    wrong_side: int
    no_callback: int


class Compiled(_Part, frozen=True, kw_only=True):
    """What the sources of that revision hold about a compiled backend. It was read, not run."""

    event_slots: Literal["empty", "filled"]
    """Whether the vtable has functions to register events with; an application gets UNSUPPORTED without."""
    answers: Answers | None = None
    source: str


class PublishedBackend(_Part, frozen=True, kw_only=True):
    """One row."""

    backend: str
    """The name of the backends here that it is compared with."""
    title: str
    """The table's name for it."""
    cells: dict[str, Documented]
    """By event label, all five."""
    compiled: Compiled | None = None

    def cell(self, kind: EventKind) -> Documented:
        """The cell of a kind."""
        return self.cells[kind.label]


class Published(_Part, frozen=True, kw_only=True):
    """The whole table."""

    name: str
    """As a sentence names it, in Markdown."""
    revision: str
    link: str
    """Where it stands, at that revision."""
    subject: About
    legend: dict[str, Word]
    """By word."""
    backends: list[PublishedBackend]

    def row(self, backend: str) -> PublishedBackend | None:
        """The row of a backend; None when the table does not have it."""
        return next((one for one in self.backends if one.backend == backend), None)

    def works(self, cell: Documented) -> bool:
        """Whether a cell says that the event works."""
        return self.legend[cell.word].means == "works"


def load_published(directory: Path, requirements: Collection[str]) -> Published | None:
    """The table in a directory of suites; without one there, the table shipped here.

    None for a directory with a catalogue of its own and no table: what the shipped one refers to may not be in it.
    ``requirements``: the ids that there are. Raises `FormatError`, with the file relative to the directory's parent.
    """
    file = directory / PUBLISHED
    if not file.is_file():
        if (directory / REQUIREMENTS).is_file():
            return None
        file = shipped_suites() / PUBLISHED
    shown = Path(file.parent.name) / file.name
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise FormatError(shown, None, f"cannot be read: {error}") from None
    return read_published(shown, text, requirements)


def read_published(file: Path, text: str, requirements: Collection[str]) -> Published:
    """Read and check ``text``; ``file`` is its name in errors. Raises `FormatError`."""
    document = read_yaml(file, text)
    published = document.read(Published)
    if published.revision not in published.link:
        raise document.error(("link",), f"the link does not hold the revision {published.revision}", "link to it")
    if not published.subject.kinds:
        raise document.error(("subject", "kinds"), "no kind of subject", "add the kinds that run the same")
    first: dict[str, int] = {}
    for index, one in enumerate(published.backends):
        here = ("backends", index)
        if one.backend in first:
            raise document.error(
                (*here, "backend"), f"the backend {one.backend} stands here twice",
                f"the first is in line {first[one.backend]}",
            )  # fmt: skip
        first[one.backend] = document.line((*here, "backend"))
        _check(document, index, published, requirements)
    return published


def _check(document: Document, index: int, published: Published, requirements: Collection[str]) -> None:
    one = published.backends[index]
    here = ("backends", index, "cells")
    for label, cell in one.cells.items():
        if label not in KIND_BY_LABEL:
            raise document.error((*here, label), f"unknown event {label!r}", nearest(label, list(KIND_BY_LABEL)))
        if cell.word not in published.legend:
            raise document.error(
                (*here, label, "word"), f"the legend has no word {cell.word!r}",
                nearest(cell.word, list(published.legend)),
            )  # fmt: skip
        for number, detail in enumerate(cell.details):
            place = (*here, label, "details", number)
            if detail.holds not in requirements:
                raise document.error(
                    (*place, "holds"), f"no requirement {detail.holds!r}", nearest(detail.holds, sorted(requirements))
                )
            if detail.unless and detail.unless not in _flags():
                raise document.error(
                    (*place, "unless"), f"events are declared without a flag {detail.unless!r}",
                    nearest(detail.unless, _flags()),
                )  # fmt: skip
    missing = [label for label in KIND_BY_LABEL if label not in one.cells]
    if missing:
        raise document.error(here, f"{one.backend}: no cell for {', '.join(missing)}", "every event has one")


def _flags() -> list[str]:
    """What is true or false in the declaration of an event."""
    return sorted(
        one.encode_name for one in msgspec.structs.fields(Event) if isinstance(one.default, bool)
    )  # fmt: skip
