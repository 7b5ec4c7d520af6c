from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from nros_conformance.formats.places import FormatError
from nros_conformance.suite.loader import Loaded, Suites, load_suites

CATALOGUE = """\
version: "1.0"
sources: {EH: nros/rmw_event.h}
groups: {RDM: Requested deadline missed, LVC: Liveliness changed}
requirements:
  - {id: RDM-001, level: must, statement: A miss is reported., source: EH}
  - {id: RDM-002, level: should, statement: No false miss is reported., source: EH}
  - {id: LVC-001, level: must, statement: A publisher is counted., source: EH}
"""

HEAD = """\
suite: sample
title: A sample
scenarios:
"""

Load = Callable[..., Suites]


@pytest.fixture
def load(tmp_path: Path) -> Load:
    """Loads a directory that holds a small catalogue and these files: ``load(a=..., b=...)``."""

    def write_and_load(**files: str) -> Suites:
        directory = tmp_path / "suites"
        directory.mkdir(exist_ok=True)
        (directory / "requirements.yaml").write_text(CATALOGUE, encoding="utf-8")
        for name, text in files.items():
            (directory / f"{name}.yaml").write_text(text, encoding="utf-8")
        return load_suites(directory)

    return write_and_load


@pytest.fixture
def scenarios(load: Load) -> Callable[[str], tuple[Loaded, ...]]:
    """Loads one suite with these scenarios, which begin in line 4."""
    return lambda text: load(sample=HEAD + text).scenarios


@pytest.fixture
def message(load: Load) -> Callable[[str], str]:
    """The text of the error that these scenarios, which begin in line 4, lead to."""

    def failing(text: str) -> str:
        with pytest.raises(FormatError) as caught:
            load(sample=HEAD + text)
        return str(caught.value)

    return failing
