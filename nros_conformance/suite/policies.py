"""The policies that a QoS asks for, by the names under which a declaration calls them unsupported.

``lifespan``, ``deadline``, ``lease``: a finite one. ``durability.transient_local``, ``history.keep_all``,
``liveliness.manual_by_node``...: that value. ``depth.above_128``: a larger depth.
"""

from __future__ import annotations

from collections.abc import Iterable

from nros_conformance.formats.durations import Duration
from nros_conformance.suite.schema import Qos


def unsupported(qos: Qos, declared: Iterable[str]) -> list[str]:
    """Which policies of the list ``[qos] unsupported`` of a declaration a QoS asks for."""
    return [policy for policy in declared if _asks_for(qos, policy)]


def _asks_for(qos: Qos, policy: str) -> bool:
    name, _, which = policy.partition(".")
    value = getattr(qos, name, None)
    if value is None or (isinstance(value, Duration) and not value.terms):  # 0 and infinite ask for nothing
        return False
    if which.startswith("above_"):
        return isinstance(value, int) and value > int(which.removeprefix("above_"))
    return which in ("", value)
