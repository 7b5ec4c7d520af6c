"""The class behind the name of an adapter."""

from __future__ import annotations

import importlib

from nros_conformance.rmw.backend import Backend


def load_adapter(name: str) -> type[Backend]:
    """The adapter class of ``module:Class``."""
    module, _, attribute = name.partition(":")
    found: type[Backend] = getattr(importlib.import_module(module), attribute)
    return found
