from __future__ import annotations

from pathlib import Path

import pytest

from nros_conformance.formats.places import FormatError
from nros_conformance.suite.loader import load_suites
from nros_conformance.suite.published import load_published, read_published
from tests.report.build import LVC, LVL, MSL, ODM, RDM, REQUIREMENTS
from tests.report.tables import SMALL, shipped, small

BOOK = (
    "| Cyclone DDS | ✗ Not wired through the nano-ros event API yet | ✗ Not wired yet | ✗ Not wired yet |\n"
    "| XRCE-DDS | ✗ Not exposed (xrce-dds-client API limitation) | ✅ Shim-side clock check "
    "(sub: `has_data` / `try_recv_raw`; pub: `publish_raw`) | ✗ Not exposed |\n"
    "| zenoh-pico | ✅ Poll-based via zenoh tokens (alive_count ∈ {0,1}) | ✅ Shim-side clock check "
    "(`<P as PlatformClock>::clock_ms`) | ✅ Seq-gap detection from RMW attachment |\n"
    "| uORB | ✗ No wire-level liveliness | ✗ No rate concept | ✅ Native (host mock + real PX4 via "
    "`RustSubscriptionCallback` publish-counter) |\n"
)
"""The table of nano-ros' book at 9a7a150. Columns: LivelinessChanged / Lost, DeadlineMissed, MessageLost."""

LEGEND = (
    "✓ = wired and tested. 🟡 = surface API works (returns Err while pending), wiring planned. "
    "✗ = not feasible at this layer."
)


def test_the_shipped_table_is_that_of_the_book_word_for_word() -> None:
    published = shipped()
    columns = [(LVC, LVL), (RDM, ODM), (MSL,)]
    lines = [line.split(" | ") for line in BOOK.splitlines()]
    assert [one.title for one in published.backends] == [line[0].strip("| ") for line in lines]
    for one, (_, *cells) in zip(published.backends, lines, strict=True):
        for kinds, cell in zip(columns, cells, strict=True):
            mark, _, remark = cell.removesuffix(" |").partition(" ")
            for kind in kinds:
                assert one.cell(kind).remark == remark
                assert one.cell(kind).word == {"✗": "no", "✅": "yes"}[mark]
    legend = " ".join(f"{word.mark} = {word.says}." for word in published.legend.values())
    assert legend == LEGEND


def test_the_names_of_the_shipped_table_are_those_of_backends_here() -> None:
    assert [one.backend for one in shipped().backends] == ["cyclone", "xrce", "zenoh", "uorb"]


def test_what_was_read_of_the_compiled_backends() -> None:
    slots = {one.backend: one.compiled.event_slots for one in shipped().backends if one.compiled}
    assert slots == {"cyclone": "empty", "xrce": "empty", "zenoh": "filled", "uorb": "empty"}


def test_links_are_to_the_revision() -> None:
    published = shipped()
    sources = [one.compiled.source for one in published.backends if one.compiled]
    assert all(f"/blob/{published.revision}/" in link for link in (published.link, *sources))


def test_the_published_table_is_no_suite(tmp_path: Path) -> None:
    (tmp_path / "published.yaml").write_text(SMALL, encoding="utf-8")
    with pytest.raises(FormatError, match="no suite files here"):
        load_suites(tmp_path)


def test_a_directory_has_its_own_table_or_uses_the_shipped_one(tmp_path: Path) -> None:
    assert load_published(tmp_path, REQUIREMENTS) == shipped()
    (tmp_path / "published.yaml").write_text(SMALL, encoding="utf-8")
    assert load_published(tmp_path, REQUIREMENTS) == small()


def test_a_directory_with_a_catalogue_of_its_own_and_no_table_has_none(tmp_path: Path) -> None:
    (tmp_path / "requirements.yaml").write_text("", encoding="utf-8")
    assert load_published(tmp_path, {"X-001"}) is None


def test_a_table_that_is_no_text(tmp_path: Path) -> None:
    directory = tmp_path / "mine"
    directory.mkdir()
    (directory / "published.yaml").write_bytes(b"name: \xff\n")
    with pytest.raises(FormatError) as caught:
        load_published(directory, REQUIREMENTS)
    assert str(caught.value) == (
        "mine/published.yaml: cannot be read: 'utf-8' codec can't decode byte 0xff in position 6: invalid start byte"
    )


@pytest.mark.parametrize(
    ("good", "bad", "message"),
    [
        ("name: the book\n", "", "1: the key 'name' is missing; add name: ..."),
        ("title: Demo", "titel: Demo", "10: unknown key 'titel'; did you mean 'title'?"),
        ("means: absent", "means: abset", "7: means: unknown value 'abset'; did you mean 'absent'?"),
        ("[compiled]", "[compilt]", "4: kinds: unknown value 'compilt'; did you mean 'compiled'?"),
        ("[compiled]", "[]", "4: no kind of subject; add the kinds that run the same"),
        ("/abc1234/", "/main/", "3: the link does not hold the revision abc1234; link to it"),
        ("LivelinessChanged:", "LivelinesChanged:",
         "12: unknown event 'LivelinesChanged'; did you mean 'LivelinessChanged'?"),
        ("{word: works, remark: polled}", "{word: work, remark: polled}",
         "12: the legend has no word 'work'; did you mean 'works'?"),
        ("      MessageLost: {word: never, remark: not wired}\n", "",
         "11: demo: no cell for MessageLost; every event has one"),
        ("RDM-001", "RDM-011", "17: no requirement 'RDM-011'; did you mean 'RDM-001'?"),
        ("observed: anywhere", "observed: anywhere, unless: presence",
         "17: events are declared without a flag 'presence'; did you mean 'presence_only'?"),
    ],
)  # fmt: skip
def test_a_table_that_cannot_be_used(good: str, bad: str, message: str) -> None:
    assert good in SMALL
    with pytest.raises(FormatError) as caught:
        read_published(Path("p.yaml"), SMALL.replace(good, bad), REQUIREMENTS)
    assert str(caught.value) == f"p.yaml:{message}"


def test_a_backend_stands_in_it_once() -> None:
    twice = SMALL + SMALL.partition("backends:\n")[2]
    with pytest.raises(FormatError) as caught:
        read_published(Path("p.yaml"), twice, REQUIREMENTS)
    assert str(caught.value) == "p.yaml:21: the backend demo stands here twice; the first is in line 9"
