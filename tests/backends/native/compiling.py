"""What the tests of compiled backends compile, and what they skip without."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import pytest

from nros_conformance.judge.results import Verdict

EXAMPLE = Path(__file__).parents[3] / "examples" / "native_backend"
HEADERS = EXAMPLE / "include"
LIBRARIES = Path(__file__).parent / "libraries"
FLAGS = ("-std=c11", "-g", "-fPIC", "-shared", "-pthread", f"-I{HEADERS}")

Build: TypeAlias = Callable[..., Path]
Play: TypeAlias = Callable[..., dict[str, Verdict]]


def needs(*commands: str) -> pytest.MarkDecorator:
    """Skip where one of these is not installed."""
    missing = [command for command in commands if shutil.which(command) is None]
    return pytest.mark.skipif(bool(missing), reason=f"needs {' and '.join(missing)}")
