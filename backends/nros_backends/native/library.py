"""A compiled backend in this process: loaded, registered, its vtable checked before anything of it is called."""

from __future__ import annotations

import ctypes as ct
import functools
import importlib
import re
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from nros_backends.native.abi import MANDATORY, POINTER, PROTOTYPES, SLOTS, SPEAKS, VTABLE_SIZE
from nros_backends.native.callbacks import Callbacks
from nros_backends.native.elf import UnknownMachine
from nros_backends.native.options import Options
from nros_backends.native.registry import NAME_MAX, Registry
from nros_backends.native.storage import Strings, graveyard
from nros_backends.native.symbols import Mappings, loaded_at, symbol_at
from nros_conformance.rmw.loading import LibraryError

_LOADING = threading.Lock()
_UNDEFINED = re.compile(r"undefined symbol: (\S+)")


class Library:
    """The vtable of a backend: ``slots`` are callable, or None where the backend has none."""

    def __init__(self, options: Options) -> None:
        """Load it. Raises `LibraryError`."""
        self.options = options
        self.file = Path(options.library)
        registry = _registry()
        self._host_libraries = [_load(Path(file), "a host library") for file in options.host_libraries]
        before = dict(registry.vtables)
        self._handle = _load(self.file, "the library")
        self.registered_by, self.name, vtable = self._registered(registry, before)
        self.vtable = _checked(self.file, self.name, vtable)
        addresses = (ct.c_void_p * len(SLOTS)).from_address(vtable)
        self.null_slots = tuple(slot for slot, address in zip(SLOTS, addresses, strict=True) if not address)
        at = dict(zip(SLOTS, addresses, strict=True))
        self.slots: dict[str, Any] = {
            name: prototype(address) if (address := at[name]) else None for name, prototype in PROTOTYPES.items()
        }
        self.topic_hook = self._hook(options.topic_hook)
        self.strings = Strings()
        self.graveyard = graveyard()
        self.callbacks = Callbacks()

    def _registered(self, registry: Registry, before: dict[str, int]) -> tuple[str, str, int]:
        """How, under which name and where the vtable was registered."""
        name, how = self.options.name, "its constructor"
        if len(name.encode()) > NAME_MAX:
            raise LibraryError(f"--name {name}: longer than {NAME_MAX} bytes")
        fresh = {key: at for key, at in registry.vtables.items() if before.get(key) != at}
        if (name not in registry.vtables) if name else not fresh:
            function = f"nros_rmw_{name or self.file.stem.removeprefix('lib')}_register"
            register = getattr(self._handle, function, None)
            if register is not None:
                how = f"{function}()"
                register.argtypes, register.restype = [], ct.c_int32
                code = register()
                if code < 0:
                    raise LibraryError(f"{self.file.name}: {how} answered {code}", broken=True)
                fresh = {key: at for key, at in registry.vtables.items() if before.get(key) != at}
            elif (own := self._own_registry(name)) is not None:
                return "a registry of its own", name, own
            elif not fresh:
                raise LibraryError(
                    f"{self.file.name} is no nano-ros backend: loading it registered nothing, and it exports no "
                    f"{function}(); does a constructor call nros_rmw_cffi_register_named()?"
                )
        if name:
            if name not in registry.vtables:
                raise LibraryError(
                    f"{self.file.name} registered {_names(fresh)}, not {name!r}; say: --name {next(iter(fresh), name)}"
                )
            return how, name, registry.vtables[name]
        if len(fresh) > 1:
            raise LibraryError(f"{self.file.name} registered {_names(fresh)}; say which: --name NAME")
        (only,) = fresh or {"": 0}
        if not only:
            raise LibraryError(f"{self.file.name}: {how} registered nothing")
        return how, only, fresh[only]

    def _own_registry(self, name: str) -> int | None:
        """A backend whose language links the registry into it, as Rust does, is asked for its vtable."""
        lookup = getattr(self._handle, "nros_rmw_cffi_lookup", None)
        if lookup is None or not name:
            return None
        lookup.argtypes, lookup.restype = [ct.c_char_p], ct.c_void_p
        address: int | None = lookup(name.encode())
        return address

    def _hook(self, name: str) -> Callable[[bytes, bytes], int] | None:
        if not name:
            return None
        if ":" in name:
            module, _, attribute = name.partition(":")
            try:
                function = getattr(importlib.import_module(module), attribute)
            except (ImportError, AttributeError) as error:
                raise LibraryError(f"--topic-hook {name}: {error}") from error
            return lambda topic, type_name: int(function(topic.decode(), type_name.decode()) or 0)
        for library in (self._handle, *self._host_libraries):
            found = getattr(library, name, None)
            if found is not None:
                found.argtypes, found.restype = [ct.c_char_p, ct.c_char_p], ct.c_int32
                hook: Callable[[bytes, bytes], int] = found
                return hook
        raise LibraryError(f"--topic-hook {name}: no library exports it")


def load(options: Options) -> Library:
    """The library with these options: loaded once in a process, since nothing can be unloaded safely."""
    with _LOADING:  # sessions of several scenarios come here at once
        return _load_once(options)


@functools.cache
def _load_once(options: Options) -> Library:
    return Library(options)


@functools.cache
def _registry() -> Registry:
    try:
        return Registry()
    except UnknownMachine as error:
        raise LibraryError(str(error)) from error


def _load(file: Path, what: str) -> ct.CDLL:
    """Everything it refers to is resolved now, so that what is missing is known before it is called."""
    if not file.is_file():
        raise LibraryError(f"{what} {file} does not exist")
    try:
        return ct.CDLL(str(file.absolute()), mode=ct.RTLD_GLOBAL)
    except OSError as error:
        missing = _UNDEFINED.search(str(error))
        if missing is None:
            raise LibraryError(f"{what} {file.name} cannot be loaded: {error}") from error
        raise LibraryError(
            f"{what} {file.name} needs the symbol {missing[1]}, which nothing here provides; "
            "name the library that does: --host-lib FILE"
        ) from error


def _checked(file: Path, name: str, vtable: int) -> str:
    """What was checked of the layout, in words. Raises `LibraryError` for another one."""
    checked = "every slot leads to code"
    place = loaded_at(vtable)
    symbol = symbol_at(place[0], vtable - place[1]) if place is not None and place[0].is_file() else None
    if symbol is not None:
        if symbol[1] != VTABLE_SIZE:
            age = "an older" if symbol[1] < VTABLE_SIZE else "a newer"
            raise LibraryError(
                f"{file.name}: the vtable of {name!r} ({symbol[0]}) has {symbol[1] // POINTER} slots "
                f"({symbol[1]} bytes), {SPEAKS} has {len(SLOTS)} ({VTABLE_SIZE} bytes): it was compiled against "
                f"{age} layout; compile it against the headers of {SPEAKS}"
            )
        checked = f"the symbol {symbol[0]} has {VTABLE_SIZE} bytes, {checked}"
    mappings = Mappings()
    if not mappings.allows("r", vtable, VTABLE_SIZE):
        raise LibraryError(f"{file.name}: the vtable of {name!r} is not in readable memory")
    for slot, address in zip(SLOTS, (ct.c_void_p * len(SLOTS)).from_address(vtable), strict=True):
        if address and not mappings.allows("x", address):
            raise LibraryError(
                f"{file.name}: slot {SLOTS.index(slot)}, {slot}, of the vtable of {name!r} does not lead to code: it "
                f"was compiled against another layout than that of {SPEAKS}"
            )
        if not address and slot in MANDATORY:
            raise LibraryError(
                f"{file.name}: slot {SLOTS.index(slot)}, {slot}, of the vtable of {name!r} is NULL; it is mandatory"
            )
    return checked


def _names(vtables: dict[str, int]) -> str:
    return " and ".join(repr(name) for name in vtables) or "nothing"
