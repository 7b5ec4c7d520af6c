"""Finding backends: entry points of the group ``nros_conformance.backends``, or ``module:Class``.

An entry point names an adapter class; its ``backend.toml`` stands beside the class's module, so that
listing backends imports no middleware.
"""

from __future__ import annotations

import dataclasses
import importlib
import importlib.metadata
import importlib.util
from collections.abc import Mapping
from pathlib import Path

from nros_conformance.formats.places import FormatError, nearest
from nros_conformance.rmw.backend import Backend
from nros_conformance.rmw.declaration import Declaration, load_declaration

GROUP = "nros_conformance.backends"


class BackendNotFound(Exception):
    """No backend of that name. The text says which there are."""


@dataclasses.dataclass(frozen=True, slots=True)
class Unavailable:
    """Why a backend cannot run here, and the command that mends it."""

    reason: str
    install: str


@dataclasses.dataclass(frozen=True, slots=True)
class Found:
    """A backend that was found: its declaration, or what is wrong with it.

    ``options``: for `Host.options`. ``provisional``: why its row cannot be published; empty when it can.
    """

    name: str
    adapter: str
    declaration: Declaration | None = None
    error: FormatError | None = None
    origin: str = ""
    options: Mapping[str, str] = dataclasses.field(default_factory=dict)
    provisional: str = ""

    def load(self) -> type[Backend]:
        """Import the adapter class. Raises ImportError when its middleware is missing."""
        module, _, attribute = self.adapter.partition(":")
        found = getattr(importlib.import_module(module), attribute)
        if not (isinstance(found, type) and issubclass(found, Backend)):
            raise TypeError(f"{self.adapter} is not a subclass of nros_conformance.rmw.Backend")
        return found

    def unavailable(self) -> Unavailable | None:
        """None when the adapter can be imported here."""
        assert self.declaration is not None
        subject = self.declaration.subject
        try:
            self.load()
        except ImportError as error:
            return Unavailable(str(error), subject.install)
        return None


def find_backends() -> dict[str, Found]:
    """All installed backends by name, in order of name. Empty when nothing is installed at all."""
    entries = importlib.metadata.entry_points(group=GROUP)
    return {entry.name: _found(entry.name, entry.value) for entry in sorted(entries, key=lambda entry: entry.name)}


def find_backend(name: str) -> Found:
    """An installed backend, or ``module:Class``. Raises `BackendNotFound`."""
    if ":" in name:
        return _found("", name)
    backends = find_backends()
    if name in backends:
        return backends[name]
    if not backends:
        raise BackendNotFound(
            f"no backend {name!r}: none is installed; run: pip install -e . (entry points exist only once installed)"
        )
    hint = nearest(name, list(backends)) if backends else ""
    raise BackendNotFound(f"no backend {name!r}; {hint.replace('valid are', 'installed are')}")


def _found(name: str, adapter: str) -> Found:
    module = adapter.partition(":")[0]
    try:
        spec = importlib.util.find_spec(module)
    except ImportError:
        spec = None
    if spec is None or spec.origin is None:
        return Found(name or adapter, adapter, error=FormatError(adapter, None, f"there is no module {module!r}"))
    file = Path(spec.origin).parent / "backend.toml"
    if not file.is_file():
        return Found(
            name or adapter,
            adapter,
            error=FormatError(file, None, "there is no declaration", "write one; docs/backend-toml.md"),
        )
    try:
        declaration = load_declaration(file)
    except FormatError as error:
        return Found(name or adapter, adapter, error=error, origin=str(file))
    return Found(name or declaration.name, adapter, declaration, origin=str(file))
