from __future__ import annotations

from pathlib import Path

import pytest

from nros_conformance.formats.places import Document, FormatError
from nros_conformance.formats.toml import read_toml


def read(text: str) -> Document:
    return read_toml(Path("sample.toml"), text)


SAMPLE = """\
name = "x"
"quoted" = 1

[subject]               # a comment
kind = "library"
nested.key = 1

[[known]]
key = "A1"

[[known]]
key = "A2"
lists = [
  [1, 2],
  [3],
]
after = 1

[events.LivelinessChanged]
claim = "yes"
"""


def test_tables_and_keys_know_their_lines() -> None:
    document = read(SAMPLE)
    lines = {
        ("name",): 1,
        ("quoted",): 2,
        ("subject",): 4,
        ("subject", "kind"): 5,
        ("subject", "nested", "key"): 6,
        ("known",): 8,
        ("known", 0, "key"): 9,
        ("known", 1): 11,
        ("known", 1, "key"): 12,
        ("known", 1, "lists"): 13,
        ("known", 1, "after"): 17,
        ("events",): 19,
        ("events", "LivelinessChanged", "claim"): 20,
    }
    assert {path: document.line(path) for path in lines} == lines
    assert document.data["known"][1]["after"] == 1


def test_a_text_in_an_array_is_no_key() -> None:
    assert read('list = [\n"a = b",\n]\na = 1\n').line(("a",)) == 4


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = 1\nb =\n", "sample.toml:2: not TOML: Invalid value"),
        ("a = 1\na = 2\n", "sample.toml:2: not TOML: Cannot overwrite a value"),
        ('a = "x', "sample.toml: not TOML: Unterminated string"),
    ],
)
def test_what_is_not_toml(text: str, message: str) -> None:
    with pytest.raises(FormatError) as caught:
        read(text)
    assert str(caught.value) == message


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(FormatError) as caught:
        read_toml(tmp_path / "nowhere.toml")
    assert str(caught.value) == f"{tmp_path}/nowhere.toml: cannot be read: No such file or directory"
    (tmp_path / "bytes.toml").write_bytes(b'a = "\xff"')
    with pytest.raises(FormatError) as caught:
        read_toml(tmp_path / "bytes.toml")
    assert str(caught.value) == (
        f"{tmp_path}/bytes.toml: not TOML: 'utf-8' codec can't decode byte 0xff in position 5: invalid start byte"
    )
