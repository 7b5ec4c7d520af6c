"""The notes below the table: why something is absent, limited or violated, each under a stable key."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence

from msgspec import Struct

from nros_conformance.report.applicability import is_limited, limits
from nros_conformance.report.evidence import Evidence
from nros_conformance.report.known import in_force
from nros_conformance.report.markdown import link, prose, sentence
from nros_conformance.report.results import Report
from nros_conformance.rmw.declaration import Absent, Declaration, Known
from nros_conformance.rmw.events import EventKind

_CLASSES: Mapping[Absent, str] = {"never": "never", "not-yet": "not yet", "not-wired": "not wired"}


class Note(Struct, frozen=True, kw_only=True):
    """One key and what it stands for, in Markdown."""

    key: str
    texts: tuple[str, ...]


class Keys(Struct, frozen=True, kw_only=True):
    """The keys that the cells of one row may carry."""

    absences: dict[str, tuple[str, ...]] = {}
    """By column: why it is absent or limited."""
    violations: dict[str, tuple[str, ...]] = {}
    """By requirement."""


NO_KEYS = Keys()


def assign(rows: Sequence[tuple[Report, Mapping[str, Evidence]]]) -> tuple[dict[str, Keys], tuple[Note, ...]]:
    """Keys per row, and all notes in the order of printing.

    Rows of one backend (its variants) share their notes. A key that an earlier backend has taken is
    printed with the backend's name before it. What no ``[[known]]`` entry covers is ``!1``, ``!2``...
    """
    taken: set[str] = set()
    unknown = 0
    keys: dict[str, Keys] = {}
    notes: list[Note] = []
    for backend in dict.fromkeys(report.backend for report, _ in rows):
        members = [(report, found) for report, found in rows if report.backend == backend]
        texts: dict[str, list[str]] = {}
        names = _Names(backend, taken)
        absences: dict[str, dict[str, tuple[str, ...]]] = {report.row: {} for report, _ in members}
        for row, column, key, text in _absences([report for report, _ in members]):
            absences[row][column] = (names.of(key),)
            texts.setdefault(names.of(key), []).append(text)
        for key, text in _known(members):
            texts.setdefault(names.of(key), []).insert(0, text)
        taken |= set(texts)
        surprises: list[Note] = []
        for report, found in members:
            violations: dict[str, tuple[str, ...]] = {}
            for requirement, one in found.items():
                own = [names.of(key) for key in one.known]
                if one.level == "must" and one.standing == "violated":
                    unknown += 1
                    own.append(f"!{unknown}")
                    surprises.append(Note(key=own[-1], texts=(_surprise(one),)))
                if own:
                    violations[requirement] = tuple(own)
            keys[report.row] = Keys(absences=absences[report.row], violations=violations)
        ordered = sorted(texts.items(), key=lambda item: natural(item[0]))
        notes += [Note(key=key, texts=tuple(dict.fromkeys(lines))) for key, lines in ordered]
        notes += surprises
    return keys, tuple(notes)


def natural(key: str) -> tuple[str | int, ...]:
    """Sorts ``C10`` behind ``C9``."""
    parts = re.split(r"(\d+)", key)
    return tuple(int(part) if index % 2 else part for index, part in enumerate(parts))


class _Names:
    def __init__(self, backend: str, taken: set[str]) -> None:
        self._backend = backend
        self._taken = frozenset(taken)

    def of(self, key: str) -> str:
        return f"{self._backend}:{key}" if key in self._taken else key


def _absences(reports: Sequence[Report]) -> Iterable[tuple[str, str, str, str]]:
    """(row, column, key, text) of all that the rows of a backend do not claim in full; in order of the columns."""
    first = reports[0].declaration
    explicit = {*first.notes.values(), *(known.key for one in reports for known in one.declaration.known)}
    letter = next((character for character in first.name if character.isalnum()), "N").upper()
    derived: dict[str, str] = {}
    number = 0
    for report in reports:
        for column, text in _subjects(report.declaration):
            key = report.declaration.notes.get(column) or derived.get(text)
            while key is None:
                number += 1
                if f"{letter}{number}" not in explicit:
                    key = derived[text] = f"{letter}{number}"
            yield report.row, column, key, text


def _subjects(declaration: Declaration) -> Iterable[tuple[str, str]]:
    for kind in EventKind:
        event = declaration.event(kind)
        if event.claim == "no":
            yield kind.label, _absent(event.absent, event.because, event.link)
        elif is_limited(declaration, kind):
            yield kind.label, _limit(limits(declaration, kind), event.because, event.link)
    connection = declaration.connection
    reason = (connection.because, connection.link)
    if connection.ping == "no":
        yield "ping", _absent(connection.absent, *reason)
    if connection.peer != "none" and connection.reconnect != "yes":
        limited = connection.reconnect == "limited"
        yield "reconnect", _limit({}, *reason) if limited else _absent(connection.absent, *reason)
    if connection.hard_liveliness.claim == "limited":
        yield "hard_liveliness", _limit({}, *reason)


def _absent(absent: Absent | None, because: str, source: str) -> str:
    if absent is None:
        return "**not declared**: `backend.toml` says nothing about it."
    return _line(f"**{_CLASSES[absent]}**", because, source)


def _limit(limit: Mapping[str, object], because: str, source: str) -> str:
    shown = ", ".join(f"{name} = {json.dumps(value, sort_keys=True)}" for name, value in sorted(limit.items()))
    return _line(f"**limit** `{shown}`" if shown else "**limit**", because, source)


def _line(head: str, because: str, source: str) -> str:
    where = f" ({link(source)})" if source else ""
    return sentence(f"{head}: {prose(because)}{where}" if because else f"{head}{where}")


def _known(members: Sequence[tuple[Report, Mapping[str, Evidence]]]) -> Iterable[tuple[str, str]]:
    """(key, text) of the ``[[known]]`` entries that showed."""
    shown: dict[str, set[str]] = {}
    violated: dict[str, set[str]] = {}
    entries: dict[str, list[Known]] = {}
    for report, found in members:
        for requirement, one in found.items():
            for proof in one.proofs:
                if proof.known:
                    shown.setdefault(proof.known, set()).add(proof.scenario)
                    violated.setdefault(proof.known, set()).add(requirement)
        for known in in_force(report.declaration, report.versions):
            if known not in entries.setdefault(known.key, []):
                entries[known.key].append(known)
    package = members[0][0].declaration.subject.package
    for key in sorted(shown):
        of = [one for one in entries[key] if one.requirement in violated[key]]
        yield (
            key,
            " ".join(
                (
                    _line(
                        f"**violates {', '.join(sorted(violated[key]))}**", "; ".join(_each(k.because for k in of)), ""
                    ),
                    f"Shown by {', '.join(f'`{scenario}`' for scenario in sorted(shown[key]))}.",
                    f"Cause: {', '.join(_each(k.cause for k in of))}.",
                    f"Known{_versions(package, of)}; {', '.join(link(text) for text in _each(k.link for k in of))}.",
                )
            ),
        )


def _surprise(one: Evidence) -> str:
    shown = sorted({proof.scenario for proof in one.proofs if proof.outcome == "fail" and not proof.known})
    return (
        f"**violates {one.requirement}**, which no `[[known]]` entry covers. "
        f"Shown by {', '.join(f'`{scenario}`' for scenario in shown)}."
    )


def _versions(package: str, entries: Iterable[Known]) -> str:
    ranges = [text.removeprefix("==") for text in _each(known.versions for known in entries) if text]
    return f" in {package or 'version'} {prose(', '.join(ranges))}" if ranges else ""


def _each(texts: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(texts))
