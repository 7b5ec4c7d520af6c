"""``nros-conformance xrce-agent``: the agent as a command, for any XRCE client."""

from __future__ import annotations

import argparse
import signal
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from nros_backends.xrce.agent.core import EntityInfo

HELP = "run an XRCE agent on UDP, for our clients or any other"
UNUSABLE = 4
"""Exit code where the command line asks for what cannot be had: that of the whole command."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("--port", type=int, default=8888, metavar="N", help="default: 8888; 0: any free port")
    parser.add_argument("--bind", default="127.0.0.1", metavar="ADDRESS", help="default: 127.0.0.1, this machine only")
    parser.add_argument("--list", action="store_true", help="print the entities of all clients whenever they change")
    parser.add_argument("-v", "--verbose", action="store_true", help="print every datagram")


def run(options: argparse.Namespace) -> int:
    """Serve until SIGINT or SIGTERM; the exit code."""
    from nros_backends.xrce.agent.server import AgentServer

    if not 0 <= options.port <= 65_535:
        return _fail(f"--port is {options.port}, a port is 0 to 65535")
    try:
        server = AgentServer(
            options.port, options.bind, _print_datagram if options.verbose else None,
            _print_graph if options.list else None,
        )  # fmt: skip
    except OSError as error:
        return _fail(f"cannot listen on {options.bind}:{options.port}: {error.strerror or error}")
    previous = {
        number: signal.signal(number, lambda _number, _frame: server.stop())
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        _print(f"listening on {server.address[0]}:{server.address[1]}")
        server.serve()
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
        server.close()
    return 0


def describe_datagram(direction: str, address: tuple[str, int], payload: bytes) -> str:
    """One line about a datagram: where from or to, session, stream and number, and what is in it."""
    from nros_backends.xrce.wire import Malformed, decode

    place = f"{'<-' if direction == 'in' else '->'} {address[0]}:{address[1]}"
    try:
        message = decode(payload)
    except Malformed as error:
        return f"{place} {error}"
    header = message.header
    names = ", ".join(type(submessage).__name__ for submessage in message.submessages)
    return f"{place} session 0x{header.session:02x} stream 0x{header.stream:02x} #{header.sequence}: {names}"


def describe_graph(graph: tuple[EntityInfo, ...]) -> list[str]:
    """One line per entity, by client."""
    lines = [f"{len(graph)} entities"]
    for entity in graph:
        line = f"  client {entity.client:08x} {entity.id} domain {entity.domain}"
        if entity.topic is not None:
            line += f" on {entity.topic.name} ({entity.topic.type}), {entity.matched} matched"
        lines.append(line)
    return lines


def _print_datagram(direction: str, address: tuple[str, int], payload: bytes) -> None:
    _print(describe_datagram(direction, address, payload))


def _print_graph(graph: tuple[EntityInfo, ...]) -> None:
    _print("\n".join(describe_graph(graph)))


def _print(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()  # whoever waits for the first line reads a pipe


def _fail(text: str) -> int:
    sys.stderr.write(f"nros-conformance xrce-agent: {text}\n")
    return UNUSABLE
