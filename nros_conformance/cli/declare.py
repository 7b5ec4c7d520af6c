"""``nros-conformance declare``: probes a compiled backend and drafts its declaration."""

from __future__ import annotations

import argparse
import sys

from nros_conformance.cli import native
from nros_conformance.cli.codes import ExitCode
from nros_conformance.rmw.loading import LibraryError


def run(options: argparse.Namespace) -> ExitCode:
    """Print the draft, or write it; what was found goes to standard error."""
    try:
        loaded = native.load(options)
    except LibraryError as error:
        return refused(error)
    for line in loaded.says:
        print(line, file=sys.stderr)
    if options.output is None:
        print(loaded.draft, end="")
    elif options.output.exists():
        print(f"nros-conformance: {options.output} exists; remove it, or name another --output", file=sys.stderr)
        return ExitCode.USAGE
    else:
        options.output.write_text(loaded.draft, encoding="utf-8")
        print(f"written  {options.output}", file=sys.stderr)
    return ExitCode.OK


def refused(error: LibraryError) -> ExitCode:
    """Say why a library cannot be played: 1 if it failed while it ran, else 5."""
    print(f"nros-conformance: {error}", file=sys.stderr)
    return ExitCode.FAILED if error.broken else ExitCode.NOTHING
