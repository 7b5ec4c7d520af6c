"""Which ``[[known]]`` entries of a declaration speak about a result."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterable, Mapping

from nros_conformance.report.results import ReportError, ScenarioResult
from nros_conformance.rmw.declaration import Declaration, Known

_SPECIFIER = re.compile(r"\s*(==|!=|>=|<=|>|<)\s*(\d+(?:\.\d+)*)\s*$")
_NUMBERS = re.compile(r"\d+(?:\.\d+)*")
_OPERATORS: dict[str, Callable[[tuple[int, ...], tuple[int, ...]], bool]] = {
    "==": operator.eq, "!=": operator.ne, ">=": operator.ge, "<=": operator.le, ">": operator.gt, "<": operator.lt,
}  # fmt: skip


def in_force(declaration: Declaration, versions: Mapping[str, str]) -> tuple[Known, ...]:
    """The entries whose version range holds the tested version of the subject's package.

    Raises `ReportError` for a range that cannot be read.
    """
    version = versions.get(declaration.subject.package, "")
    return tuple(known for known in declaration.known if _within(declaration, known, version))


def concerns(known: Known, result: ScenarioResult) -> bool:
    """Whether an entry names this scenario: by id (with any parameters) or by key."""
    return known.scenario in (result.id, result.key)


def must_show(known: Known, results: Iterable[ScenarioResult]) -> bool:
    """Whether the deviation has to show in these.

    Not if it is declared as one that shows sometimes, nor where a repeat was needed: that is played at a larger T.
    """
    return known.strict and all(len(result.attempts) < 2 for result in results)


def covering(entries: tuple[Known, ...], result: ScenarioResult, requirement: str) -> Known | None:
    """The entry that declares this violation."""
    return next((one for one in entries if one.requirement == requirement and concerns(one, result)), None)


def _within(declaration: Declaration, known: Known, version: str) -> bool:
    specifiers = []
    for part in filter(None, known.versions.split(",")):
        match = _SPECIFIER.match(part)
        if match is None:
            raise ReportError(
                f"{declaration.name}: [[known]] {known.key}: cannot read versions = {known.versions!r}; "
                'write for example "==11.0.1" or ">=11,<12"'
            )
        specifiers.append((_OPERATORS[match[1]], _release(match[2])))
    found = _NUMBERS.match(version)
    # Without a version to compare, such as that of a model, the range says nothing.
    return found is None or all(compare(_release(found[0]), wanted) for compare, wanted in specifiers)


def _release(text: str) -> tuple[int, ...]:
    """``11.0`` and ``11.0.0`` are the same release."""
    parts = [int(part) for part in text.split(".")]
    while parts and not parts[-1]:
        parts.pop()
    return tuple(parts)
