from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from nros_conformance.formats.places import Document, FormatError
from nros_conformance.formats.yaml12 import read_yaml

FILE = Path("sample.yaml")


def read(text: str) -> Document:
    return read_yaml(FILE, text)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("on", "on"),
        ("yes", "yes"),
        ("No", "No"),
        ("off", "off"),
        ("True", "True"),
        ("true", True),
        ("false", False),
        ("null", None),
        ("~", None),
        ("", None),
        ("12", 12),
        ("-1", -1),
        ("+3", 3),
        ("1.5", 1.5),
        ("1e3", 1000.0),
        ("0x10", "0x10"),
        ("1_000", "1_000"),
        ("12:30", "12:30"),
        ("2027-05-01", "2027-05-01"),
        ("0.4T", "0.4T"),
        ("'12'", "12"),
        ('"true"', "true"),
        ("|\n  12", "12\n"),
        ("$n", "$n"),
        ("1T # scale", "1T"),
    ],
)
def test_words_and_numbers_are_those_of_yaml_1_2(text: str, value: Any) -> None:
    assert read(f"key: {text}\n").data == {"key": value}


def test_every_part_knows_its_line() -> None:
    document = read("a:\n  - one\n  - {b: 1,\n     c: 2}\nd: &x\n  e: 3\nf: *x\n")
    assert document.data == {"a": ["one", {"b": 1, "c": 2}], "d": {"e": 3}, "f": {"e": 3}}
    lines = {("a",): 1, ("a", 0): 2, ("a", 1): 3, ("a", 1, "b"): 3, ("a", 1, "c"): 4, ("d", "e"): 6, ("f",): 7}
    assert {path: document.line(path) for path in lines} == lines


def test_an_alias_has_the_lines_of_what_it_names_below_its_own() -> None:
    assert read("d: &x\n  e: 3\nf: *x\n").line(("f", "e")) == 2


def test_what_has_no_line_has_that_of_what_it_is_in() -> None:
    assert read("a:\n  b: 1\n").line(("a", "b", "c", 0)) == 2
    assert read("a: 1\n").line(("z",)) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "sample.yaml:1: the file is empty"),
        ("# nothing\n", "sample.yaml:1: the file is empty"),
        ("a: 1\nb: 2\na: 3\n", "sample.yaml:3: the key 'a' stands here twice; the first is in line 1"),
        ("a: {b: 1, b: 2}", "sample.yaml:1: the key 'b' stands here twice; the first is in line 1"),
        (
            "a: [1,\nb",
            "sample.yaml:2: not YAML: while parsing a flow sequence, expected ',' or ']', but got '<stream "
            "end>'; that began in line 1",
        ),
        (
            "a: 1\n---\nb: 2\n",
            "sample.yaml:2: not YAML: expected a single document in the stream, but found another document; that "
            "began in line 1",
        ),
        ("a: b: c\n", "sample.yaml:1: not YAML: mapping values are not allowed here"),
        ("a: *nowhere\n", "sample.yaml:1: not YAML: found undefined alias 'nowhere'"),
        (
            "x: 1\na: {b: c[0]}\n",
            "sample.yaml:2: not YAML: while parsing a flow mapping, expected ',' or '}', but got '['; between { "
            "and } a text with brackets needs quotes",
        ),
        (
            "a: \x07\n",
            "sample.yaml: not YAML: unacceptable character #x0007: special characters are not allowed in "
            '"<unicode string>", position 3',
        ),
        ("a: &x [1, *x]\n", "sample.yaml:1: the alias *x stands inside of what it names"),
        ("a: !mine 1\n", "sample.yaml:1: the tag '!mine' is not known; remove it"),
        ("a: 1\n? [b]\n: 2\n", "sample.yaml:2: a sequence stands where a key is expected; quote it, or name it"),
    ],
)
def test_what_is_not_yaml(text: str, message: str) -> None:
    with pytest.raises(FormatError) as caught:
        read(text)
    assert str(caught.value) == message


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(FormatError) as caught:
        read_yaml(tmp_path / "nowhere.yaml")
    assert str(caught.value) == f"{tmp_path}/nowhere.yaml: cannot be read: No such file or directory"
    (tmp_path / "bytes.yaml").write_bytes(b"a: \xff")
    with pytest.raises(FormatError) as caught:
        read_yaml(tmp_path / "bytes.yaml")
    assert str(caught.value) == (
        f"{tmp_path}/bytes.yaml: not YAML: 'utf-8' codec can't decode byte 0xff in position 3: invalid start byte"
    )


def test_a_file_is_read_as_utf_8(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_bytes("a: später\n".encode())
    assert read_yaml(file).data == {"a": "später"}
