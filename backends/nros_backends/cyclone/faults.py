"""Faults: a session's DDS domain is made deaf, mute or both (``dds_domain_set_deafmute``).

What is sent while mute is gone; a reliable writer sends it again afterwards as long as its history
holds it, so that only best-effort samples are lost for certain.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from nros_backends.cyclone.publisher import CyclonePublisher
from nros_backends.cyclone.session import CycloneSession
from nros_conformance.rmw.codes import ReturnCode


def inject(fault: str, arguments: Mapping[str, Any]) -> int:
    """`Backend.inject`: ``lose``, ``partition``, ``block`` and ``heal``."""
    match fault, arguments:
        case "lose", {"entity": CyclonePublisher() as publisher, "count": int(count), "publish": publish}:
            return _lose(publisher, count, publish)
        case "partition", {"session": CycloneSession() as session}:
            return session.deafmute(deaf=True, mute=True)
        case "block", {"session": CycloneSession() as session, "direction": str(direction)}:
            return session.deafmute(deaf=direction == "in", mute=direction == "out")
        case "heal", {"session": CycloneSession() as session}:
            return session.deafmute(deaf=False, mute=False)
    return ReturnCode.UNSUPPORTED


def _lose(publisher: CyclonePublisher, count: int, publish: Callable[[], int]) -> int:
    code = publisher.session.deafmute(deaf=False, mute=True)
    if code != ReturnCode.OK:
        return code
    try:
        return min(publish() for _ in range(count))
    finally:
        publisher.session.deafmute(deaf=False, mute=False)
