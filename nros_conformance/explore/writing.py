"""What was found, as a suite file that is ready to be played."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import msgspec

from nros_conformance.explore.explore import Deviation

_PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9_.-]*( [-+] [0-9.]+T)?|[0-9.]+(T|ms)")


def as_suite(found: Sequence[Deviation]) -> str:
    """A suite with one scenario for each."""
    lines = ["suite: explored", "title: What exploring has found", "scenarios:"]
    for one in found:
        raw = one.scenario
        lines += [
            f"  - id: {raw['id']}", f"    title: {raw['title']}", f"    scale: {_flow(raw['scale'])}",
            f"    sessions: {_flow(raw['sessions'])}", "    entities:",
        ]  # fmt: skip
        lines += [f"      {name}: {_flow(entity)}" for name, entity in raw["entities"].items()]
        for part in ("script", "expect"):
            lines += [f"    {part}:", *(f"      - {_flow(step)}" for step in raw[part])]
    return "\n".join(lines) + "\n"


def _flow(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    if isinstance(value, str) and _PLAIN.fullmatch(value):
        return value
    return msgspec.json.encode(value).decode()
