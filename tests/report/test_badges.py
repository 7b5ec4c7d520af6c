"""Badges: read off the table, one for each row, never ahead of it."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import msgspec
import pytest

from nros_conformance.report.badges import Badge, badges, files, stale, svg
from nros_conformance.report.matrix import render
from tests.report.build import REQUIREMENTS, cyclone, uorb

HEAD = """\
| Backend, what ran | Liveliness changed | Requested deadline missed | Message lost | Liveliness lost \
| Offered deadline missed | Base rules |
|:--|:--|:--|:--|:--|:--|--:|
"""


@pytest.mark.parametrize(("cells", "message", "color"), [
    ("yes | yes | yes° | yes | yes | 33/33", "5 of 5 events", "brightgreen"),
    ("yes | yes | limited `C1` | yes | yes | 33/33", "5 of 5 events, 1 limited", "green"),
    ("no `U1` | no `U2` | yes | no `U1` | no `U2` | 27/29°", "1 of 5 events", "green"),
    ("**partly 7/9** `C2` | yes | yes | **partly 3/4** `C2` | yes | 32/33°", "5 of 5 events, 2 partly", "yellow"),
    ("yes | yes | yes | yes | yes | **partly 29/30** `X5`", "5 of 5 events", "yellow"),
    ("yes | yes | yes | yes | yes | **28/30 FAIL** `!1`", "5 of 5 events", "red"),
    ("**broken** | yes | yes | yes | yes | 33/33", "4 of 5 events, 1 broken", "red"),
    ("**undeclared** | yes | yes | yes | no | 33/33", "3 of 5 events, 1 undeclared", "red"),
    ("unclear | yes | yes | untested | yes | 33/33", "3 of 5 events, 1 unclear, 1 untested", "lightgrey"),
])  # fmt: skip
def test_a_badge_counts_the_events_that_the_table_shows(cells: str, message: str, color: str) -> None:
    text = f"{HEAD}| **zenoh (peers)**, library | {cells} |\n"
    assert badges(text) == {"zenoh-peers": Badge(label="zenoh (peers)", message=message, color=color)}


def test_a_violated_rule_of_the_second_table_is_no_green() -> None:
    text = f"{HEAD}| **A**, library | yes | yes | yes | yes | yes | 33/33 |\n\n| Connection | Ping |\n|:--|:--|\n"
    assert badges(f"{text}| **A** | yes |\n")["a"].color == "brightgreen"
    assert badges(f"{text}| **A** | **partly 2/3** `A1` |\n")["a"].color == "yellow"


def test_a_partial_run_has_no_number() -> None:
    text = render([msgspec.structs.replace(cyclone(), partial=True, why_partial="1 of 2 scenarios left out")],
                  REQUIREMENTS)  # fmt: skip
    assert badges(text)["cyclone-dds"] == Badge(label="Cyclone DDS", message="partial run", color="lightgrey")


def test_the_json_is_an_endpoint_of_shields_io() -> None:
    text = files(render([uorb()], REQUIREMENTS))["uorb.json"]
    assert json.loads(text) == {
        "schemaVersion": 1,
        "label": "uORB",
        "message": "0 of 5 events, 1 unclear",
        "color": "red",
    }


def test_the_picture_says_the_same_to_eyes_and_to_readers() -> None:
    root = ElementTree.fromstring(svg(Badge(label="A <b>", message="5 of 5 events", color="brightgreen")))
    space = "{http://www.w3.org/2000/svg}"
    assert root.findtext(f"{space}title") == root.get("aria-label") == "A <b>: 5 of 5 events"
    assert [one.text for one in root.iter(f"{space}text")] == ["A <b>", "5 of 5 events"]
    assert [one.get("fill") for one in root.iter(f"{space}rect")] == ["#555", "#4c1"]


def test_badges_that_say_otherwise_than_the_table_are_named(tmp_path: Path) -> None:
    text = render([cyclone(), uorb()], REQUIREMENTS)
    for name, content in files(text).items():
        (tmp_path / name).write_text(content, encoding="utf-8")
    assert list(stale(tmp_path, text)) == []
    (tmp_path / "uorb.svg").unlink()
    (tmp_path / "uorb.json").write_text("{}", encoding="utf-8")
    (tmp_path / "old.svg").write_text("", encoding="utf-8")
    assert list(stale(tmp_path, text)) == [
        f"{tmp_path}/uorb.json: says otherwise than the table",
        f"{tmp_path}/uorb.svg: there is no such badge",
        f"{tmp_path}/old.svg: the table has no such row",
    ]
