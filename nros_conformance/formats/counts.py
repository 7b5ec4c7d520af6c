"""Numbers with their nouns, for people."""

from __future__ import annotations


def many(number: int, what: str) -> str:
    """A number of things whose plural has an s.

    >>> many(1, "sample"), many(0, "sample")
    ('1 sample', '0 samples')
    """
    return f"{number} {what}{'' if number == 1 else 's'}"


def repeatedly(count: int) -> str:
    """How often: ``once``, ``2 times``."""
    return "once" if count == 1 else f"{count} times"
