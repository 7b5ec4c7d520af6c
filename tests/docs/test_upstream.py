"""The reproductions for maintainers of middleware print what their pages say."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path

import pytest

from nros_conformance.rmw.declaration import load_declaration

UPSTREAM = Path(__file__).parents[2] / "docs" / "upstream"
DECLARATION = Path(__file__).parents[2] / "backends" / "nros_backends" / "cyclone" / "backend.toml"
PAGES = sorted(UPSTREAM.glob("*.md"))
MODULES = {"cyclonedds": "cyclone", "zenoh": "zenoh"}
"""What a page of that name needs, and the extra that brings it."""


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


def reproduce(page: Path) -> tuple[str, str]:
    """What its script prints, and what the page says. They sleep, and a busy host oversleeps: tried three times."""
    (script,), (observed,) = blocks(page, "python"), blocks(page, "text")
    # A domain of this test's own: the ports of others on this host may be those of the page's.
    domain = 10 + os.getpid() % 20 * 3 + PAGES.index(page)
    script = re.sub(r"<ExternalDomainId>\d+", f"<ExternalDomainId>{domain}", script)
    for _ in range(3):
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120, check=False)
        if done.stdout == observed:
            break
    assert done.returncode == 0, done.stderr
    return done.stdout, observed


@pytest.fixture(scope="module")
def printed() -> Iterator[dict[str, Future[tuple[str, str]]]]:
    with ThreadPoolExecutor() as pool:
        yield {page.stem: pool.submit(reproduce, page) for page in PAGES if find_spec(page.stem.partition("-")[0])}


@pytest.mark.parametrize("page", [page.stem for page in PAGES])
def test_a_reproduction_prints_what_its_page_says(printed: dict[str, Future[tuple[str, str]]], page: str) -> None:
    module = page.partition("-")[0]
    pytest.importorskip(module, reason=f"the extra nros-conformance[{MODULES[module]}] is not installed")
    got, observed = printed[page].result()
    assert got == observed


def test_every_unreported_deviation_of_cyclone_has_a_page() -> None:
    keys = {known.key for known in load_declaration(DECLARATION).known if known.link == "unreported"}
    texts = [page.read_text(encoding="utf-8") for page in PAGES]
    assert keys == {key for text in texts for key in re.findall(r"`(C\d)` in", text)}
    assert not [text for text in texts if "nros" in "".join(re.findall(r"```python\n(.*?)```", text, re.DOTALL))]
