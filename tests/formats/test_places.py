from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from msgspec import Meta, Struct

from nros_conformance.formats.durations import Duration
from nros_conformance.formats.places import Document, FormatError, nearest
from nros_conformance.formats.yaml12 import read_yaml

Name = Annotated[str, Meta(pattern=r"^[a-z]+$")]


class Wheel(Struct, forbid_unknown_fields=True, kw_only=True):
    size: int = 20
    colour: Literal["red", "blue"] = "red"
    turn: Duration = Duration.parse("1s")


class Car(Struct, forbid_unknown_fields=True, kw_only=True):
    name: Name
    wheels: list[Wheel] = []
    spare: Wheel | None = None
    parts: dict[Name, Wheel] = {}


def failing(text: str) -> str:
    with pytest.raises(FormatError) as caught:
        read_yaml(Path("car.yaml"), text).read(Car)
    return str(caught.value)


def test_a_document_becomes_a_value() -> None:
    document = read_yaml(Path("car.yaml"), "name: volvo\nwheels: [{size: 3}]\n")
    assert document.read(Car) == Car(name="volvo", wheels=[Wheel(size=3)])
    assert document.read(Wheel, path=("wheels", 0)) == Wheel(size=3)
    assert document.read(Wheel, {"size": 4}, ("wheels", 0)) == Wheel(size=4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nam: volvo\n", "car.yaml:1: unknown key 'nam'; did you mean 'name'?"),
        ("name: volvo\nroof: 1\n", "car.yaml:2: unknown key 'roof'; valid are name, parts, spare, wheels"),
        ("wheels: []\n", "car.yaml:1: the key 'name' is missing; add name: ..."),
        ("name: Volvo\n", "car.yaml:1: name: 'Volvo' does not have the form ^[a-z]+$"),
        ("name: volvo\nwheels:\n  - {}\n  - {size: big}\n", "car.yaml:4: size: expected `int`, got `str`"),
        ("name: volvo\nwheels:\n  - colour: rde\n", "car.yaml:3: colour: unknown value 'rde'; did you mean 'red'?"),
        ("name: volvo\nspare:\n  colour: pink\n", "car.yaml:3: colour: unknown value 'pink'; valid are blue, red"),
        ("name: volvo\nspare:\n  seize: 1\n", "car.yaml:3: unknown key 'seize'; did you mean 'size'?"),
        ("name: volvo\nparts:\n  a: {}\n  b: {size: x}\n", "car.yaml:4: size: expected `int`, got `str`"),
        ("name: volvo\nparts:\n  a: {}\n  B: {}\n", "car.yaml:4: the key 'B' does not have the form ^[a-z]+$"),
        (
            "name: volvo\nspare: {turn: 1x}\n",
            "car.yaml:2: turn: unknown unit 'x' in the duration '1x'; known are ns, us, "
            "ms, s, min, h, T, tolerance, early, discovery_bound, connection_lease, hard_liveliness_timeout, "
            "hard_liveliness_grace",
        ),
    ],
)
def test_errors_name_line_key_and_remedy(text: str, message: str) -> None:
    assert failing(text) == message


def test_an_error_keeps_its_parts() -> None:
    error = Document("car.yaml", {}, {(): 1, ("a",): 7}).error(("a", "b"), "it is broken", "mend it")
    assert (error.file, error.line, error.what, error.remedy) == ("car.yaml", 7, "it is broken", "mend it")
    assert str(error) == "car.yaml:7: it is broken; mend it"


def test_data_that_did_not_come_from_text_has_no_lines() -> None:
    error = Document("trace", {}, {}).error(("a",), "it is broken")
    assert error.line is None
    assert str(error) == "trace: it is broken"


@pytest.mark.parametrize(
    ("remedy", "message"), [("mend it", "f:1: broken; mend it (in x)"), ("", "f:1: broken (in x)")]
)
def test_a_note_ends_every_error(remedy: str, message: str) -> None:
    assert str(Document("f", {}, {(): 1}, "in x").error((), "broken", remedy)) == message


@pytest.mark.parametrize(
    ("word", "known", "remedy"),
    [
        ("periodc", ["never", "periodic"], "did you mean 'periodic'?"),
        ("xyz", ["b", "a"], "valid are a, b"),
        ("xyz", [], ""),
    ],
)
def test_the_nearest_word_is_the_remedy(word: str, known: list[str], remedy: str) -> None:
    assert nearest(word, known) == remedy


def test_the_data_itself_stays_as_it_was() -> None:
    data: dict[str, Any] = {"name": "volvo", "parts": {"a": {"size": "x"}}}
    with pytest.raises(FormatError):
        Document("car", data, {}).read(Car)
    assert data == {"name": "volvo", "parts": {"a": {"size": "x"}}}
