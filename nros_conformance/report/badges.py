"""Badges: how many of the five events a row of ``matrix.md`` has, as a picture and as a shields.io endpoint.

They are read off the printed table and nothing else, so a badge never says more than the table does.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

import msgspec

from nros_conformance.report import printed
from nros_conformance.rmw.events import EventKind

EVENTS = tuple(kind.words for kind in EventKind)
"""Headers of their columns."""

_COLOURS = {"brightgreen": "#4c1", "green": "#97ca00", "yellow": "#dfb317", "red": "#e05d44", "lightgrey": "#9f9f9f"}
"""Names of shields.io, and what it draws for them."""

_FIRES = ("yes", "limited", "partly")
_DOUBTFUL = ("unclear", "untested")
_WRONG = ("broken", "undeclared", "FAIL")
_PARTIAL = "**Partial: "
_LETTER, _GAP, _HEIGHT = 6.7, 10, 20
"""Pixels: width of a letter, what is free beside a text, height."""


class Badge(msgspec.Struct, frozen=True, kw_only=True, rename="camel"):
    """A badge; encoded as JSON it is what ``img.shields.io/endpoint?url=...`` reads."""

    schema_version: int = 1
    label: str
    message: str
    color: str


def badges(matrix: str) -> dict[str, Badge]:
    """A badge for each row of the text of a ``matrix.md``, by the name of its files."""
    partial = _PARTIAL in matrix
    return {_name(title): _badge(title, row, partial=partial) for title, row in printed.rows(matrix).items()}


def files(matrix: str) -> dict[str, str]:
    """All files of the badges: name and text."""
    found = {}
    for name, badge in badges(matrix).items():
        found[f"{name}.json"] = msgspec.json.format(msgspec.json.encode(badge), indent=1).decode() + "\n"
        found[f"{name}.svg"] = svg(badge)
    return found


def stale(folder: Path, matrix: str) -> Iterator[str]:
    """What the badges of a folder say otherwise than the text of a ``matrix.md``."""
    wanted = files(matrix)
    for name, text in wanted.items():
        file = folder / name
        if not file.is_file():
            yield f"{file}: there is no such badge"
        elif file.read_text(encoding="utf-8") != text:
            yield f"{file}: says otherwise than the table"
    there = {file.name for pattern in ("*.json", "*.svg") for file in folder.glob(pattern)}
    yield from (f"{folder / name}: the table has no such row" for name in sorted(there - set(wanted)))


def _name(title: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-") or "row"


def _badge(title: str, row: Mapping[str, str], *, partial: bool) -> Badge:
    if partial:
        return Badge(label=title, message="partial run", color="lightgrey")
    words = Counter(_word(row[event]) for event in EVENTS if event in row)
    asides = [f"{words[word]} {word}" for word in ("limited", "partly", *_DOUBTFUL, *_WRONG) if words[word]]
    fired = sum(words[word] for word in _FIRES)
    message = ", ".join([f"{fired} of {len(EVENTS)} events", *asides])
    return Badge(label=title, message=message, color=_colour(list(row.values()), words))


def _colour(cells: Sequence[str], words: Counter[str]) -> str:
    """By all cells of the row: a rule that is violated anywhere is no green."""
    printed_words = {_word(cell) for cell in cells}
    if printed_words & set(_WRONG) or any(cell.strip("*").endswith("FAIL") for cell in map(_plain, cells)):
        return "red"
    if printed_words & set(_DOUBTFUL):
        return "lightgrey"
    if "partly" in printed_words:
        return "yellow"
    return "brightgreen" if words["yes"] == len(EVENTS) else "green"


def _plain(cell: str) -> str:
    """A cell without the keys of its notes."""
    return re.sub(r"`[^`]*`", "", cell).strip()


def _word(cell: str) -> str:
    plain = _plain(cell).strip("*").split()
    return plain[0].rstrip("°") if plain else ""


def svg(badge: Badge) -> str:
    """The picture, in the flat style that people know."""
    left, right = (round(len(text) * _LETTER + _GAP) for text in (badge.label, badge.message))
    root = ElementTree.Element(
        "svg", xmlns="http://www.w3.org/2000/svg", width=str(left + right), height=str(_HEIGHT), role="img",
    )  # fmt: skip
    root.set("aria-label", f"{badge.label}: {badge.message}")
    ElementTree.SubElement(root, "title").text = f"{badge.label}: {badge.message}"
    for x, width, fill in ((0, left, "#555"), (left, right, _COLOURS[badge.color])):
        _add(root, "rect", x=x, width=width, height=_HEIGHT, fill=fill)
    font = {"font-family": "Verdana,DejaVu Sans,sans-serif", "font-size": "11", "fill": "#fff"}
    group = ElementTree.SubElement(root, "g", font | {"text-anchor": "middle"})
    for middle, width, text in ((left / 2, left, badge.label), (left + right / 2, right, badge.message)):
        _add(group, "text", x=middle, y=14, textLength=width - _GAP).text = text
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _add(parent: ElementTree.Element, name: str, **values: object) -> ElementTree.Element:
    return ElementTree.SubElement(parent, name, {key: str(value) for key, value in values.items()})
