"""Eclipse Cyclone DDS behind the contract.

The middleware is imported with the class, not with this package, so that listing backends stays cheap.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from nros_backends.cyclone.backend import CycloneBackend

__all__ = ["CycloneBackend"]


def __getattr__(name: str) -> type[CycloneBackend]:
    if name == "CycloneBackend":
        from nros_backends.cyclone.backend import CycloneBackend

        return CycloneBackend
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
