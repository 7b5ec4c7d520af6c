from __future__ import annotations

import ctypes
import sys

import pytest

from nros_conformance.play.process import QUANTITIES


@pytest.mark.skipif(sys.platform != "linux", reason="malloc_trim of glibc")
def test_what_the_allocator_keeps_for_later_is_not_in_use() -> None:
    libc = ctypes.CDLL(None)
    libc.malloc.restype = ctypes.c_void_p
    blocks = []
    before = QUANTITIES["memory"]()
    for _ in range(400):
        blocks.append(ctypes.c_void_p(libc.malloc(64_000)))
        libc.memset(blocks[-1], 1, 64_000)
    last = blocks.pop()  # what is below it cannot be given back by itself
    used = QUANTITIES["memory"]()
    for block in blocks:
        libc.free(block)
    after = QUANTITIES["memory"]()
    libc.free(last)
    assert used - before > 20_000_000
    assert after - before < 5_000_000
