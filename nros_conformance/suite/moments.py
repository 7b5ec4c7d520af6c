"""Moments as suites write them: an anchor with an optional offset.

``data.last``, ``data.last + 0.95T``, ``start``, ``gone.begin``, ``data[2].end``, ``listener.created``,
``listener.LivelinessChanged[0]``, ``crowd[2].created``.
"""

from __future__ import annotations

import re

from nros_conformance.formats.durations import ZERO, Duration, DurationError

_ANCHOR = re.compile(
    r"(?P<label>[A-Za-z][A-Za-z0-9_-]*(?:\[\d+\](?=\.(?:[A-Z]|created|settled)))?)"
    r"(?:\.(?P<kind>[A-Z][A-Za-z]*))?(?:\[(?P<index>-?\d+)\]|\.(?P<place>first|last))?"
    r"(?:\.(?P<edge>begin|end|created|settled))?"
)
_MOMENT = re.compile(rf"\s*(?P<anchor>{_ANCHOR.pattern.replace('?P<', '?P<a_')})\s*(?P<offset>[+-].*)?$", re.DOTALL)

MOMENT_PATTERN = rf"^ *{re.sub('[?]P<[a-z]+>', '?:', _ANCHOR.pattern)} *([-+].*)?$"
"""For JSON Schema, in the regular expressions of ECMA 262: what `Moment.parse` reads, but for the offset."""


class Moment:
    """An anchor plus an offset.

    ``label`` names a step, an entity (one of several as ``crowd[2]``), ``start`` or ``end``. ``kind``
    makes it an occurrence of that event on the entity. ``index`` picks one of repeated actions or
    occurrences (negative from the end); None means all of them together: from the first one's begin to
    the last one's end.
    ``edge``: ``begin``, ``end`` (of an action), ``created``, ``settled``; None is the whole interval.
    """

    __slots__ = ("edge", "index", "kind", "label", "offset", "text")

    def __init__(
        self, text: str, label: str, kind: str | None = None, index: int | None = None, edge: str | None = None,
        offset: Duration = ZERO,
    ) -> None:  # fmt: skip
        self.text = text
        self.label = label
        self.kind = kind
        self.index = index
        self.edge = edge
        self.offset = offset

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Moment) and self.text == other.text

    def __hash__(self) -> int:
        return hash(self.text)

    def __repr__(self) -> str:
        return f"Moment({self.text!r})"

    @classmethod
    def parse(cls, text: str | int | float) -> Moment:
        """Raises `DurationError`."""
        source = str(text)
        match = _MOMENT.match(source)
        if match is None:
            raise DurationError(
                f"cannot read the moment {source!r}; write for example data.last, start or gone.end + 2T"
            )
        place = match["a_place"]
        index = (
            0 if place == "first" else -1 if place == "last" else int(match["a_index"]) if match["a_index"] else None
        )
        offset = Duration.parse(match["offset"].strip()) if match["offset"] else ZERO
        return cls(source.strip(), match["a_label"], match["a_kind"], index, match["a_edge"], offset)

    def __str__(self) -> str:
        return self.text
