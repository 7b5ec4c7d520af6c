"""Whether an author's headers describe the layout that this adapter speaks: a probe compiled against them."""

from __future__ import annotations

import os
import re
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from nros_backends.native.abi import LAYOUT, POINTER, SPEAKS
from nros_conformance.rmw.loading import LibraryError, find_compiler

HEADER = "nros/rmw_vtable.h"
_LIMIT_S = 60.0
_NO_FIELD = re.compile(r"no member named '?\W?(\w+)")
_VTABLE = "nros_rmw_vtable_t"


def check_headers(folders: Sequence[Path], compiler: str = "") -> str:
    """What was checked, in words. Raises `LibraryError` for headers of another layout, or none.

    Without a compiler nothing is checked, and the words say so.
    """
    compiler = compiler or find_compiler()
    given = " ".join(f"--headers {folder}" for folder in folders)
    if not compiler:
        return f"not by the headers: there is no C compiler (apt install gcc), so {given} changes nothing"
    for folder in folders:
        if not folder.is_dir():
            raise LibraryError(f"--headers {folder} is no directory")
    if not any((folder / HEADER).is_file() for folder in folders):
        raise LibraryError(f"{given}: there is no {HEADER} in it")
    found = _probe(compiler, folders, given)
    for struct, (size, offsets) in LAYOUT.items():
        for field, offset in offsets.items():
            there = found[struct][field]
            if there != offset:
                what = f"slot {there // POINTER}" if struct == _VTABLE else f"offset {there}"
                here = f"slot {offset // POINTER}" if struct == _VTABLE else f"offset {offset}"
                raise LibraryError(
                    f"{given}: {struct}.{field} is at {what}, in {SPEAKS} it is at {here}; what is compiled with "
                    "these headers cannot be called"
                )
        if found[struct]["sizeof"] != size:
            raise LibraryError(
                f"{given}: {struct} has {found[struct]['sizeof']} bytes, in {SPEAKS} it has {size}; what is compiled "
                "with these headers cannot be called"
            )
    fields = sum(len(offsets) for _, offsets in LAYOUT.values())
    return f"{given} describes {len(LAYOUT)} structs and {fields} fields just so"


def source(layout: Mapping[str, tuple[int, Mapping[str, int]]] = LAYOUT) -> str:
    """The probe: a C program that prints a line for every struct and field."""
    lines = [f"#include <{HEADER}>", "#include <stddef.h>", "#include <stdio.h>", "int main(void) {"]
    for struct, (_, offsets) in layout.items():
        lines.append(f'    printf("{struct} sizeof %zu\\n", sizeof({struct}));')
        lines += [f'    printf("{struct} {field} %zu\\n", offsetof({struct}, {field}));' for field in offsets]
    return "\n".join([*lines, "    return 0;", "}", ""])


def _probe(compiler: str, folders: Sequence[Path], given: str) -> dict[str, dict[str, int]]:
    with tempfile.TemporaryDirectory() as scratch:
        program = Path(scratch) / "probe.c"
        program.write_text(source(), encoding="utf-8")
        includes = [f"-I{folder.absolute()}" for folder in folders]
        built = subprocess.run(
            [compiler, "-std=c11", "-w", *includes, str(program), "-o", str(program.with_suffix(""))],
            capture_output=True, text=True, check=False, timeout=_LIMIT_S, env={**os.environ, "LC_ALL": "C"},
        )  # fmt: skip
        if built.returncode:
            error = next((line for line in built.stderr.splitlines() if "error" in line), built.stderr.strip())
            absent = _NO_FIELD.search(error)
            why = f"there is no field {absent[1]}" if absent else error.rpartition("error: ")[2]
            raise LibraryError(f"{given}: {why}; this adapter speaks {SPEAKS}")
        ran = subprocess.run(
            [str(program.with_suffix(""))], capture_output=True, text=True, check=True, timeout=_LIMIT_S
        )
    found: dict[str, dict[str, int]] = {}
    for line in ran.stdout.splitlines():
        struct, field, number = line.split()
        found.setdefault(struct, {})[field] = int(number)
    return found
