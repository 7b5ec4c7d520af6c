"""Suite files as scenarios that can be played: parameters put in, everything checked."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from nros_conformance.formats.places import Document, FormatError
from nros_conformance.formats.yaml12 import read_yaml
from nros_conformance.suite.catalogue import Requirements, load_requirements
from nros_conformance.suite.check import check
from nros_conformance.suite.expand import expand
from nros_conformance.suite.heads import read_scenario
from nros_conformance.suite.schema import Scenario, SuiteFile

REQUIREMENTS = "requirements.yaml"
"""The file of a suite directory that is no suite. A directory without one uses the catalogue shipped here."""

PUBLISHED = "published.yaml"
"""Another one (`published`)."""

_SUFFIXES = (".yaml", ".yml")


@dataclasses.dataclass(frozen=True)
class Loaded:
    """One scenario with one combination of its parameters."""

    key: str
    """The id, with parameters in the order of their names: ``rdm.one-per-period[drive=long]``."""
    scenario: Scenario
    raw: dict[str, Any]
    """The same as plain data in the notation of suites, defaults left out; `typed` reads it again."""
    suite: str
    source: str
    """Where it stands: ``suites/registration.yaml:12``."""
    parameters: dict[str, Any]
    """Name -> value, or the value's name where the suite gives one."""


@dataclasses.dataclass(frozen=True)
class Suites:
    """All scenarios of a directory, in the order of file names and files."""

    scenarios: tuple[Loaded, ...]
    requirements: Requirements
    digest: str
    """``sha256:...`` over what the suites and the catalogue say, however they are laid out."""
    directory: Path

    @property
    def version(self) -> str:
        """The version of the suites, such as ``1.0``."""
        return self.requirements.version

    @property
    def levels(self) -> dict[str, str]:
        """Requirement id -> must, should or may, in the order of the catalogue."""
        return {one.id: one.level for one in self.requirements}


def load_suites(directory: Path | None = None) -> Suites:
    """The suites of a directory; by default those that come with the package.

    Raises `FormatError` for the first thing that is wrong, with the file relative to the directory's parent.
    """
    directory = shipped_suites() if directory is None else directory.absolute()
    if not directory.is_dir():
        raise FormatError(directory, None, "no such directory")
    files = sorted(
        file for file in directory.iterdir() if file.suffix in _SUFFIXES and file.name not in (REQUIREMENTS, PUBLISHED)
    )
    if not files:
        raise FormatError(directory, None, "no suite files here", "suites are files that end in .yaml")
    catalogue = directory if (directory / REQUIREMENTS).is_file() else shipped_suites()
    requirements = load_requirements(*_shown(catalogue / REQUIREMENTS))
    scenarios: list[Loaded] = []
    first: dict[str, str] = {}
    titles: dict[str, str] = {}
    for file in files:
        document = read_yaml(*_shown(file))
        head = document.read(SuiteFile)
        if head.suite in titles:
            raise document.error(("suite",), f"there is another suite {head.suite!r}", "one file for each")
        titles[head.suite] = head.title
        scenarios += _load(document, head, requirements, first)
    return Suites(tuple(scenarios), requirements, _digest(titles, scenarios, requirements), directory)


def typed(raw: dict[str, Any], name: str = "scenario") -> Scenario:
    """Plain data (`Loaded.raw`, as traces embed it) as a scenario again. ``name`` is for errors.

    Raises `FormatError` for what is no scenario; names within it are not checked again.
    """
    return read_scenario(Document(name, raw, {}))


def shipped_suites() -> Path:
    """The directory of the suites that come with the package: in a wheel within it, in a checkout beside it."""
    package = Path(__file__).parents[1]
    within = package / "suites"
    return within if within.is_dir() else package.parent / "suites"


def _shown(file: Path) -> tuple[Path, str]:
    """The name that messages use, and the text."""
    shown = Path(file.parent.name) / file.name
    try:
        return shown, file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise FormatError(shown, None, f"cannot be read: {error}") from None


def _load(document: Document, head: SuiteFile, requirements: Requirements, first: dict[str, str]) -> Iterator[Loaded]:
    """The scenarios of one file; ``first`` is where each id has been seen."""
    if not head.scenarios:
        raise document.error(("scenarios",), "the suite has no scenarios", "add one or more")
    for index, raw in enumerate(head.scenarios):
        path = ("scenarios", index)
        if not isinstance(raw, dict):
            raise document.error(path, f"{raw!r} is not a scenario", "a scenario is a mapping with id:, title:, ...")
        source = f"{document.file}:{document.line(path)}"
        id_ = str(raw.get("id", ""))
        if id_ in first:
            raise document.error((*path, "id"), f"the scenario {id_} stands twice", f"the first is at {first[id_]}")
        first[id_] = f"{document.file}:{document.line((*path, 'id'))}"
        for expanded in expand(document, path, raw):
            scenario = read_scenario(expanded.document)
            check(expanded.document, scenario, requirements)
            yield Loaded(
                key=expanded.key,
                scenario=scenario,
                raw=msgspec.to_builtins(scenario, enc_hook=str),
                suite=head.suite,
                source=source,
                parameters=expanded.parameters,
            )


def _digest(titles: dict[str, str], scenarios: list[Loaded], requirements: Requirements) -> str:
    content = {
        "version": requirements.version,
        "suites": titles,
        "scenarios": {one.key: [one.suite, one.raw] for one in scenarios},
        "requirements": {one.id: msgspec.to_builtins(one) for one in requirements},
    }
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"
