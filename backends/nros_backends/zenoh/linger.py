"""Closing a zenoh session without holding up the others of the process.

zenoh 1.10.2 has its TCP sockets linger for 10 s, so closing one waits until the other end has acknowledged the last
bytes, which a kernel may put off for 40 ms. It does so on the threads that serve all sessions of the process: none of
them receives anything meanwhile, for 90 ms in a row when sessions come and go. Known as eclipse-zenoh/zenoh#2350.
"""

from __future__ import annotations

import contextlib
import os
import socket
import struct

import zenoh

_LINGER = struct.Struct("ii")
_ZENOHS = _LINGER.pack(1, 10)
_NONE = _LINGER.pack(0, 0)

_DESCRIPTORS = "/proc/self/fd"
"""Linux; elsewhere the sockets linger."""


def close(session: zenoh.Session) -> None:
    """Close it. The kernel still sends what is on its way."""
    _let_go()
    session.close()


def _let_go() -> None:
    """No TCP socket of zenoh lingers any more, neither end of a connection within this process."""
    with contextlib.suppress(OSError):
        for descriptor in os.listdir(_DESCRIPTORS):  # noqa: PTH208 - names are all that is wanted
            with contextlib.suppress(OSError):  # it is no socket, or closed by now
                _unlinger(int(descriptor))


def _unlinger(descriptor: int) -> None:
    one = socket.socket(fileno=descriptor)
    try:
        if one.type == socket.SOCK_STREAM and one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8) == _ZENOHS:
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _NONE)
    finally:
        one.detach()  # it is not ours to close
