"""Markdown as the matrix needs it. What comes from declarations of others cannot break out of its place."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

_GITHUB = re.compile(r"https://github\.com/[^/\s]+/[^/\s]+/(?:issues|pull)/(\d+)\S*$")


def prose(text: str) -> str:
    """One line of running text; tags do not become HTML, code spans stay as they are."""
    parts = " ".join(text.split()).split("`")
    if len(parts) % 2 == 0:  # a backtick without its pair opens no code span
        return " ".join(text.split()).replace("<", "&lt;")
    return "`".join(part if index % 2 else part.replace("<", "&lt;") for index, part in enumerate(parts))


def without_paths(text: str) -> str:
    """An error's text without the places of this machine that Python adds in brackets."""
    return re.sub(r"\s*\((?:/|[A-Za-z]:\\)[^)]*\)", "", text)


def sentence(text: str) -> str:
    """With a full stop at the end."""
    return text if text.endswith((".", "!", "?")) else f"{text}."


def link(target: str) -> str:
    """An issue as ``[#1798](...)``, another address as ``[link](...)``, anything else as it is."""
    issue = _GITHUB.match(target)
    if issue:
        return f"[#{issue[1]}]({target})"
    return f"[link]({target})" if target.startswith(("http://", "https://")) else prose(target)


def table(header: Sequence[str], rows: Iterable[Sequence[str]], numbers: Iterable[int] = ()) -> str:
    """A table; the columns at the positions ``numbers`` are right-aligned."""
    right = set(numbers)
    lines = [_row(header), "|" + "|".join("--:" if index in right else ":--" for index in range(len(header))) + "|"]
    return "\n".join([*lines, *(_row(row) for row in rows)])


def read_tables(text: str) -> list[list[list[str]]]:
    """The tables of a text: rows of cells, header first."""
    tables: list[list[list[str]]] = []
    inside = False
    for line in text.splitlines():
        if not line.startswith("|"):
            inside = False
            continue
        if not inside:
            tables.append([])
            inside = True
        cells = [cell.strip().replace("\\|", "|") for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        if not all(re.fullmatch(r":?-+:?", cell) for cell in cells):
            tables[-1].append(cells)
    return tables


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
