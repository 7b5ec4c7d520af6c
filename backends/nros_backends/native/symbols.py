"""What the file and the mappings of a loaded library tell: symbols, their sizes, what is executable."""

from __future__ import annotations

import ctypes as ct
import struct
from pathlib import Path

_SYMTAB, _DYNSYM = 2, 11


class _DlInfo(ct.Structure):
    _fields_ = (
        ("file_name", ct.c_char_p),
        ("base", ct.c_void_p),
        ("symbol_name", ct.c_char_p),
        ("symbol", ct.c_void_p),
    )


def loaded_at(address: int) -> tuple[Path, int] | None:
    """The file that is mapped at this address, and where it begins; None when it is no library."""
    info = _DlInfo()
    dladdr = ct.CDLL(None).dladdr
    dladdr.argtypes = [ct.c_void_p, ct.POINTER(_DlInfo)]
    if not dladdr(address, ct.byref(info)) or info.base is None:
        return None
    return Path((info.file_name or b"").decode(errors="surrogateescape")), int(info.base)


def symbol_at(file: Path, value: int) -> tuple[str, int] | None:
    """Name and size of the symbol with this value (an address less where the file is loaded).

    None when the file has none, because it is stripped, or is no 64 bit ELF file.
    """
    data = file.read_bytes()
    if data[:5] != b"\x7fELF\x02":
        return None
    (sections_at,) = struct.unpack_from("<Q", data, 0x28)
    size, count = struct.unpack_from("<HH", data, 0x3A)
    sections = [struct.unpack_from("<IIQQQQIIQQ", data, sections_at + size * index) for index in range(count)]
    for kind in (_SYMTAB, _DYNSYM):
        for section in (one for one in sections if one[1] == kind):
            names_at = sections[section[6]][4]
            for at in range(section[4], section[4] + section[5], 24):
                name, _info, _other, _section, begin, length = struct.unpack_from("<IBBHQQ", data, at)
                if begin == value and length:
                    end = data.index(b"\0", names_at + name)
                    return data[names_at + name : end].decode(errors="replace"), length
    return None


class Mappings:
    """What of this process' memory may be read and executed, as it was when this was made."""

    def __init__(self) -> None:
        self._spans: list[tuple[int, int, str]] = []
        for line in Path("/proc/self/maps").read_text(errors="replace").splitlines():
            span, rights, *_ = line.split()
            begin, _, end = span.partition("-")
            self._spans.append((int(begin, 16), int(end, 16), rights))

    def allows(self, right: str, address: int, size: int = 1) -> bool:
        """Whether all of it has the right ``r``, ``w`` or ``x``."""
        at = address
        for begin, end, rights in self._spans:
            if begin <= at < end:
                if right not in rights:
                    return False
                at = end
                if at >= address + size:
                    return True
        return False
