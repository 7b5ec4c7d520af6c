"""Generated pages of ``docs/``: the requirements, and the fields of ``backend.toml``.

python -m nros_conformance.report.handbook     writes both; a test fails when they differ
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from nros_conformance.report.markdown import table
from nros_conformance.rmw import declaration
from nros_conformance.suite.catalogue import Requirements
from nros_conformance.suite.loader import load_suites

COMMAND = "python -m nros_conformance.report.handbook"

_SECTIONS: tuple[tuple[str, type[Any]], ...] = (
    ("Top level", declaration.Declaration), ("`[subject]`", declaration.Subject),
    ("`[events.<Event>]`", declaration.Event), ("`[connection]`", declaration.Connection),
    ("`hard_liveliness` of `[connection]`", declaration.HardLiveliness), ("`[bounds]`", declaration.Bounds),
    ("`[behaviour]`", declaration.Behaviour), ("`[qos]`", declaration.QosSupport), ("`[[known]]`", declaration.Known),
)  # fmt: skip


def requirements_page(requirements: Requirements) -> str:
    """``docs/requirements.md``."""
    parts = [
        f"<!-- Generated from suites/requirements.yaml by `{COMMAND}`. Do not edit. -->\n# Requirements\n",
        f"{len(requirements)} normative statements. A *must* fails a backend that advertises the feature; a *should* "
        "is reported as a warning; a *may* is a permission that the judge allows for.\n",
    ]
    for group, title in requirements.groups.items():
        rows = [
            [one.id, one.level, _cell(one.statement, one.resolution), one.source]
            for one in requirements
            if one.group == group
        ]
        parts.append(f"## {group}: {title}\n\n{table(['id', 'level', 'statement', 'source'], rows)}\n")
    sources = [[name, text] for name, text in requirements.sources.items()]
    parts.append(f"## Sources\n\n{table(['abbreviation', 'source'], sources)}\n")
    return "\n".join(parts)


def declaration_page() -> str:
    """``docs/backend-toml.md``."""
    parts = [
        f"<!-- Generated from rmw/declaration.py by `{COMMAND}`. Do not edit. -->\n# `backend.toml`\n",
        "What a backend says about itself. It stands beside the adapter's module. Every line is checked by the runs, "
        "both ways: claimed and broken, absent yet answering, working yet undeclared, and a known failure that passes "
        "all end in exit code 1. What is left out has the strict value, which is the default below.\n\n"
        "Complete examples: [Cyclone DDS](../backends/nros_backends/cyclone/backend.toml), "
        "[uORB](../backends/nros_backends/uorb/backend.toml).\n",
    ]
    for title, section in _SECTIONS:
        rows = [list(row) for row in _fields(section)]
        parts.append(f"## {title}\n\n{table(['field', 'type', 'default', 'meaning'], rows)}\n")
    return "\n".join(parts)


def pages(docs: Path) -> dict[Path, str]:
    """All generated pages by file."""
    return {
        docs / "requirements.md": requirements_page(load_suites().requirements),
        docs / "backend-toml.md": declaration_page(),
    }


def _fields(section: type[Any]) -> Iterator[tuple[str, str, str, str]]:
    meanings = _docstrings(section)
    types = {
        statement.target.id: ast.unparse(statement.annotation)
        for statement in _class_body(section)
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name)
    }
    for one in msgspec.structs.fields(section):
        default = "required" if one.required else _show(one)
        yield one.encode_name, f"`{types[one.name]}`".replace("|", "\\|"), default, meanings.get(one.name, "")


def _docstrings(section: type[Any]) -> dict[str, str]:
    """The literal under a field."""
    found, last = {}, ""
    for statement in _class_body(section):
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            last = statement.target.id
        elif isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant) and last:
            found[last] = " ".join(str(statement.value.value).split())
            last = ""
    return found


def _class_body(section: type[Any]) -> list[ast.stmt]:
    tree = ast.parse(inspect.getsource(section)).body[0]
    assert isinstance(tree, ast.ClassDef)
    return tree.body


def _show(one: msgspec.structs.FieldInfo) -> str:
    value = one.default_factory() if one.default is msgspec.NODEFAULT else one.default
    if isinstance(value, msgspec.Struct):
        return "see below"
    if value is None or value in ("", [], {}):
        return ""
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


def _cell(statement: str, resolution: str) -> str:
    text = f"{statement} *Settled:* {resolution}" if resolution else statement
    return " ".join(text.split()).replace("|", "\\|")


def main() -> None:
    """Write the pages."""
    for file, text in pages(Path("docs")).items():
        file.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
