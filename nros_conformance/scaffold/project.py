"""A new backend's package from the files in ``template``.

``NAME`` in a path, and ``$name``, ``$dashed``, ``$title`` and ``$class_`` in a text, stand for the new name.
"""

from __future__ import annotations

import re
from pathlib import Path
from string import Template

TEMPLATE = Path(__file__).parent / "template"
SUFFIX = ".tmpl"
"""So that neither linters nor pytest take a template for what it becomes."""

_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")


class ScaffoldError(Exception):
    """The package cannot be written. The text is for the user."""


def write_project(name: str, folder: Path) -> list[Path]:
    """Write the package of backend ``name`` into ``folder``, which must not exist; the files, in order.

    Raises `ScaffoldError`.
    """
    if not _NAME.fullmatch(name):
        raise ScaffoldError(f"a backend cannot be called {name!r}; use lower-case letters, digits and _, as in my_mqtt")
    if folder.exists():
        raise ScaffoldError(f"{folder} exists already; remove it, or choose another place with --into DIR")
    words = name.split("_")
    values = {
        "name": name,
        "dashed": "-".join(words),
        "title": " ".join(words).capitalize(),
        "class_": "".join(word.capitalize() for word in words),
    }
    written = []
    for source in sorted(TEMPLATE.rglob(f"*{SUFFIX}")):
        place = str(source.relative_to(TEMPLATE)).removesuffix(SUFFIX).replace("NAME", name)
        file = folder / place
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(Template(source.read_text(encoding="utf-8")).substitute(values), encoding="utf-8")
        written.append(file)
    return written
