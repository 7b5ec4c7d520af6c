"""Commands that backends bring: entry points of the group ``nros_conformance.commands``.

The entry point's name is the command's; it names a module with ``HELP`` (one line), ``add_arguments(parser)``
and ``run(options)``, which returns the exit code.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from nros_conformance.cli.codes import ExitCode

if TYPE_CHECKING:
    Commands = argparse._SubParsersAction[argparse.ArgumentParser]

GROUP = "nros_conformance.commands"


class ExtraCommand(Protocol):
    """What such a module has."""

    HELP: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]


def add_extras(commands: Commands) -> None:
    """Add every installed command; one that cannot be imported stays in the list and says why."""
    for entry in sorted(importlib.metadata.entry_points(group=GROUP), key=lambda entry: entry.name):
        if entry.name in commands.choices:
            continue  # the command's own names are not to be replaced
        try:
            extra: ExtraCommand = entry.load()
        except ImportError as error:
            parser = commands.add_parser(entry.name, help=f"not available: {error}", add_help=False)
            parser.set_defaults(run=_unavailable(entry.name, str(error)))
            continue
        parser = commands.add_parser(
            entry.name, help=extra.HELP, description=f"{extra.HELP[0].upper()}{extra.HELP[1:]}."
        )
        extra.add_arguments(parser)
        parser.set_defaults(run=extra.run)


def _unavailable(name: str, reason: str) -> Callable[[argparse.Namespace], int]:
    def run(options: argparse.Namespace) -> int:
        print(f"nros-conformance: the command {name} is not available: {reason}", file=sys.stderr)
        return ExitCode.NOTHING

    return run
