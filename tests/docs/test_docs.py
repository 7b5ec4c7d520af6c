from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from nros_conformance.cli.main import _parser
from nros_conformance.cli.matrix import _with_table
from nros_conformance.report.badges import stale
from nros_conformance.report.handbook import COMMAND, pages
from nros_conformance.suite import schema

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


README_COMMANDS = re.findall(r"`nros-conformance ([^`]+)`", (ROOT / "README.md").read_text(encoding="utf-8"))


@pytest.mark.parametrize("line", sorted(set(README_COMMANDS)))
def test_a_command_of_the_readme_can_be_given(line: str) -> None:
    words = shlex.split(line)
    assert _parser(words).parse_args(words).command == words[0]


def test_every_command_is_in_the_readme_and_has_one_line_of_help(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    text = _parser([]).format_help()
    block = text[text.index("  COMMAND\n") : text.index("\n\noptions:")].splitlines()[1:]
    commands = [re.fullmatch(r"    (\S+) +(\S.*)", line) for line in block]
    assert all(commands), text
    assert {match[1] for match in commands if match} == {line.split()[0] for line in README_COMMANDS}


@pytest.mark.parametrize("what", ["DOINGS", "STEPS", "GIVENS", "EXPECTATIONS"])
def test_the_page_of_the_suite_format_names_every_construct(what: str) -> None:
    words = set(re.findall(r"`(\w+)`", (ROOT / "docs" / "suites.md").read_text(encoding="utf-8")))
    assert not set(getattr(schema, what)) - words


def test_the_readme_and_the_badges_say_what_the_matrix_says() -> None:
    matrix, readme = ((ROOT / name).read_text(encoding="utf-8") for name in ("matrix.md", "README.md"))
    again = "write them again: nros-conformance matrix --readme README.md --badges docs/badges"
    assert _with_table(ROOT / "README.md", readme, matrix) == readme, again
    assert list(stale(ROOT / "docs" / "badges", matrix)) == [], again


def test_every_section_of_the_decisions_is_there_once_and_in_the_list_at_the_top() -> None:
    text = (ROOT / "docs" / "decisions.md").read_text(encoding="utf-8")
    sections = re.findall(r"^## (.*)$", text, re.MULTILINE)
    listed = re.findall(r"\[([^\]]+)\]\(#([^)]+)\)", text.partition("\n## ")[0])
    assert [title for title, _ in listed] == sections
    assert len(set(sections)) == len(sections)
    assert all(re.sub(r"[^a-z0-9 -]", "", title.lower()).replace(" ", "-") == anchor for title, anchor in listed)
    entries = re.findall(r"^- .*(?:\n  .*)*", text, re.MULTILINE)
    assert len(set(entries)) == len(entries)
