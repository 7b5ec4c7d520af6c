"""A router process: ``python -m nros_backends.zenoh.router ENDPOINT LEASE_MS``.

There is no router on PyPI, but a session in router mode is one. It says so when it listens, and ends
in an orderly way on SIGTERM, or when its standard input ends because whoever started it has died.
"""

from __future__ import annotations

import signal
import sys

from nros_backends.zenoh.config import open_session


def main() -> None:
    """Run until told to end."""
    endpoint, lease_ms = sys.argv[1], int(sys.argv[2])
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started it decides
    signal.signal(signal.SIGTERM, _end)
    session = open_session("router", listen=[endpoint], lease_ms=lease_ms)
    try:
        sys.stdout.write("listening\n")
        sys.stdout.flush()
        while sys.stdin.buffer.read(1):
            pass
    except SystemExit:
        pass
    session.close()


def _end(*_: object) -> None:
    raise SystemExit


if __name__ == "__main__":
    main()
