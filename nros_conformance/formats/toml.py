"""TOML with lines."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from nros_conformance.formats.places import Document, FormatError, Path_

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

# A header is alone in its line: an array that runs over several lines has rows that begin like one.
_TABLE = re.compile(r"""\s*\[(?P<array>\[)?\s*(?P<name>[A-Za-z0-9_."' -]+?)\s*\]\]?\s*(#.*)?$""")
_KEY = re.compile(r"""\s*(?P<name>(["']?)[A-Za-z0-9_.-]+\2)\s*=""")
_AT = re.compile(r"(?P<what>.*) \(at line (?P<line>\d+), column \d+\)|(?P<end>.*) \(at end of document\)")


def read_toml(file: Path, text: str | None = None) -> Document:
    """Parse a file (or ``text`` in its place). Raises `FormatError` for what is not TOML."""
    try:
        source = file.read_text(encoding="utf-8") if text is None else text
        data: dict[str, Any] = tomllib.loads(source)
    except tomllib.TOMLDecodeError as error:
        match = _AT.match(str(error))
        line = int(match["line"]) if match and match["line"] else None
        raise FormatError(file, line, f"not TOML: {(match and (match['what'] or match['end'])) or error}") from None
    except UnicodeDecodeError as error:
        raise FormatError(file, None, f"not TOML: {error}") from None
    except OSError as error:
        raise FormatError(file, None, f"cannot be read: {error.strerror}") from None
    return Document(str(file), data, _lines(source))


def _lines(source: str) -> dict[Path_, int]:
    """The line of every table and key. The parser has accepted the text, so this may be simple."""
    lines: dict[Path_, int] = {(): 1}
    arrays: dict[Path_, int] = {}
    table: Path_ = ()
    for number, text in enumerate(source.splitlines(), 1):
        header, key = _TABLE.match(text), _KEY.match(text)
        if header:
            table = tuple(part.strip("\"' ") for part in header["name"].split("."))
            if header["array"]:
                arrays[table] = arrays.get(table, -1) + 1
                lines.setdefault(table, number)
                table = (*table, arrays[table])
            lines[table] = number
            for depth in range(1, len(table)):
                lines.setdefault(table[:depth], number)
        elif key:
            path = table + tuple(part.strip("\"'") for part in key["name"].split("."))
            lines.setdefault(path, number)
    return lines
