"""Backends that are files, not adapters: found by path, through a loader of the group ``nros_conformance.loaders``.

A loader looks at the file in a process of its own and hands back a `Found` like that of an installed
backend, with the options that its adapter needs to load the file again in a worker.
"""

from __future__ import annotations

import dataclasses
import importlib.metadata
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Literal, TypeAlias

from nros_conformance.rmw.discovery import Found

GROUP = "nros_conformance.loaders"


class LibraryError(Exception):
    """A library that cannot be played. The text says why, and what helps.

    ``broken``: it failed while it ran (a crash, a hang), rather than being none that can be loaded.
    """

    def __init__(self, text: str, *, broken: bool = False) -> None:
        super().__init__(text)
        self.broken = broken


@dataclasses.dataclass(frozen=True, slots=True)
class LibraryRequest:
    """What somebody says about a compiled backend on the command line.

    ``name``: the one that it registers, empty when it registers one only. ``domain``: the first domain id;
    scenarios that are played together use those that follow. ``topic_hook``: called before an entity is
    created, a function of the libraries or ``module:function``. ``headers``: include folders that the
    library was compiled with. ``sessions``: at once in a process; 0 as declared. ``storage``: whether the
    structs stay where they are, or are fresh copies in every call.
    """

    file: Path
    name: str = ""
    locator: str = ""
    mode: Literal["client", "peer"] = "client"
    domain: int = 0
    host_libraries: tuple[Path, ...] = ()
    topic_hook: str = ""
    headers: tuple[Path, ...] = ()
    sessions: int = 0
    storage: Literal["stable", "fresh"] = "fresh"
    declaration: Path | None = None


@dataclasses.dataclass(frozen=True, slots=True)
class Loaded:
    """A library that can be played: what it was found to be, in lines to print, and a declaration to start from."""

    found: Found
    says: tuple[str, ...]
    draft: str


Loader: TypeAlias = Callable[[LibraryRequest], Loaded]


def find_loader(kind: str) -> Loader:
    """The loader of this kind of file. Raises `LibraryError` when none is installed, or it does not load."""
    for entry in importlib.metadata.entry_points(group=GROUP, name=kind):
        loader: Loader = entry.load()
        return loader
    raise LibraryError(
        f"no loader for {kind} libraries is installed; run: pip install -e . (entry points exist only once installed)"
    )


def find_compiler() -> str:
    """The C compiler that a loader may use: ``$CC``, else the first of the usual ones; empty when there is none."""
    named = os.environ.get("CC", "")
    return next(filter(None, (shutil.which(name) for name in (named, "cc", "gcc", "clang") if name)), "")
