"""A shared library written byte by byte: symbols that jump through a table, which ctypes fills.

A backend refers to the registry of the runtime (``nros_rmw_cffi_register_named`` ...), so those symbols
have to be in the process before it is loaded. Writing the library needs no compiler on the machine.
Layout: one page of headers, symbols and jumps; one of the dynamic section and the table.
"""

from __future__ import annotations

import platform
import struct
from collections.abc import Callable, Sequence

TABLE = "nros_conformance_registry"
"""The symbol of the table: one pointer for each function, in order."""

_ALIGN = 0x10000  # the largest page that a supported machine may have
_WRITABLE = 0x1000  # offset of the second part in the file
_HASH, _STRTAB, _SYMTAB, _STRSZ, _SYMENT, _SONAME = 4, 5, 6, 10, 11, 14
_LOAD, _DYNAMIC, _STACK = 1, 2, 0x6474E551
_FUNCTION, _OBJECT = 0x12, 0x11  # global, of either type


def _jump_x86_64(distance: int) -> bytes:
    return b"\xff\x25" + struct.pack("<i", distance - 6) + b"\xcc\xcc"  # jmp *[rip + d]


def _jump_aarch64(distance: int) -> bytes:
    load = 0x58000010 | (distance >> 2 & 0x7FFFF) << 5  # ldr x16, distance; br x16
    return struct.pack("<II", load, 0xD61F0200)


_MACHINES: dict[str, tuple[int, Callable[[int], bytes]]] = {
    "x86_64": (62, _jump_x86_64),
    "aarch64": (183, _jump_aarch64),
}
_JUMP = 8  # bytes of one


class UnknownMachine(Exception):
    """No jump is known for this processor. The text says so."""


def shared_library(functions: Sequence[str], machine: str = "") -> bytes:
    """An ELF image that exports ``functions`` and `TABLE`. Raises `UnknownMachine`."""
    machine = machine or platform.machine()
    if machine not in _MACHINES:
        raise UnknownMachine(f"compiled backends can be loaded on {' and '.join(_MACHINES)}; this is {machine}")
    number, jump = _MACHINES[machine]
    names = b"\0" + b"".join(name.encode() + b"\0" for name in (*functions, TABLE, "nros_registry.so"))
    symbols_at = 64 + 4 * 56
    hash_at = symbols_at + 24 * (len(functions) + 2)
    names_at = hash_at + 4 * (len(functions) + 5)
    code_at = (names_at + len(names) + 15) & ~15
    end = code_at + _JUMP * len(functions)
    dynamic_at = _ALIGN + _WRITABLE
    table_at = dynamic_at + 16 * 7

    symbols, code, name_at = bytes(24), b"", 1
    for index, name in enumerate(functions):
        here = code_at + _JUMP * index
        symbols += struct.pack("<IBBHQQ", name_at, _FUNCTION, 0, 1, here, _JUMP)
        code += jump(table_at + 8 * index - here)
        name_at += len(name) + 1
    symbols += struct.pack("<IBBHQQ", name_at, _OBJECT, 0, 1, table_at, 8 * len(functions))
    soname_at = name_at + len(TABLE) + 1
    count = len(functions) + 2  # with the null symbol in front; all others hang in one chain of one bucket
    chain = struct.pack(f"<{count + 3}I", 1, count, 1, 0, *range(2, count), 0)
    dynamic = struct.pack(
        "<14Q", _HASH, hash_at, _SYMTAB, symbols_at, _STRTAB, names_at, _STRSZ, len(names), _SYMENT, 24,
        _SONAME, soname_at, 0, 0,
    )  # fmt: skip
    table = bytes(8 * len(functions))
    head = b"\x7fELF\x02\x01\x01" + bytes(9)
    head += struct.pack("<HHIQQQIHHHHHH", 3, number, 1, 0, 64, 0, 0, 64, 56, 4, 64, 0, 0)
    size = len(dynamic) + len(table)
    for kind, flags, at, address, length in (
        (_LOAD, 5, 0, 0, end),
        (_LOAD, 6, _WRITABLE, dynamic_at, size),
        (_DYNAMIC, 6, _WRITABLE, dynamic_at, len(dynamic)),
        (_STACK, 6, 0, 0, 0),  # without it the stack would have to be executable
    ):
        head += struct.pack("<IIQQQQQQ", kind, flags, at, address, address, length, length, _ALIGN)
    first = head + symbols + chain + names
    first += bytes(code_at - len(first)) + code
    return first + bytes(_WRITABLE - len(first)) + dynamic + table
