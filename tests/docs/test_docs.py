from __future__ import annotations

import re
from pathlib import Path

import pytest

from nros_conformance.report.handbook import COMMAND, pages

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("file", sorted(pages(ROOT / "docs")), ids=lambda file: file.name)
def test_a_generated_page_is_what_would_be_generated(file: Path) -> None:
    assert file.read_text(encoding="utf-8") == pages(ROOT / "docs")[file], f"write it again: {COMMAND}"


@pytest.mark.parametrize("file", sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")]), ids=lambda file: file.name)
def test_every_link_within_the_repository_leads_somewhere(file: Path) -> None:
    text = re.sub(r"`[^`]*`", "", file.read_text(encoding="utf-8"))
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text):
        if "://" not in target:
            assert (file.parent / target).exists(), target


def test_ci_runs_the_very_test_command_of_the_readme() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (line,) = re.findall(r"^    (python3 -m venv .*tox -e tests)", readme, re.MULTILINE)
    assert line in (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()
