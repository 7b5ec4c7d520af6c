"""zenoh's configuration, and how its sessions are opened."""

from __future__ import annotations

import contextlib
import json
import socket
from collections.abc import Iterable
from typing import Any, Literal

import zenoh

from nros_conformance.rmw.codes import ReturnCode, RmwError

LEASE_MS = 500
"""Default lease of a transport; zenoh's own is 10 s."""

RETRY_MS = 50
"""How soon a session tries again to connect; zenoh's own is 1 s, growing to 4 s."""

HANDSHAKE_MS = 2_000
"""How long a transport may take to open; zenoh's own is 10 s, but creating a client and closing a peer wait for it.

zenoh 1.10.2 drops a handshake whose time is over wherever it stands. Between its last message and the reader's start
that leaves a transport which sends and never reads: neither side ever ends it, and every later attempt is turned
away. So this must be longer than a busy host, or a process that is frozen for a lease or two, needs.
"""

_KEEP_ALIVES = 8
"""Signs of life per lease; zenoh's default is 4. A busy host may delay one by the rest of the lease."""

_WAIT_BEFORE_DROP_US = 50_000
"""How long a best-effort sample waits for room in zenoh's queue of two batches before it is dropped."""

Mode = Literal["peer", "client", "router"]


def open_session(
    mode: Mode,
    *,
    listen: Iterable[str] = (),
    connect: Iterable[str] = (),
    lease_ms: int = LEASE_MS,
    open_ms: int = HANDSHAKE_MS,
) -> zenoh.Session:
    """A session without scouting, on exactly these endpoints, with at most ``open_ms`` for each handshake.

    Raises `RmwError` CONNECTION_FAILED when a client finds no router, or a port is taken.
    """
    patience_ms = max(open_ms, 1)
    settings: dict[str, Any] = {
        "mode": mode,
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        "connect/retry": {
            "period_init_ms": RETRY_MS,
            "period_max_ms": RETRY_MS,
            "period_increase_factor": 1,
        },
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        # It answers pings; 1.10.2 forgets 18 kB with each session that has it.
        "adminspace/enabled": mode == "router",
        "transport/unicast/open_timeout": patience_ms,
        "transport/unicast/accept_timeout": patience_ms,
        "transport/link/tx/lease": lease_ms,
        "transport/link/tx/keep_alive": _KEEP_ALIVES,
        # What blocks a reliable publication for longer than the lease is a dead peer.
        "transport/link/tx/queue/congestion_control/block/wait_before_close": lease_ms * 1000,
        # The default of 1 ms is shorter than a busy host takes to run zenoh's own sender.
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": _WAIT_BEFORE_DROP_US,
        "transport/shared_memory/enabled": False,
    }
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise RmwError(ReturnCode.CONNECTION_FAILED, str(error).partition(" at ")[0]) from error


def free_port() -> int:
    """A port of loopback that nobody has now; somebody else may take it before it is used."""
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as probe:
        return int(probe.getsockname()[1])


def tcp_address(locator: str) -> tuple[str, int] | None:
    """Host and port of ``tcp/HOST:PORT``; None for another protocol.

    >>> tcp_address("tcp/127.0.0.1:7447"), tcp_address("unixsock-stream/tmp/z")
    (('127.0.0.1', 7447), None)
    """
    protocol, _, address = locator.partition("/")
    host, _, port = address.partition("?")[0].partition("#")[0].rpartition(":")
    return (host.strip("[]"), int(port)) if protocol == "tcp" and port.isdigit() else None
