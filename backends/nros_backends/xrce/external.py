"""The agent in a process of its own: ``python -m nros_backends.xrce.external PORT``.

It says ``listening on HOST:PORT``, then answers every line on standard input with one of JSON about
itself. It ends when standard input does: with the process that started it at the latest.
"""

from __future__ import annotations

import json
import sys

from nros_backends.xrce.agent.core import EntityInfo
from nros_backends.xrce.agent.server import AgentServer
from nros_backends.xrce.wire.ids import Kind

LOOPBACK = "127.0.0.1"
SAYS = "listening on "
ASK = b"?\n"

_GET_INFO, _GET_INFO_AT, _AGENT, _CLIENT, _OBJECT_AT = 2, 4, b"\xff\xfd", b"\xff\xfe", 10
"""Where a ping shows itself in a message without client key: submessage id, and whom it asks."""


class Pings:
    """Counts the pings that an agent has seen: ``checks`` of its own, ``probes`` of clients."""

    def __init__(self) -> None:
        self.counts = {"checks": 0, "probes": 0}

    def watch(self, direction: str, _address: tuple[str, int], payload: bytes) -> None:
        """For `AgentServer`; told of every datagram."""
        if payload[_GET_INFO_AT : _GET_INFO_AT + 1] == bytes([_GET_INFO]):
            asked = payload[_OBJECT_AT : _OBJECT_AT + 2]
            self.counts["probes"] += direction == "in" and asked == _AGENT
            self.counts["checks"] += direction == "out" and asked == _CLIENT


def endpoints(graph: tuple[EntityInfo, ...]) -> list[tuple[str, str]]:
    """Kind and DDS topic of every data writer and reader."""
    return [
        (one.id.kind.name, one.topic.name)
        for one in graph
        if one.id.kind in (Kind.DATAWRITER, Kind.DATAREADER) and one.topic is not None
    ]


def main() -> int:
    """Serve; the exit code."""
    port, pings = int(sys.argv[1]), Pings()
    try:
        server = AgentServer(port, LOOPBACK, pings.watch)
    except OSError as error:
        _say(f"port {port}: {error.strerror or error}")
        return 1
    with server, open(0, "rb", closefd=False) as asked:
        _say(f"{SAYS}{server.address[0]}:{server.address[1]}")
        for _ in asked:
            _say(json.dumps({"entities": endpoints(server.entities()), "counts": pings.counts}))
    return 0


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
