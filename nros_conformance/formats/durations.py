"""Durations as suites and declarations write them.

A duration is a sum of terms: ``130ms``, ``3.5T``, ``2 * connection_lease``, ``3T + tolerance``,
``1T - 2ms``. ``T`` is a scenario's scale; the other names are `QUANTITIES`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from difflib import get_close_matches
from fractions import Fraction
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing_extensions import Self  # in typing from 3.11 on

UNITS_NS = {"ns": 1, "us": 1_000, "ms": 1_000_000, "s": 1_000_000_000, "min": 60_000_000_000, "h": 3_600_000_000_000}

QUANTITIES = (
    "T",
    "tolerance",
    "early",
    "discovery_bound",
    "connection_lease",
    "hard_liveliness_timeout",
    "hard_liveliness_grace",
)
"""Names that a duration may use beside units: the scale, the judge's tolerances, declared bounds."""

_NUMBER = r"\d+(?:\.\d+)?"
_TERM = re.compile(rf"\s*(?:(?P<number>{_NUMBER})\s*(?P<times>\*)?\s*(?P<unit>[A-Za-z_]+)?|(?P<name>[A-Za-z_]+))\s*")
_WRITTEN = rf"({_NUMBER} *\*? *({'|'.join((*UNITS_NS, *QUANTITIES))})|{'|'.join(QUANTITIES)})"
DURATION_PATTERN = rf"^ *[-+]? *{_WRITTEN}( *[-+] *{_WRITTEN})* *$"
"""For JSON Schema, in the regular expressions of ECMA 262: what `Duration.parse` reads, but for a bare 0."""


class DurationError(ValueError):
    """What is wrong with a duration or moment, in words for the suite's author."""


class Duration:
    """A linear form over `QUANTITIES` and nanoseconds; ``text`` is how it was written.

    ``terms`` are (name, factor) pairs; the name ``ns`` is the constant part. Not a dataclass, because
    msgspec would read one as an object and not as text.
    """

    __slots__ = ("terms", "text")

    def __init__(self, text: str, terms: tuple[tuple[str, Fraction], ...]) -> None:
        self.text = text
        self.terms = terms

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Duration) and self.text == other.text

    def __hash__(self) -> int:
        return hash(self.text)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.text!r})"

    @classmethod
    def parse(cls, text: str | int | float) -> Self:
        """Read a duration; a bare 0 needs no unit. Raises `DurationError`."""
        source = str(text).strip()
        if isinstance(text, bool) or not isinstance(text, (str, int, float)):
            raise DurationError(f"{source!r} is not a duration; write for example 130ms or 3.5T")
        if source in ("0", "0.0"):
            return cls("0", ())
        if not source:
            raise DurationError("an empty duration; write for example 130ms or 3.5T")
        sums: dict[str, Fraction] = {}
        position, sign = 0, 1
        if source[0] in "+-":
            position, sign = 1, -1 if source[0] == "-" else 1
        while True:
            name, factor, position = _term(source, position)
            sums[name] = sums.get(name, Fraction(0)) + sign * factor
            if position == len(source):
                break
            if source[position] not in "+-":
                raise DurationError(f"cannot read {source[position:]!r} in the duration {source!r}")
            sign = -1 if source[position] == "-" else 1
            position += 1
            if position == len(source):
                raise DurationError(f"the duration {source!r} ends with {source[-1]!r}; something has to follow")
        return cls(source, tuple(sorted(sums.items())))

    def ns(self, quantities: Mapping[str, int]) -> int:
        """Nanoseconds, with the present value of every quantity. KeyError names a missing one."""
        return int(
            sum((factor * (1 if name == "ns" else quantities[name]) for name, factor in self.terms), Fraction(0))
        )

    @property
    def names(self) -> frozenset[str]:
        """The quantities it depends on."""
        return frozenset(name for name, _ in self.terms) - {"ns"}

    def __str__(self) -> str:
        return self.text


class Period(Duration):
    """A duration of a QoS, which may also be ``infinite``."""

    __slots__ = ()

    @classmethod
    def parse(cls, text: str | int | float) -> Self:
        """Raises `DurationError`."""
        return cls("infinite", ()) if text == "infinite" else super().parse(text)

    @property
    def is_infinite(self) -> bool:
        """Whether it was written as ``infinite``."""
        return self.text == "infinite"


ZERO = Duration("0", ())


def _term(source: str, position: int) -> tuple[str, Fraction, int]:
    match = _TERM.match(source, position)
    if match is None:
        raise DurationError(f"cannot read {source[position:]!r} in the duration {source!r}")
    name = match["unit"] or match["name"]
    factor = Fraction(match["number"]) if match["number"] else Fraction(1)
    if name is None:
        raise DurationError(
            f"{match['number']} in {source!r} has no unit; write for example {match['number']}ms or {match['number']}T"
        )
    if name in UNITS_NS:
        if not match["number"]:
            raise DurationError(f"{name!r} in {source!r} has no number; write for example 1{name}")
        return "ns", factor * UNITS_NS[name], match.end()
    if name in QUANTITIES:
        return name, factor, match.end()
    valid = (*UNITS_NS, *QUANTITIES)
    near = get_close_matches(name, valid, 1, 0.5)
    hint = f"; did you mean {near[0]!r}?" if near else f"; known are {', '.join(valid)}"
    raise DurationError(f"unknown unit {name!r} in the duration {source!r}{hint}")
