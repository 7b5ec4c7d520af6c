"""``nros-conformance new-backend``: the package of a new backend, and what to do with it."""

from __future__ import annotations

import argparse
from pathlib import Path

from nros_conformance.cli.codes import ExitCode
from nros_conformance.rmw.discovery import find_backends
from nros_conformance.scaffold.project import ScaffoldError, write_project


def run(options: argparse.Namespace) -> ExitCode:
    """Write it, and print the next two commands."""
    name: str = options.name
    taken = find_backends().get(name)
    if taken is not None:
        raise ScaffoldError(f"there is a backend {name!r} already: {taken.adapter}")
    folder: Path = options.into or Path(f"nros-{name.replace('_', '-')}")
    for file in write_project(name, folder):
        print(f"written  {file}")
    print(f"\nnext     pip install -e {folder}\n         nros-conformance run --backend {name}")
    return ExitCode.OK
