from __future__ import annotations

import os
import socket
import struct
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.backends.zenoh.conftest import Stage

pytestmark = pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="only Linux tells the descriptors")


def lingering() -> Counter[int]:
    """How long the TCP sockets of this process linger, s; -1: not at all."""
    found: Counter[int] = Counter()
    for descriptor in list(Path("/proc/self/fd").iterdir()):
        try:
            copy = os.dup(int(descriptor.name))
        except OSError:  # the one of the listing
            continue
        try:
            one = socket.socket(fileno=copy)
        except OSError:
            os.close(copy)
            continue
        with one:
            if one.family == socket.AF_INET and one.type == socket.SOCK_STREAM:
                on, seconds = struct.unpack("ii", one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8))
                found[seconds if on else -1] += 1
    return found


def test_no_session_lingers_when_one_is_closed(make_stage: Callable[..., Stage]) -> None:
    stage = make_stage()
    one, _, other = stage.open(), stage.open(), stage.open()
    stage.match(stage.publisher(one), stage.subscription(other))
    before = lingering()
    assert before[10] >= 6, "zenoh has changed: it need not be kept from lingering any more"
    kept = socket.create_server(("127.0.0.1", 0))
    with kept, socket.create_connection(kept.getsockname()) as own:
        own.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 3))
        one.destroy()
        assert lingering()[3] == 1  # somebody else's
    assert lingering()[10] == 0
    stage.match(stage.publisher(stage.open()), stage.subscription(other))
