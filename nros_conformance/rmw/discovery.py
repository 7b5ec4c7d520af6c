"""Finding backends: entry points of the group ``nros_conformance.backends``, or ``module:Class``.

An entry point names an adapter class; its ``backend.toml`` stands beside the class's module, so that
listing backends imports no middleware.
"""

from __future__ import annotations

import dataclasses
import importlib
import importlib.metadata
import importlib.util
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import cast

from nros_conformance.formats.places import FormatError, nearest
from nros_conformance.rmw.backend import Backend, Host
from nros_conformance.rmw.codes import RmwError
from nros_conformance.rmw.declaration import NOTHING_TO_INSTALL, Declaration, load_declaration

GROUP = "nros_conformance.backends"
_BASE = "nros_conformance.rmw.backend.Backend"


class BackendNotFound(Exception):
    """No backend of that name. The text says which there are."""


@dataclasses.dataclass(frozen=True, slots=True)
class Unavailable:
    """Why a backend cannot run here, and the command that mends it."""

    reason: str
    install: str

    def __str__(self) -> str:
        if self.install == NOTHING_TO_INSTALL:
            return f"{self.reason}; install it, and name the command in backend.toml: [subject] install"
        return f"{self.reason}; install it: {self.install}"


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
        """Import the adapter class.

        Raises ImportError when its middleware is missing, `FormatError` when the adapter itself is broken.
        """
        name, _, attribute = self.adapter.partition(":")
        try:
            module = importlib.import_module(name)
        except ImportError:
            raise
        except Exception as error:  # an adapter may fail as it likes
            raise _broken(self.adapter, "importing it", error) from error
        place = getattr(module, "__file__", None) or name
        found = getattr(module, attribute, None)
        if found is None:
            classes = [one for one, value in vars(module).items() if _adapter(value)]
            raise FormatError(place, None, f"there is no class {attribute!r}", nearest(attribute, classes))
        if not _adapter(found):
            raise FormatError(place, None, f"{attribute} is no adapter", f"derive it from {_BASE}")
        return cast("type[Backend]", found)

    def versions(self, host: Host) -> Mapping[str, str]:
        """What a fresh adapter says was tested. Raises ImportError and `FormatError` as `load`, `RmwError` as it is."""
        return self._ask(host, lambda backend: backend.versions())

    def lacking(self, host: Host) -> Mapping[str, str]:
        """The faults that a fresh adapter cannot inject with its options, and why. Raises as `versions`."""
        return self._ask(host, lambda backend: backend.lacking())

    def _ask(self, host: Host, question: Callable[[Backend], Mapping[str, str]]) -> Mapping[str, str]:
        adapter = self.load()
        try:
            return question(adapter(host))
        except RmwError:
            raise
        except Exception as error:
            raise _broken(self.adapter, "creating it", error) from error

    def unavailable(self) -> Unavailable | None:
        """None when the adapter can be imported here. Raises `FormatError` when it is broken."""
        assert self.declaration is not None
        subject = self.declaration.subject
        try:
            self.load()
        except ImportError as error:
            return Unavailable(str(error), subject.install)
        return None


def _adapter(value: object) -> bool:
    return isinstance(value, type) and issubclass(value, Backend) and value is not Backend


def _broken(adapter: str, what: str, error: Exception) -> FormatError:
    """Where an adapter raised: the file and line that have to be mended."""
    said = f"{type(error).__name__}: {error}"
    if isinstance(error, SyntaxError):
        return FormatError(error.filename or adapter, error.lineno, f"SyntaxError: {error.msg}")
    frame = traceback.extract_tb(error.__traceback__)[-1]
    inside = frame.filename != __file__
    place, line = (frame.filename, frame.lineno) if inside else (adapter, None)
    return FormatError(place, line, f"{what} raised {said}")


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
