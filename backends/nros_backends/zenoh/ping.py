"""The round trip: a query to the router's admin space, which nobody but the router answers."""

from __future__ import annotations

import queue
import time
from typing import Any

import zenoh

from nros_backends.zenoh.config import open_session
from nros_backends.zenoh.linger import close
from nros_conformance.rmw.codes import ReturnCode, RmwError

_AGAIN_S = 0.005
"""Without a router nothing is sent; that soon to look for one again."""


def ping_router(session: zenoh.Session, timeout_ms: int, attempts: int) -> int:
    """OK when a router answered one of at most ``attempts`` probes, each in time; else TIMEOUT."""
    for _ in range(attempts):
        end = time.monotonic() + timeout_ms / 1000
        while True:
            left = end - time.monotonic()
            if _answered(session, max(left, 0.001)):
                return ReturnCode.OK
            if time.monotonic() + _AGAIN_S >= end:
                break
            time.sleep(_AGAIN_S)
    return ReturnCode.TIMEOUT


def ping_before_session(locator: str, timeout_ms: int, attempts: int) -> int:
    """The same with a transport that lives for this ping only."""
    for _ in range(attempts):
        end = time.monotonic() + timeout_ms / 1000
        try:
            session = open_session("client", connect=[locator], open_ms=timeout_ms)
        except RmwError:
            time.sleep(max(end - time.monotonic(), 0))
            continue
        try:
            if ping_router(session, max(int((end - time.monotonic()) * 1000), 0), 1) == ReturnCode.OK:
                return ReturnCode.OK
        finally:
            close(session)
    return ReturnCode.TIMEOUT


def _answered(session: zenoh.Session, timeout_s: float) -> bool:
    """One probe. Each has a queue of its own, so that what answers late answers nobody."""
    answers: queue.SimpleQueue[bool] = queue.SimpleQueue()
    handler: Any = zenoh.handlers.Callback(
        lambda reply: answers.put(reply.ok is not None), lambda: answers.put(False), indirect=False
    )
    try:
        session.get("@/*/router", handler, timeout=timeout_s)
        return answers.get(timeout=timeout_s)
    except (queue.Empty, zenoh.ZError):
        return False
