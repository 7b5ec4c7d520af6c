"""A ``matrix.md`` taken apart again: its rows, notes and versions, as they are printed."""

from __future__ import annotations

import re
from collections.abc import Iterator

from nros_conformance.report import codes
from nros_conformance.report.markdown import read_tables

RAN = "what ran"
"""The kind of a row's subject stands under this name beside its cells."""

_CORNERS = ("Backend, what ran", "Connection", "Connection and patterns")
_TESTED = ["Backend", "Tested"]
_LABEL = re.compile(r"\*\*(?P<title>.*)\*\*(?:, (?P<kind>\w+))?$")
_GAP = re.compile(r"- (?P<requirements>[A-Z]{3}-\d{3}(?:, [A-Z]{3}-\d{3})*) on (?P<rows>.+?): (?P<reason>.*)$")
_NOTE = re.compile(r"- `(?P<key>[^`]+)` (?P<text>.*)$")


def rows(text: str) -> dict[str, dict[str, str]]:
    """The cells of both tables by title and by header; the kind of the subject under `RAN`."""
    found: dict[str, dict[str, str]] = {}
    for header, *body in read_tables(text):
        if header[0] not in _CORNERS:
            continue
        for title, kind, cells in _labelled(body):
            row = found.setdefault(title, {})
            row.update(zip(header[1:], cells, strict=False))
            if kind:
                row[RAN] = kind
    return found


def return_codes(text: str) -> dict[str, dict[str, str]]:
    """The table of return codes by title and by header."""
    return {
        title: dict(zip(header[1:], cells, strict=False))
        for header, *body in read_tables(text)
        if header[:2] == codes.HEADER[:2]
        for title, _, cells in _labelled(body)
    }


def tested(text: str) -> dict[str, str]:
    """What was tested, by title."""
    return {
        title: cells[0]
        for header, *body in read_tables(text)
        if header[:2] == _TESTED
        for title, _, cells in _labelled(body)
    }


def notes(text: str) -> dict[str, str]:
    """Notes by key."""
    return {match["key"]: match["text"] for match in map(_NOTE.match, text.splitlines()) if match}


def gaps(text: str) -> dict[str, dict[str, str]]:
    """By title and requirement: why there is no verdict on it."""
    titles = list(rows(text))
    found: dict[str, dict[str, str]] = {title: {} for title in titles}
    for match in filter(None, map(_GAP.match, section(text, "Gaps"))):
        for title in titles:
            if match["rows"] == "every row" or f", {title}, " in f", {match['rows']}, ":
                found[title] |= dict.fromkeys(match["requirements"].split(", "), match["reason"].removesuffix("."))
    return found


def section(text: str, title: str) -> list[str]:
    """The lines of a section that are not blank; empty when there is no such section."""
    lines = iter(text.splitlines())
    if f"## {title}" not in lines:  # which leaves the lines behind it
        return []
    found: list[str] = []
    for line in lines:
        if line.startswith("## "):
            break
        if line:
            found.append(line)
    return found


def _labelled(body: list[list[str]]) -> Iterator[tuple[str, str, list[str]]]:
    """Title, kind and the other cells of the rows that begin with a backend."""
    for first, *cells in body:
        if match := _LABEL.match(first):
            yield match["title"], match["kind"] or "", cells
