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
        mark = error.problem_mark or error.context_mark
        raise FormatError(
            file, mark.line + 1 if mark else None, f"not YAML: {error.problem or error.context}"
        ) from None
    except (YAMLError, UnicodeDecodeError) as error:
        raise FormatError(file, None, f"not YAML: {' '.join(str(error).split())}") from None
    if node is None:
        raise FormatError(file, 1, "the file is empty")
    lines: dict[Path_, int] = {}
    return Document(str(file), _build(str(file), node, (), lines), lines)


def _build(file: str, node: Any, path: Path_, lines: dict[Path_, int]) -> Any:
    lines.setdefault(path, node.start_mark.line + 1)
    if node.id == "mapping":
        mapping: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key, line = str(key_node.value), key_node.start_mark.line + 1
            if key in mapping:
                raise FormatError(
                    file, line, f"the key {key!r} stands here twice", f"the first is in line {lines[(*path, key)]}"
                )
            lines[(*path, key)] = line
            mapping[key] = _build(file, value_node, (*path, key), lines)
        return mapping
    if node.id == "sequence":
        return [_build(file, item, (*path, index), lines) for index, item in enumerate(node.value)]
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
