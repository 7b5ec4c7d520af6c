"""YAML 1.2 with lines: ``on``, ``yes`` and ``no`` are plain words, a key given twice is an error."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from nros_conformance.formats.places import Document, FormatError, Path_

_INT = re.compile(r"[-+]?\d+$")
_FLOAT = re.compile(r"[-+]?(\d+\.\d*|\.\d+|\d+)([eE][-+]?\d+)?$")
_CORE = {"": None, "~": None, "null": None, "true": True, "false": False}


def read_yaml(file: Path, text: str | None = None) -> Document:
    """Parse a file (or ``text`` in its place). Raises `FormatError` for what is not YAML."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    try:
        source = file.read_text(encoding="utf-8") if text is None else text
        node = YAML(typ="safe", pure=True).compose(source)
    except MarkedYAMLError as error:
        mark, began = error.problem_mark or error.context_mark, error.context_mark
        what = ", ".join(part for part in (error.context, error.problem) if part)
        remedy = f"that began in line {began.line + 1}" if began and began.line != mark.line else ""
        if what.endswith("but got '['"):
            remedy = "between { and } a text with brackets needs quotes"
        raise FormatError(file, mark.line + 1 if mark else None, f"not YAML: {what}", remedy) from None
    except (YAMLError, UnicodeDecodeError) as error:
        raise FormatError(file, None, f"not YAML: {' '.join(str(error).split())}") from None
    except OSError as error:
        raise FormatError(file, None, f"cannot be read: {error.strerror}") from None
    if node is None:
        raise FormatError(file, 1, "the file is empty")
    lines: dict[Path_, int] = {}
    return Document(str(file), _build(str(file), node, (), lines, ()), lines)


def _build(file: str, node: Any, path: Path_, lines: dict[Path_, int], within: tuple[Any, ...]) -> Any:
    here = node.start_mark.line + 1
    lines.setdefault(path, here)
    if not node.tag.startswith("tag:yaml.org,2002:"):
        raise FormatError(file, here, f"the tag {node.tag!r} is not known", "remove it")
    if any(node is outer for outer in within):
        raise FormatError(file, here, f"the alias *{node.anchor} stands inside of what it names")
    within = (*within, node)
    if node.id == "mapping":
        mapping: dict[str, Any] = {}
        for key_node, value_node in node.value:
            line = key_node.start_mark.line + 1
            if key_node.id != "scalar":
                raise FormatError(file, line, f"a {key_node.id} stands where a key is expected", "quote it, or name it")
            key = str(key_node.value)
            if key in mapping:
                raise FormatError(
                    file, line, f"the key {key!r} stands here twice", f"the first is in line {lines[(*path, key)]}"
                )
            lines[(*path, key)] = line
            mapping[key] = _build(file, value_node, (*path, key), lines, within)
        return mapping
    if node.id == "sequence":
        return [_build(file, item, (*path, index), lines, within) for index, item in enumerate(node.value)]
    return _scalar(node)


def _scalar(node: Any) -> Any:
    text: str = node.value
    if node.style is not None:  # quoted or a block: always text
        return text
    if text in _CORE:
        return _CORE[text]
    if _INT.match(text):
        return int(text)
    return float(text) if _FLOAT.match(text) else text
