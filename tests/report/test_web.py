from __future__ import annotations

import re
from html.parser import HTMLParser

import msgspec

from nros_conformance.report.web import _keys, markup, page
from tests.report.build import LVC, REFUSED, REQUIREMENTS, cyclone, declare, reference, refusal, report, uorb

STATEMENTS = {"LVC-009": "A resumed publisher & <friends> come back."}
VOID = {"meta", "link", "br", "img"}


class Page(HTMLParser):
    """Nesting, ids, targets and text of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.targets: list[str] = []
        self.tags: set[str] = set()
        self.inside: dict[str, list[str]] = {}
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        values = dict(attrs)
        if values.get("id"):
            self.ids.append(str(values["id"]))
            self.inside[str(values["id"])] = list(self.open)
        for name in ("href", "src"):
            if values.get(name):
                self.targets.append(str(values[name]))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


TEXT = page([uorb(), reference(), cyclone()], REQUIREMENTS, statements=STATEMENTS, mutation={"REG": (1, 2)})


def cell_texts(text: str) -> list[str]:
    return re.findall(r'<a class="word [^"]*"[^>]*>([^<]*)</a>', text)


def test_the_page_is_well_formed_and_every_link_inside_it_arrives() -> None:
    found = Page(TEXT)
    assert len(found.ids) == len(set(found.ids))
    inner = [target[1:] for target in found.targets if target.startswith("#")]
    assert len(inner) > 18
    assert set(inner) <= set(found.ids)


def test_nothing_comes_from_elsewhere() -> None:
    found = Page(TEXT)
    assert not found.tags & {"script", "link", "img", "iframe", "object"}
    assert "@import" not in TEXT
    assert "url(" not in TEXT
    assert {target for target in found.targets if not target.startswith("#")} == {
        "https://docs.px4.io/main/en/middleware/uorb.html",
        "https://github.com/eclipse-cyclonedds/cyclonedds/issues/1798",
    }


def test_the_cells_are_those_of_the_matrix() -> None:
    assert cell_texts(TEXT) == [
        "partly 8/9", "yes°", "limited", "yes", "yes", "33/33",
        "no", "no", "unclear", "no", "no", "28/29 FAIL",
        "untested", "n/a", "n/a", "untested", "n/a", "n/a",
    ]  # fmt: skip
    assert 'class="word deviates undeclared" href="#uorb-base"' in TEXT
    assert 'class="word deviates" href="#cyclone-LivelinessChanged"' in TEXT


def test_a_cell_leads_into_its_details_so_that_they_open() -> None:
    inside = Page(TEXT).inside
    assert inside["cyclone-LivelinessChanged"][-1] == "details"
    assert inside["uorb-base"][-1] == "details"


def test_the_details_list_every_rule_with_what_was_seen_and_where() -> None:
    details = TEXT.partition('id="cyclone-LivelinessChanged"')[2].partition("</details>")[0]
    assert len(re.findall(r'<tr class="', details)) == 9
    assert (
        '<tr class="known"><th scope="row">LVC-009<span class="statement">'
        "A resumed publisher &amp; &lt;friends&gt; come back.</span></th>"
        '<td><span class="standing">violated, known</span> <a class="key" href="#note-C1">C1</a></td>'
        "<td><code>lvc.frozen-idle-publisher-returns</code></td></tr>"
    ) in details
    assert "<p>Canonical stimulus <code>reg.raises-liveliness-changed</code>: pass.</p>" in details
    gap = TEXT.partition('id="cyclone-RequestedDeadlineMissed"')[2].partition("</details>")[0]
    assert '<span class="standing">not exercised</span></td><td>needs <code>libfaketime</code></td>' in gap
    absent = TEXT.partition('id="uorb-LivelinessChanged"')[2].partition("</details>")[0]
    assert "<p>Proof of absence <code>reg.absent-liveliness-changed</code>: pass.</p>" in absent
    assert "<td>LivelinessChanged is not claimed</td>" in absent


def test_details_of_violations_stand_open() -> None:
    opened = re.findall(r'<details open><summary><span class="column">([^<]*)</span>', TEXT)
    assert opened == ["Liveliness changed", "Base rules"]


def test_the_page_follows_the_reader_in_width_and_light() -> None:
    assert '<meta name="viewport" content="width=device-width, initial-scale=1">' in TEXT
    assert "@media (prefers-color-scheme: dark)" in TEXT
    assert "@media (max-width: 46rem)" in TEXT
    assert '<td data-label="Requested deadline missed">' in TEXT


def test_a_partial_run_and_a_missing_backend_say_so() -> None:
    partial = msgspec.structs.replace(uorb(), partial=True, profile="standard", why_partial="12 scenarios left out")
    gone = msgspec.structs.replace(cyclone(), available=False, unavailable_reason="No module named 'cyclonedds'")
    text = page([partial, gone], REQUIREMENTS)
    assert (
        '<p class="banner"><strong>Partial:</strong> profile standard, 12 scenarios left out (uorb); '
        "not for publication.</p>" in text
    )
    assert "No row for <strong>Cyclone DDS</strong>, which is not available here: No module named" in text
    alone = page([gone], REQUIREMENTS)
    Page(alone)
    assert 'id="evidence"' not in alone


def test_texts_of_third_parties_stay_text() -> None:
    hostile = "<script>alert(1)</script>"
    declaration = declare(
        "evil", title=hostile, adapter="evil:Evil",
        events={LVC: {**REFUSED, "because": f"{hostile} [x](javascript:a)"}},
        subject={"kind": "library", "says": hostile, "not": hostile}, notes={"LivelinessChanged": 'k"><i>'},
    )  # fmt: skip
    found = Page(page([report(declaration, [refusal(LVC)])], REQUIREMENTS, statements={"REG-001": hostile}))
    assert "script" not in found.tags
    assert "i" not in found.tags
    assert not any("javascript" in target for target in found.targets)


def test_markdown_of_notes_becomes_html() -> None:
    assert markup("**never**: `a < b` &lt;x> *so* ([#7](https://a.b/7)), [requirements](docs/r.md)") == (
        "<strong>never</strong>: <code>a &lt; b</code> &lt;x&gt; <em>so</em> "
        '(<a href="https://a.b/7">#7</a>), requirements'
    )


def test_of_many_scenarios_the_first_are_shown_and_the_others_wait_behind_a_mark() -> None:
    one, *few = (f"a.b[k={number}]" for number in range(8))
    assert _keys([one]) == f"<code>{one}</code>"
    text = _keys([one, *few])
    assert text.endswith(
        '<details class="more"><summary>and 2 more</summary><code>a.b[k=6]</code> <code>a.b[k=7]</code></details>'
    )
    assert text.count("<code>") == 8
