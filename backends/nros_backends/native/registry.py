"""The registry that the runtime would provide: backends register their vtables here as they are loaded."""

from __future__ import annotations

import ctypes as ct
import os
from typing import Any

from nros_backends.native.elf import TABLE, shared_library
from nros_conformance.rmw.codes import ReturnCode

NAME_MAX = 31
"""Bytes of a name, without the NUL."""

_REGISTER = ct.CFUNCTYPE(ct.c_int32, ct.c_void_p)
_REGISTER_NAMED = ct.CFUNCTYPE(ct.c_int32, ct.c_char_p, ct.c_void_p)
_LOOKUP = ct.CFUNCTYPE(ct.c_void_p, ct.c_char_p)
_NAMES = ct.CFUNCTYPE(ct.c_size_t, ct.POINTER(ct.c_char_p), ct.c_size_t)


class Registry:
    """Vtables by name. Once in a process, for as long as it lives: what it exports cannot be taken back."""

    def __init__(self) -> None:
        self.vtables: dict[str, int] = {}
        """Addresses, by name, in the order of their first registration."""
        self._names: list[bytes] = []
        functions: dict[str, Any] = {
            "nros_rmw_cffi_register_named": _REGISTER_NAMED(self._register_named),
            "nros_rmw_cffi_register": _REGISTER(lambda vtable: self._register_named(b"default", vtable)),
            "nros_rmw_cffi_lookup": _LOOKUP(self._lookup),
            "nros_rmw_cffi_registered_names": _NAMES(self._registered_names),
        }
        # Of this process by number and open for ever: a debugger opens the name too, in a process of its own.
        image = os.memfd_create("nros_registry", os.MFD_CLOEXEC)
        os.write(image, shared_library(tuple(functions)))
        self._library = ct.CDLL(f"/proc/{os.getpid()}/fd/{image}", mode=ct.RTLD_GLOBAL)
        table = (ct.c_void_p * len(functions)).in_dll(self._library, TABLE)
        for index, function in enumerate(functions.values()):
            table[index] = ct.cast(function, ct.c_void_p).value
        self._functions = functions  # called from C: they have to stay

    def _register_named(self, name: bytes | None, vtable: int | None) -> int:
        if not name or len(name) > NAME_MAX or not vtable:
            return int(ReturnCode.INVALID_ARGUMENT)
        if name not in self._names:
            self._names.append(name)
        self.vtables[name.decode(errors="replace")] = vtable
        return int(ReturnCode.OK)

    def _lookup(self, name: bytes | None) -> int | None:
        return self.vtables.get((name or b"").decode(errors="replace"))

    def _registered_names(self, buffer: Any, capacity: int) -> int:
        for index, name in enumerate(self._names[:capacity] if buffer else ()):
            buffer[index] = name  # the bytes live as long as the registry
        return len(self._names)
