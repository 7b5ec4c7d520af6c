"""The agent's command in a process of its own, which ends with the process that started it.

``python -m nros_backends.xrce.external --port N``: what ``nros-conformance xrce-agent`` runs. When
standard input is closed, because the parent has gone, it is gone too.
"""

from __future__ import annotations

import argparse
import os
import sys
import threading

from nros_backends.xrce.agent import command


def main() -> int:
    """Serve until told to stop; the exit code."""
    parser = argparse.ArgumentParser(prog="xrce-agent")
    command.add_arguments(parser)
    threading.Thread(target=_leave_with_parent, name="parent", daemon=True).start()
    return command.run(parser.parse_args())


def _leave_with_parent() -> None:
    sys.stdin.buffer.read()
    os._exit(0)


if __name__ == "__main__":
    sys.exit(main())
