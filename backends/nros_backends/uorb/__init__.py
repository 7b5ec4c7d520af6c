"""PX4's message bus, uORB, as a model behind the contract."""

from nros_backends.uorb.backend import UorbBackend

__all__ = ["UorbBackend"]
