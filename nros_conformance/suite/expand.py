"""Parameters: a scenario with ``for`` becomes one scenario per combination of values.

``for: {n: [1, 3], drive: {often: 0.1T, long: {timeout: 10T}}}`` gives the values of each parameter: a
list of plain ones, or a mapping that names them. ``$n`` as a whole scalar is replaced by the value, in
a longer text by its text; ``$$`` is a dollar. ``when: {drive: long}`` keeps a step, entity, session,
given or expectation for these values only, ``unless`` for all others; values are compared as they
are written, named ones by name.
"""

from __future__ import annotations

import copy
import dataclasses
import itertools
import re
from collections.abc import Iterator, Mapping
from typing import Any

from nros_conformance.formats.places import Document, Path_, nearest

_USE = re.compile(r"\$(?P<name>\$|[A-Za-z][A-Za-z0-9_]*)?")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_SHORT = re.compile(r"[A-Za-z0-9_.+*-]+")
_LISTS = ("script", "react", "given", "expect")
_MAPPINGS = ("sessions", "entities")


@dataclasses.dataclass(frozen=True)
class Expanded:
    """One combination: the scenario's key, its parameters, and plain data with the original's lines."""

    key: str
    parameters: dict[str, Any]
    document: Document


@dataclasses.dataclass(frozen=True)
class _Value:
    text: str
    """In the key."""
    shown: Any
    """In `Expanded.parameters`, and what ``when`` compares: the value, or its name."""
    value: Any
    path: Path_


def expand(document: Document, path: Path_, raw: Mapping[str, Any]) -> Iterator[Expanded]:
    """Every combination, in the order of the file. Raises `FormatError`.

    ``raw`` is the scenario that stands at ``path`` of the document.
    """
    parameters = {
        name: _values(document, (*path, "for", name), name, raw["for"][name]) for name in _for(document, path, raw)
    }
    body = {key: value for key, value in raw.items() if key != "for"}
    unused = set(parameters) - set(_uses(document, path, (), body, parameters))
    for name in parameters:
        if name in unused:
            raise document.error(
                (*path, "for", name),
                f"the parameter {name!r} is never used",
                f"write ${name} or when: {{{name}: ...}} somewhere, or remove it",
            )
    for combination in itertools.product(*parameters.values()):
        chosen = dict(zip(parameters, combination, strict=True))
        in_key = ",".join(f"{name}={chosen[name].text}" for name in sorted(chosen))
        key = f"{raw.get('id', '')}[{in_key}]" if chosen else str(raw.get("id", ""))
        filling = _Filling(document, path, chosen)
        data = filling.fill(body, path, ())
        yield Expanded(
            key=key,
            parameters={name: copy.deepcopy(value.shown) for name, value in chosen.items()},
            document=Document(document.file, data, filling.lines, f"in {key}" if chosen else ""),
        )


# --- the parameters -------------------------------------------------------------------------------


def _for(document: Document, path: Path_, raw: Mapping[str, Any]) -> list[str]:
    names = raw.get("for", {})
    here = (*path, "for")
    if not isinstance(names, dict):
        raise document.error(here, "for: parameters are a mapping", "write for example for: {n: [1, 3]}")
    for name in names:
        if not _NAME.fullmatch(name):
            raise document.error((*here, name), f"{name!r} cannot name a parameter", "use letters, digits and _")
    return list(names)


def _values(document: Document, path: Path_, name: str, raw: Any) -> tuple[_Value, ...]:
    if isinstance(raw, dict):
        values = tuple(_Value(text, text, value, (*path, text)) for text, value in raw.items())
    elif isinstance(raw, list):
        values = tuple(_Value(_text(value), value, value, (*path, i)) for i, value in enumerate(raw))
    else:
        raise document.error(
            path, f"{name}: {raw!r} is not a list", f"write {name}: [VALUE, ...] or {name}: {{NAME: VALUE, ...}}"
        )
    if not values:
        raise document.error(path, f"the parameter {name!r} has no values", "give it one or more")
    for index, value in enumerate(values):
        remedy = f"name it: {name}: {{NAME: VALUE, ...}}"
        if isinstance(value.shown, (dict, list)):
            raise document.error(value.path, f"{name}: a value that is {_kind(value.value)} needs a name", remedy)
        if not _SHORT.fullmatch(value.text):
            raise document.error(value.path, f"{name}: {value.text!r} cannot stand in a scenario's key", remedy)
        if value.text in (other.text for other in values[:index]):
            raise document.error(value.path, f"{name}: the value {value.text} stands here twice")
        for inner in _texts(value.value):
            if "$" in inner:
                raise document.error(value.path, f"{name}: {inner!r}: a value cannot use parameters")
    return values


def _text(value: Any) -> str:
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    return str(value).replace(" ", "")


def _kind(value: Any) -> str:
    return "a mapping" if isinstance(value, dict) else "a list"


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield key
            yield from _texts(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _texts(inner)
    elif isinstance(value, str):
        yield value


# --- their uses -----------------------------------------------------------------------------------


def _uses(
    document: Document, base: Path_, path: Path_, raw: Any, parameters: Mapping[str, tuple[_Value, ...]]
) -> Iterator[str]:
    """The parameters that are used, in whatever combination. Raises `FormatError` for an unknown one."""
    if isinstance(raw, dict):
        for key, inner in raw.items():
            here = (*path, key)
            if key in ("when", "unless") and _conditional(path):
                yield from _condition(document, base + here, inner, parameters)
            else:
                yield from _used(document, base + here, key, parameters)
                yield from _uses(document, base, here, inner, parameters)
    elif isinstance(raw, list):
        for index, inner in enumerate(raw):
            yield from _uses(document, base, (*path, index), inner, parameters)
    elif isinstance(raw, str) and path != ("id",):
        yield from _used(document, base + path, raw, parameters)


def _used(document: Document, path: Path_, text: str, parameters: Mapping[str, Any]) -> Iterator[str]:
    for use in _USE.finditer(text):
        name = use["name"]
        if not name:
            raise document.error(path, f"a lone $ in {text!r}", "write $$ for a dollar")
        if name != "$":
            _known(document, path, f"${name}", name, parameters)
            yield name


def _known(document: Document, path: Path_, shown: str, name: str, parameters: Mapping[str, Any]) -> None:
    if name not in parameters:
        raise document.error(
            path, f"undefined parameter {shown}", nearest(name, list(parameters)) or "the scenario has no for:"
        )


def _condition(
    document: Document, path: Path_, raw: Any, parameters: Mapping[str, tuple[_Value, ...]]
) -> Iterator[str]:
    word = path[-1]
    if not isinstance(raw, dict) or not raw:
        raise document.error(path, f"{word}: {raw!r} is no condition", f"write {word}: {{PARAMETER: VALUE}}")
    for name, wanted in raw.items():
        _known(document, (*path, name), name, name, parameters)
        for value in wanted if isinstance(wanted, list) else [wanted]:
            if not any(_same(value, other.shown) for other in parameters[name]):
                valid = [other.text for other in parameters[name]]
                raise document.error(
                    (*path, name), f"{word}: {name} is never {_text(value)}", nearest(_text(value), valid)
                )
        yield name


def _conditional(path: Path_) -> bool:
    """Whether the mapping at this path of a scenario may carry ``when`` and ``unless``."""
    if len(path) == 2:
        return path[0] in (*_LISTS, *_MAPPINGS)
    return len(path) > 2 and path[0] in _LISTS and isinstance(path[-1], int)


def _same(one: Any, other: Any) -> bool:
    return isinstance(one, bool) == isinstance(other, bool) and bool(one == other)


# --- one combination ------------------------------------------------------------------------------


class _Filling:
    """Copies a scenario with one combination put in, and keeps the line of every part."""

    def __init__(self, document: Document, base: Path_, chosen: Mapping[str, _Value]) -> None:
        self.lines: dict[Path_, int] = {}
        self._document = document
        self._base = base
        self._chosen = chosen

    def fill(self, raw: Any, old: Path_, new: Path_) -> Any:
        """The part at ``old`` of the document, as it stands at ``new`` of the expanded scenario."""
        self.lines[new] = self._document.line(old)
        if isinstance(raw, dict):
            return self._mapping(raw, old, new)
        if isinstance(raw, list):
            return self._list(raw, old, new)
        if isinstance(raw, str) and "$" in raw and new != ("id",):
            return self._scalar(raw, old, new)
        return raw

    def _mapping(self, raw: dict[str, Any], old: Path_, new: Path_) -> dict[str, Any]:
        conditional = _conditional(old[len(self._base) :])
        filled: dict[str, Any] = {}
        for key, inner in raw.items():
            if (conditional and key in ("when", "unless")) or not self._applies(inner, (*old, key)):
                continue
            name = self._put(key, (*old, key)) if "$" in key else key
            if name in filled:
                raise self._document.error((*old, key), f"the key {name!r} stands here twice, once as a parameter")
            filled[name] = self.fill(inner, (*old, key), (*new, name))
        return filled

    def _list(self, raw: list[Any], old: Path_, new: Path_) -> list[Any]:
        filled: list[Any] = []
        for index, inner in enumerate(raw):
            if self._applies(inner, (*old, index)):
                item = self.fill(inner, (*old, index), (*new, len(filled)))
                if item != [] or inner == []:  # a branch of which nothing is left goes too
                    filled.append(item)
        return filled

    def _scalar(self, raw: str, old: Path_, new: Path_) -> Any:
        use = _USE.fullmatch(raw)
        if use and use["name"] != "$":
            value = self._chosen[use["name"]]
            self._keep_lines(value.value, value.path, new)
            return copy.deepcopy(value.value)
        return self._put(raw, old)

    def _keep_lines(self, value: Any, old: Path_, new: Path_) -> None:
        """Inside of a value that is put in, errors are errors of the value and name its lines."""
        parts = value.keys() if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
        for part in parts:
            self.lines[(*new, part)] = self._document.line((*old, part))
            self._keep_lines(value[part], (*old, part), (*new, part))

    def _put(self, raw: str, old: Path_) -> str:
        def text(use: re.Match[str]) -> str:
            name = use["name"]
            if name == "$":
                return "$"
            value = self._chosen[name].value
            if isinstance(value, (dict, list)):
                raise self._document.error(old, f"${name} is {_kind(value)} and cannot stand inside of a text")
            return "null" if value is None else str(value).lower() if isinstance(value, bool) else str(value)

        return _USE.sub(text, raw)

    def _applies(self, raw: Any, old: Path_) -> bool:
        if not isinstance(raw, dict) or not _conditional(old[len(self._base) :]):
            return True
        if "unless" in raw and self._holds(raw["unless"]):
            return False
        return "when" not in raw or self._holds(raw["when"])

    def _holds(self, condition: Mapping[str, Any]) -> bool:
        return all(
            any(_same(value, self._chosen[name].shown) for value in (wanted if isinstance(wanted, list) else [wanted]))
            for name, wanted in condition.items()
        )
