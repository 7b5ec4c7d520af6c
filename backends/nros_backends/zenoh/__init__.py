"""zenoh behind the contract.

The middleware is imported with the class, not with this package, so that listing backends stays cheap.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from nros_backends.zenoh.backend import ZenohBackend

__all__ = ["ZenohBackend"]


def __getattr__(name: str) -> type[ZenohBackend]:
    if name == "ZenohBackend":
        from nros_backends.zenoh.backend import ZenohBackend

        return ZenohBackend
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
