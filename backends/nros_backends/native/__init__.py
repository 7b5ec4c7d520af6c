"""Compiled backends: shared libraries that fill the nano-ros vtable, loaded and judged as they are."""

from nros_backends.native.backend import NativeBackend

__all__ = ["NativeBackend"]
