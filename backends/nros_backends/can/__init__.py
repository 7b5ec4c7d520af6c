"""A CAN bus behind the contract: Cyphal/CAN v1 transfers on python-can.

python-can is imported with the class, not with this package, so that listing backends stays cheap.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from nros_backends.can.backend import CanBackend

__all__ = ["CanBackend"]


def __getattr__(name: str) -> type[CanBackend]:
    if name == "CanBackend":
        from nros_backends.can.backend import CanBackend

        return CanBackend
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
