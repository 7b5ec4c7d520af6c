"""DDS-XRCE: an agent and a client of this project over UDP, held to recordings of eProsima's.

The adapter is imported when it is asked for, so that an agent in a process of its own starts fast.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from nros_backends.xrce.backend import XrceBackend

__all__ = ["XrceBackend"]


def __getattr__(name: str) -> object:
    if name != "XrceBackend":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from nros_backends.xrce.backend import XrceBackend

    return XrceBackend
