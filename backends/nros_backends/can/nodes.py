"""Node ids: at most one session on a bus has each, also with sessions in several processes."""

from __future__ import annotations

import os
import threading
from pathlib import Path

from filelock import FileLock, Timeout

from nros_conformance.rmw.codes import ReturnCode, RmwError

FIRST, LAST = 1, 125
"""126 and 127 are for diagnostic tools (Cyphal 1.0, 4.2.1); 0 is left out as well."""

_STRIDE = 31
"""Processes begin that far from each other, so that the id of one that died is not given out again soon."""


class NodeIds:
    """Leases ids within this process, and with ``scratch`` (a folder of the play) among several.

    ``first``: where to begin, on a bus whose other nodes are not this backend's.
    """

    def __init__(self, scratch: Path | None, first: int | None = None) -> None:
        self._scratch = scratch
        self._taken: dict[tuple[int, int], FileLock | None] = {}
        count = LAST - FIRST + 1
        self._next = 0 if scratch is None else os.getpid() * _STRIDE % count
        if first is not None:
            self._next = first - FIRST
        self._lock = threading.Lock()

    @staticmethod
    def first(text: str) -> int | None:
        """The option ``node``; None without it. Raises `RmwError` INVALID_CONFIG."""
        if not text:
            return None
        if not text.isdecimal() or not FIRST <= int(text) <= LAST:
            raise RmwError(ReturnCode.INVALID_CONFIG, f"node is {text!r}: give a node id, {FIRST} to {LAST}")
        return int(text)

    def lease(self, domain: int) -> int:
        """An id that nobody else has in this domain. Raises `RmwError` CONNECTION_FAILED when all are taken.

        Each id rests as long as possible before it is given out again.
        """
        count = LAST - FIRST + 1
        with self._lock:
            for step in range(count):
                node = FIRST + (self._next + step) % count
                if (domain, node) not in self._taken:
                    lock = self._claim(domain, node)
                    if lock is not None or self._scratch is None:
                        self._taken[domain, node] = lock
                        self._next = (self._next + step + 1) % count
                        return node
        raise RmwError(ReturnCode.CONNECTION_FAILED, f"all {count} node ids of the bus are taken")

    def release(self, domain: int, node: int) -> None:
        """Give an id back. A process that dies gives all of its own back."""
        with self._lock:
            lock = self._taken.pop((domain, node), None)
            if lock is not None:
                lock.release()

    def _claim(self, domain: int, node: int) -> FileLock | None:
        if self._scratch is None:
            return None
        self._scratch.mkdir(parents=True, exist_ok=True)
        lock = FileLock(self._scratch / f"can-{domain}-node-{node}.lock", thread_local=False)
        try:
            lock.acquire(blocking=False)
        except Timeout:
            return None
        return lock
