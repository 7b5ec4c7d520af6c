"""How the sessions of a scenario meet, and the wire between them.

Without a locator they are peers, each connected to all others directly. Who comes later connects to those that
are there; it finds their ports in memory, or in the folder of the play when sessions live in other processes.
With a locator they are clients of the router there.

Where faults are to be injected, every TCP connection passes a proxy of the process that opened it. What a session
sends, or is sent, can then be held up in all its proxies.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import threading
from collections.abc import Iterator
from pathlib import Path

import zenoh
from filelock import FileLock

from nros_backends.zenoh.config import free_port, open_session, tcp_address
from nros_backends.zenoh.linger import close
from nros_backends.zenoh.proxy import Flow, Loop, TcpProxy
from nros_conformance.rmw.codes import RmwError

_PORT_TRIES = 8


@dataclasses.dataclass(eq=False, slots=True)
class Link:
    """A connection through a proxy, opened by the transport ``near`` to the port ``far``, 0 when that is gone."""

    near: Joined
    far: int
    proxy: TcpProxy


@dataclasses.dataclass(eq=False, slots=True)
class Joined:
    """A transport in the network: one zenoh session. ``owner`` is the session of the contract that it serves."""

    session: zenoh.Session
    owner: object
    port: int
    """Where it listens; 0 for a client."""


class Network:
    """The transports of one backend."""

    def __init__(self, scratch: Path, *, processes: bool, proxies: bool) -> None:
        self._scratch = scratch
        self._processes = processes
        self._proxies = proxies
        self._lock = threading.Lock()
        self._loop: Loop | None = None
        self._joined: list[Joined] = []
        self._links: list[Link] = []

    def join(self, owner: object, locator: str, lease_ms: int) -> Joined:
        """A new transport for ``owner``. Raises `RmwError` CONNECTION_FAILED."""
        with self._lock:
            if locator:
                return self._client(owner, locator, lease_ms)
            if self._processes:
                self._scratch.mkdir(parents=True, exist_ok=True)
                with FileLock(self._scratch / "peers.lock"):
                    return self._peer(owner, lease_ms)
            return self._peer(owner, lease_ms)

    def leave(self, owner: object) -> None:
        """Close all transports of ``owner``, with their proxies."""
        with self._lock:
            leaving = [one for one in self._joined if one.owner is owner]
            self._joined = [one for one in self._joined if one.owner is not owner]
        for one in leaving:
            close(one.session)
            if one.port and self._processes:
                (self._scratch / f"peer-{one.port}").unlink(missing_ok=True)
        ports = {one.port for one in leaving if one.port}
        with self._lock:
            ended = [link for link in self._links if link.near in leaving]
            self._links = [link for link in self._links if link not in ended]
            for link in ended:
                link.proxy.close()
            for link in self._links:
                if link.far in ports:
                    # The other end tries again and again; its port must not come to belong to somebody else.
                    link.far = 0
                    link.proxy.retire()
            if self._loop is not None and not self._joined:
                self._loop.close()
                self._loop = None

    def flows(self, owner: object) -> Iterator[tuple[Flow, Flow]]:
        """For each connection of ``owner``: what it sends, and what it is sent."""
        for link in self._links_of(owner):
            proxy = link.proxy
            yield (proxy.out, proxy.back) if link.near.owner is owner else (proxy.back, proxy.out)

    def release(self, owner: object) -> None:
        """Let everything pass again."""
        for link in self._links_of(owner):
            link.proxy.release()

    def whole(self, owner: object) -> bool:
        """Whether all connections of ``owner`` pass proxies of this process."""
        if not self._proxies or not self._processes:
            return self._proxies
        links = self._links_of(owner)
        with self._lock:
            transports = [one for one in self._joined if one.owner is owner]
            others = set(self._peers()) - {one.port for one in transports}
            # A peer that came later has connected to this one directly.
            return bool(links) and all(
                others <= {link.far for link in links if link.near is one} for one in transports if one.port
            )

    def ports(self, owner: object) -> list[int]:
        """Where the transports of ``owner`` listen."""
        return [one.port for one in self._joined if one.owner is owner and one.port]

    def _links_of(self, owner: object) -> list[Link]:
        with self._lock:
            ports = {one.port for one in self._joined if one.owner is owner and one.port}
            return [link for link in self._links if link.near.owner is owner or link.far in ports]

    def _client(self, owner: object, locator: str, lease_ms: int) -> Joined:
        address = tcp_address(locator)
        proxy = self._proxy(address) if address is not None and self._proxies else None
        try:
            session = open_session(
                "client", connect=[locator if proxy is None else f"tcp/127.0.0.1:{proxy.port}"], lease_ms=lease_ms
            )
        except BaseException:
            self._undo([proxy] if proxy is not None else [])
            raise
        joined = Joined(session, owner, 0)
        if proxy is not None:
            self._links.append(Link(joined, 0, proxy))
        self._joined.append(joined)
        return joined

    def _peer(self, owner: object, lease_ms: int) -> Joined:
        peers = self._peers()
        proxies = {port: self._proxy(("127.0.0.1", port)) for port in peers} if self._proxies else {}
        try:
            session, port = _listening(
                [f"tcp/127.0.0.1:{proxies[port].port if port in proxies else port}" for port in peers], lease_ms
            )
        except BaseException:
            self._undo(list(proxies.values()))
            raise
        joined = Joined(session, owner, port)
        self._links += [Link(joined, port, proxy) for port, proxy in proxies.items()]
        self._joined.append(joined)
        if self._processes:
            (self._scratch / f"peer-{joined.port}").write_text(str(os.getpid()))
        return joined

    def _peers(self) -> list[int]:
        """The ports of all peers that live."""
        ports = [one.port for one in self._joined if one.port]
        if not self._processes:
            return ports
        for file in sorted(self._scratch.glob("peer-*")):
            if _lives(int(file.read_text())):
                ports.append(int(file.name.partition("-")[2]))
            else:
                file.unlink()
        return list(dict.fromkeys(ports))

    def _proxy(self, target: tuple[str, int]) -> TcpProxy:
        if self._loop is None:
            self._loop = Loop()
        return TcpProxy(self._loop, target)

    def _undo(self, proxies: list[TcpProxy]) -> None:
        for proxy in proxies:
            proxy.close()
        if self._loop is not None and not self._joined:
            self._loop.close()
            self._loop = None


def _listening(connect: list[str], lease_ms: int) -> tuple[zenoh.Session, int]:
    """A peer on a port of its own. zenoh can choose one too, but tells only by the admin space."""
    for _ in range(_PORT_TRIES - 1):
        port = free_port()
        with contextlib.suppress(RmwError):  # somebody else was faster
            return open_session("peer", listen=[f"tcp/127.0.0.1:{port}"], connect=connect, lease_ms=lease_ms), port
    port = free_port()
    return open_session("peer", listen=[f"tcp/127.0.0.1:{port}"], connect=connect, lease_ms=lease_ms), port


def _lives(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
