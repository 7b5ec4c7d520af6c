"""A UDP relay between one client and its agent that loses the datagrams that it is told to lose."""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
from collections.abc import Callable, Iterator

Lose = Callable[[bool, bytes], bool]
"""Whether a datagram is lost, by whether it goes to the agent, and its octets; asked once for each, in order."""


@contextlib.contextmanager
def lossy(agent: str, lose: Lose) -> Iterator[str]:
    """HOST:PORT for the one client that is led to the agent by it."""
    host, _, port = agent.rpartition(":")
    near = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    far = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    wake, woken = socket.socketpair()
    near.bind(("127.0.0.1", 0))
    far.connect((host, int(port)))

    def relay() -> None:
        client: tuple[str, int] | None = None
        with selectors.DefaultSelector() as selector:
            for one in (near, far, wake):
                selector.register(one, selectors.EVENT_READ)
            while True:
                for key, _ in selector.select():
                    if key.fileobj is wake:
                        return
                    if key.fileobj is near:
                        datagram, client = near.recvfrom(65_536)
                        if not lose(True, datagram):
                            far.send(datagram)
                    else:
                        datagram = far.recv(65_536)
                        if not lose(False, datagram) and client is not None:
                            near.sendto(datagram, client)

    thread = threading.Thread(target=relay, daemon=True)
    thread.start()
    try:
        yield f"127.0.0.1:{near.getsockname()[1]}"
    finally:
        woken.send(b"\0")
        thread.join()
        for one in (near, far, wake, woken):
            one.close()
