"""DDS-XRCE: an agent and a client of this project over UDP, held to recordings of eProsima's."""

from nros_backends.xrce.backend import XrceBackend

__all__ = ["XrceBackend"]
