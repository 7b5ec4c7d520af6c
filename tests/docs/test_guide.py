"""Every example of the guide is played: commands, edits and outputs in order, each page in a directory of its own."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest
from sybil import Document
from sybil.parsers.markdown.lexers import RawFencedCodeBlockLexer

from nros_conformance.cli.main import _parser
from nros_conformance.formats.toml import read_toml
from nros_conformance.formats.yaml12 import read_yaml
from nros_conformance.judge.judge import judge
from nros_conformance.scaffold.project import write_project
from nros_conformance.suite.loader import load_suites
from nros_conformance.trace.files import read_trace
from nros_conformance.trace.records import AnyRecord, Header

DOCS = Path(__file__).parents[2] / "docs"
_BLOCKS = RawFencedCodeBlockLexer(re.compile(r"(?P<language>\w+)\n"))
_MARK = re.compile(r"<!-- (?P<what>the same as|file): (?P<path>\S+) -->\s*\Z")


def blocks(page: Path) -> Iterator[tuple[str, str, str, str]]:
    """Language, text, and what the comment before says of it (what, path)."""
    text = page.read_text(encoding="utf-8")
    for region in _BLOCKS(Document(text, str(page))):
        mark = _MARK.search(text[: region.start])
        language, source = region.lexemes["language"], str(region.lexemes["source"])
        yield language, source, mark["what"] if mark else "", mark["path"] if mark else ""


def package(place: Path) -> Path:
    """The folder that the page's paths are relative to: the new package once there is one."""
    return next(iter(place.glob("nros-*")), place)


def shell(line: str, place: Path) -> str:
    """What a command prints. The commands of the guide are run by this very Python, and install from nowhere else."""
    command, *arguments = shlex.split(line)
    if (command, arguments[:2]) == ("pip", ["install", "-e"]):
        here = ("--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check", "--target", "site")
        words = ["-m", "pip", "install", "-q", *here, f"./{arguments[2]}"]
    else:
        words = {
            "nros-conformance": ["-m", "nros_conformance.cli.main", *arguments],
            "pytest": ["-m", "pytest", "-p", "no:cacheprovider", "--assert=plain", *arguments],
        }[command]
    # As in an editable installation: what is edited is what is imported.
    path = os.pathsep.join([str(package(place)), str(place / "site")])
    done = subprocess.run(
        [sys.executable, *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
        cwd=place, env=os.environ | {"PYTHONPATH": path},
    )  # fmt: skip
    return done.stdout


def as_shown(expected: list[str], output: str) -> bool:
    """Whether a command printed that; ``...`` stands for anything, alone in its line for any lines."""
    parts = [r"(?:.*\n)*?" if line == "..." else _line(line) for line in expected]
    plain = "".join(f"{line.strip()}\n" for line in output.splitlines())
    return re.fullmatch("".join(parts) + r"\s*", plain) is not None


def _line(expected: str) -> str:
    return ".*?".join(re.escape(part.strip()) for part in expected.split("...")) + r"\s*\n"


def console(text: str, place: Path) -> None:
    for part in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
        line, *expected = part.splitlines()
        output = shell(line, place)
        while expected and not expected[-1]:
            expected.pop()
        assert not expected or as_shown(expected, output), f"$ {line}\nprinted\n{output}\nand the page shows\n{part}"


def edit(text: str, place: Path) -> None:
    header, *lines = text.splitlines()
    file = package(place) / header.removeprefix("--- ")
    old, new = ("".join(f"{line[1:]}\n" for line in lines if line[:1] != sign) for sign in "+-")
    whole = file.read_text(encoding="utf-8")
    assert whole.count(old) == 1, f"{file.name} has this {whole.count(old)} times:\n{old}"
    file.write_text(whole.replace(old, new), encoding="utf-8")


def play(page: Path, place: Path) -> None:
    for language, text, what, path in blocks(page):
        if what == "the same as":
            assert text == (package(place) / path).read_text(encoding="utf-8")
        elif what == "file":
            (place / path).parent.mkdir(parents=True, exist_ok=True)
            (place / path).write_text(text, encoding="utf-8")
        elif language == "console":
            console(text, place)
        elif language == "diff":
            edit(text, place)
        elif language == "yaml":
            read_yaml(page, text)
        elif language == "toml":
            read_toml(page, text)
        else:
            assert language in ("ini", "json"), f"nothing plays a block of {language}"


PLAYED = ("writing-a-backend", "writing-a-suite", "reading-the-matrix", "ci")


@pytest.mark.parametrize("name", PLAYED)
def test_the_examples_of_a_page_do_what_it_shows(name: str, tmp_path: Path) -> None:
    play(DOCS / f"{name}.md", tmp_path)


def test_the_adapter_fits_on_a_page(tmp_path: Path) -> None:
    write_project("mqtt", tmp_path / "new")
    text = (tmp_path / "new" / "nros_mqtt" / "__init__.py").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 80


@pytest.mark.parametrize(("expected", "output", "same"), [
    (["a ... c", "...", "z"], "a b c\nd\ne\n z\n", True),
    (["...", "z"], "z\n", True),
    (["a"], "a\nb\n", False),
    (["a ...", "b"], "a\nc\nb\n", False),
])  # fmt: skip
def test_what_a_page_shows_is_compared_line_by_line(expected: list[str], output: str, same: bool) -> None:
    assert as_shown(expected, output) is same


def test_commands_in_recipes_have_the_options_that_they_use() -> None:
    text = "\n".join(body for language, body, *_ in blocks(DOCS / "ci.md") if language in ("ini", "yaml"))
    commands = re.findall(r"nros-conformance ((?:run|matrix|doctor) .*)", text)
    assert len(commands) >= 4
    for line in commands:
        _parser(shlex.split(line)).parse_args(shlex.split(line))


def test_the_example_of_a_trace_passes_and_an_early_event_in_it_would_not(tmp_path: Path) -> None:
    (text,) = (body for _, body, what, _ in blocks(DOCS / "trace-format.md") if what == "file")
    file = tmp_path / "sample.miss.1.jsonl"
    file.write_text(text, encoding="utf-8")
    assert judge(read_trace(file)).verdict == "pass"
    file.write_text(
        text.replace('"total_count":1,"total_count_change":1', '"total_count":2,"total_count_change":2'),
        encoding="utf-8",
    )
    assert judge(read_trace(file)).verdict == "fail"


def test_the_trace_format_names_every_record_and_field() -> None:
    text = (DOCS / "trace-format.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `(\w+)` \|(.*)\|$", text, re.MULTILINE))
    kinds = {str(kind.__struct_config__.tag): kind for kind in (Header, *get_args(AnyRecord))}
    assert set(rows) - {"rec"} == set(kinds)
    for tag, kind in kinds.items():
        named = set(re.findall(r"`(\w+)`", rows[tag]))
        assert set(kind.__struct_fields__) <= named, tag


def test_the_examples_of_the_suite_format_can_be_played_as_they_stand(tmp_path: Path) -> None:
    whole, part = (text for language, text, *_ in blocks(DOCS / "suites.md") if language == "yaml")
    (tmp_path / "example.yaml").write_text(whole, encoding="utf-8")
    suites = load_suites(tmp_path)
    assert [one.key for one in suites.scenarios] == [
        "rdm.silence-after-data[deadline=in-qos]", "rdm.silence-after-data[deadline=at-registration]",
    ]  # fmt: skip
    head = (
        "suite: part\ntitle: A part\nscenarios:\n  - id: part.one\n    title: One\n"
        "    entities: {talker: {publisher: a}, listener: {subscription: a, take: always}}\n    script:\n"
    )
    (tmp_path / "example.yaml").write_text(head + textwrap.indent(part, "    "), encoding="utf-8")
    assert [one.key for one in load_suites(tmp_path).scenarios] == ["part.one"]


PLAYED_ELSEWHERE = {"can", "native-backends", "suites", "trace-format"}
"""Pages whose blocks have tests of their own, here or in tests/backends."""


def test_no_page_has_a_block_that_nothing_plays() -> None:
    pages = {page.stem for page in DOCS.glob("*.md") if any(blocks(page))}
    assert pages == {*PLAYED, *PLAYED_ELSEWHERE}
