"""Reading structured text so that every error names file, line, key and remedy.

A `Document` is plain data plus the line of every part of it; `Document.read` turns it into typed
values. The parsers are in `yaml12` and `toml`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import msgspec

Path_: TypeAlias = tuple[str | int, ...]
"""Where a part stands in the data: keys and list positions from the top."""

_T = TypeVar("_T")
_MESSAGE = re.compile(r"(?P<what>.*?)(?: - at (?P<key>`key` in )?`(?P<path>\$.*)`)?$", re.DOTALL)
_PART = re.compile(r"\.([^.\[]+)|\[(\d+|\.\.\.)\]")


class FormatError(Exception):
    """A file that cannot be used. The text is ``FILE:LINE: WHAT; REMEDY``."""

    def __init__(self, file: str | Path, line: int | None, what: str, remedy: str = "") -> None:
        place = f"{file}:{line}" if line else str(file)
        super().__init__(f"{place}: {what}" + (f"; {remedy}" if remedy else ""))
        self.file = str(file)
        self.line = line or None
        self.what = what
        self.remedy = remedy


class Document:
    """Parsed text: ``data``, and the line (from 1) at which each part of it stands.

    Without ``lines`` the data did not come from text, and errors name no line. ``note`` ends every
    error: which of several readings of the same text is meant.
    """

    def __init__(self, file: str, data: Any, lines: Mapping[Path_, int], note: str = "") -> None:
        self.file = file
        self.data = data
        self.note = note
        self._lines = lines

    def line(self, path: Path_) -> int:
        """The line of a part; of the nearest enclosing part when it has none of its own; 0: there are none."""
        while path and path not in self._lines:
            path = path[:-1]
        return self._lines.get(path, 1 if self._lines else 0)

    def error(self, path: Path_, what: str, remedy: str = "") -> FormatError:
        """An error at a part, to raise."""
        note = f" ({self.note})" if self.note else ""
        if remedy:
            return FormatError(self.file, self.line(path), what, remedy + note)
        return FormatError(self.file, self.line(path), what + note)

    def read(self, type_: type[_T], data: Any = ..., path: Path_ = ()) -> _T:
        """The part at ``path`` as a typed value; ``data`` replaces what stands there.

        Raises `FormatError` at the line of the offending key or value.
        """
        if data is ...:
            data = _at(self.data, path)
        try:
            return msgspec.convert(data, type_, dec_hook=_parse)
        except msgspec.ValidationError as error:
            raise self._explain(type_, data, path, str(error)) from None

    def _explain(self, type_: type[Any], data: Any, path: Path_, message: str) -> FormatError:
        match = _MESSAGE.match(message)
        assert match is not None
        what = match["what"]
        inner = tuple(_parts((match["path"] or "$") + ("[...]" if match["key"] else ""), type_, data, message))
        here = path + inner
        unknown = re.match(r"Object contains unknown field `(.*)`", what)
        missing = re.match(r"Object missing required field `(.*)`", what)
        value = re.match(r"Invalid enum value '?(.*?)'?$", what)
        form = re.match(r"Expected `str` matching regex '(.*)'$", what)
        if form:
            of = f"the key {inner[-1]!r}" if match["key"] else f"{_key(here)}: {_at(data, inner)!r}"
            return self.error(here, f"{of} does not have the form {form[1].replace(2 * chr(92), chr(92))}")
        known = names(type_, inner)
        if unknown:
            return self.error((*here, unknown[1]), f"unknown key {unknown[1]!r}", nearest(unknown[1], known))
        if missing:
            return self.error(here, f"the key {missing[1]!r} is missing", f"add {missing[1]}: ...")
        if value:
            return self.error(here, f"{_key(here)}: unknown value {value[1]!r}", nearest(value[1], known))
        return self.error(here, f"{_key(here)}: {what[0].lower()}{what[1:]}")


def nearest(word: str, known: Sequence[str]) -> str:
    """The remedy for an unknown word: the nearest valid one, or the valid ones.

    >>> nearest("periodc", ["never", "periodic"])
    "did you mean 'periodic'?"
    """
    close = get_close_matches(word, known, 1, 0.6)
    if close:
        return f"did you mean {close[0]!r}?"
    return f"valid are {', '.join(sorted(known))}" if known else ""


def names(type_: Any, path: Path_) -> list[str]:
    """The keys or values that are valid at a path inside a type."""
    info = msgspec.inspect.type_info(type_)
    for part in path:
        info = _step(info, part)
    for choice in _choices(info):
        if isinstance(choice, msgspec.inspect.StructType):
            return [field.encode_name for field in choice.fields]
    return [
        str(value)
        for choice in _choices(info)
        if isinstance(choice, msgspec.inspect.LiteralType)
        for value in choice.values
    ]


def _step(info: msgspec.inspect.Type, part: str | int) -> msgspec.inspect.Type:
    for choice in _choices(info):
        if isinstance(choice, msgspec.inspect.StructType):
            for field in choice.fields:
                if field.encode_name == part:
                    return field.type
        if isinstance(choice, msgspec.inspect.ListType):
            return choice.item_type
        if isinstance(choice, msgspec.inspect.DictType):
            return choice.value_type
    return msgspec.inspect.AnyType()


def _choices(info: msgspec.inspect.Type) -> Sequence[msgspec.inspect.Type]:
    if isinstance(info, msgspec.inspect.Metadata):
        info = info.type
    return info.types if isinstance(info, msgspec.inspect.UnionType) else (info,)


def _parts(text: str, type_: type[Any], data: Any, message: str) -> Iterator[str | int]:
    """The path in msgspec's notation, with ``[...]`` (some value of a mapping) made definite."""
    definite: list[str | int] = []
    for name, index in _PART.findall(text):
        if index == "...":
            here: Any = data
            for part in definite:
                here = here[part]
            found = [key for key in here if _fails(type_, _only(data, definite, key), message)]
            definite.append(found[0] if found else next(iter(here)))
        else:
            definite.append(name or int(index))
    yield from definite


def _only(data: Any, path: Sequence[str | int], key: str) -> Any:
    """A copy of the data in which the mapping at ``path`` has ``key`` alone."""
    if not path:
        return {key: data[key]}
    copy = list(data) if isinstance(data, list) else dict(data)
    copy[path[0]] = _only(data[path[0]], path[1:], key)  # type: ignore[index]
    return copy


def _fails(type_: type[Any], data: Any, message: str) -> bool:
    try:
        msgspec.convert(data, type_, dec_hook=_parse)
    except msgspec.ValidationError as error:
        return str(error) == message
    return False


def _parse(type_: type[Any], value: Any) -> Any:
    """Types that read themselves from text have a ``parse``."""
    return type_.parse(value)


def _at(data: Any, path: Path_) -> Any:
    for part in path:
        data = data[part]
    return data


def _key(path: Path_) -> str:
    return next((str(part) for part in reversed(path) if isinstance(part, str)), "value")
