"""Compiled backends on the command line: what ``--native`` and its companions ask for.

Part of the parser, so it imports nothing that costs time before a library is really loaded.
"""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from nros_conformance.rmw.loading import Loaded


def arguments(command: argparse.ArgumentParser, *, required: bool = False) -> None:
    """Add them to a command; argparse gives the paths as texts, so that they can be repeated as they were."""
    group = command.add_argument_group("a compiled backend")
    group.add_argument("--native", metavar="FILE", required=required, help="a shared library that fills the vtable")
    group.add_argument("--name", default="", help="the name that it registers, if it registers several")
    group.add_argument("--locator", default="", help="passed to create_session")
    group.add_argument("--mode", choices=["client", "peer"], default="client", help="default: client")
    group.add_argument("--domain", type=int, default=0, metavar="N", help="the first domain id; default: 0")
    group.add_argument(
        "--host-lib", action="append", default=[], metavar="FILE", help="a library to load before it; repeatable"
    )
    group.add_argument(
        "--topic-hook", default="", metavar="FUNCTION",
        help="called with topic and type before an entity is created: exported by a library, or module:function",
    )  # fmt: skip
    group.add_argument(
        "--headers", action="append", default=[], metavar="DIR",
        help="an include folder that it was compiled with, whose layout is checked; repeatable",
    )  # fmt: skip
    group.add_argument(
        "--storage", choices=["fresh", "stable"], default="fresh",
        help="whether each call gets a fresh copy of the structs; default: fresh",
    )  # fmt: skip
    group.add_argument(
        "--sessions", type=int, default=0, metavar="N", help="at once in a process; default: as declared, else 8"
    )
    group.add_argument(
        "--group", type=int, default=0, metavar="N",
        help="scenarios that one process plays before a fresh one takes over; default: all",
    )  # fmt: skip


def load(options: argparse.Namespace) -> Loaded:
    """Load what they ask for. Raises `LibraryError`."""
    from nros_conformance.rmw.loading import LibraryRequest, find_loader

    declaration = getattr(options, "declaration", None)
    return find_loader("native")(
        LibraryRequest(
            file=Path(options.native),
            name=options.name,
            locator=options.locator,
            mode=options.mode,
            domain=options.domain,
            host_libraries=tuple(Path(file) for file in options.host_lib),
            topic_hook=options.topic_hook,
            headers=tuple(Path(folder) for folder in options.headers),
            sessions=options.sessions,
            storage=options.storage,
            declaration=Path(declaration) if declaration else None,
        )
    )


def spelled(options: argparse.Namespace) -> str:
    """The arguments that name this backend again."""
    words = ["--native", options.native]
    for name in ("name", "locator", "topic_hook", "declaration"):
        if value := getattr(options, name, None):
            words += [f"--{name.replace('_', '-')}", str(value)]
    for name, default in (("mode", "client"), ("domain", 0), ("storage", "fresh"), ("sessions", 0)):
        if (value := getattr(options, name)) != default:
            words += [f"--{name}", str(value)]
    for name in ("host_lib", "headers"):
        for value in getattr(options, name):
            words += [f"--{name.replace('_', '-')}", value]
    return shlex.join(words)
