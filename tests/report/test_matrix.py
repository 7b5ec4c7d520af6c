"""The golden file is written anew by: python -m tests.report.test_matrix"""

from __future__ import annotations

import json
import random
import re
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nros_conformance.report.matrix import render
from nros_conformance.report.results import (
    Case,
    Control,
    Observation,
    Report,
    ReportError,
    decode_report,
    encode_report,
)
from nros_conformance.report.web import page
from tests.report.build import (
    LVC,
    LVL,
    MSL,
    ODM,
    RDM,
    REFUSED,
    REQUIREMENTS,
    canonical,
    cyclone,
    declare,
    everything,
    finding,
    reference,
    refusal,
    report,
    result,
    uorb,
)

GOLDEN = Path(__file__).parent / "matrix_golden.md"
MUTATION = {"REG": (12, 12), "LVC": (14, 15)}


def golden() -> str:
    return render([uorb(), reference(), cyclone()], REQUIREMENTS, mutation=MUTATION)


def section(text: str, title: str) -> str:
    return text.partition(f"## {title}\n\n")[2].partition("\n\n## ")[0]


def line(text: str, start: str) -> str:
    return next(one for one in text.splitlines() if one.startswith(start))


def test_the_matrix_of_two_backends() -> None:
    assert golden() == GOLDEN.read_text(encoding="utf-8")


def shuffled(value: Any, dice: random.Random) -> Any:
    """The same JSON with the keys of every object in another order."""
    if isinstance(value, dict):
        items = [(key, shuffled(one, dice)) for key, one in value.items()]
        dice.shuffle(items)
        return dict(items)
    return [shuffled(one, dice) for one in value] if isinstance(value, list) else value


def disordered(one: Report, dice: random.Random) -> Report:
    data = shuffled(json.loads(encode_report(one)), dice)
    for name in ("results", "observations"):
        dice.shuffle(data.get(name, []))
    data |= {"seconds": dice.random(), "host": {"name": str(dice.random())}}
    return decode_report(json.dumps(data).encode(), "shuffled")


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32))
def test_order_host_and_duration_change_no_byte(seed: int) -> None:
    dice = random.Random(seed)
    reports = [disordered(one, dice) for one in (cyclone(), uorb(), reference())]
    dice.shuffle(reports)
    assert render(reports, shuffled(REQUIREMENTS, dice), mutation=shuffled(MUTATION, dice)) == golden()
    assert page(reports, REQUIREMENTS) == page([cyclone(), uorb(), reference()], REQUIREMENTS)


def test_the_golden_matrix_fits_its_form() -> None:
    text = golden()
    assert not re.search(r"\d\d:\d\d|\d{4}-\d\d-\d\d| ms\b", text)
    anchors = [text.index("<!-- ANCHOR: table -->"), text.index("<!-- ANCHOR_END: table -->")]
    assert text[slice(*anchors)].count("\n| **Cyclone DDS**") == 2
    assert all(line.count("|") == 15 for line in section(text, "Gaps").splitlines() if line.startswith("|"))


def test_third_parties_follow_the_built_in_rows_by_name_and_variants_stand_together() -> None:
    def row(name: str, adapter: str = "", variant: str = "") -> Report:
        return report(declare(name, title=name.title(), adapter=adapter), variant=variant)

    text = render(
        [row("alpha", "acme.alpha:Alpha"), row("zenoh", variant="router"), row("zenoh", variant="peer"), row("can")],
        REQUIREMENTS,
    )
    assert re.findall(r"^\| \*\*(.*?)\*\*, library", text, re.MULTILINE) == [
        "Can", "Zenoh (peer)", "Zenoh (router)", "Alpha",
    ]  # fmt: skip


def test_a_variant_is_called_as_it_calls_itself_and_says_what_it_speaks_for() -> None:
    declaration = declare(variants={"router": {"title": "through a router", "says": "Sessions are clients"}})
    text = render([report(declaration, variant="router")], REQUIREMENTS)
    assert "| **Demo (through a router)**, library |" in text
    assert "- **Demo (through a router)**, 0 of 5 events: the Demo library on loopback. Sessions are clients." in text


def test_rows_with_one_title_are_told_apart() -> None:
    text = render([report(declare("a", title="MQTT")), report(declare("b", title="MQTT"))], REQUIREMENTS)
    assert "| **MQTT [a]**, library |" in text
    assert "| **MQTT [b]**, library |" in text


def test_a_backend_that_is_not_available_has_a_line_and_no_row() -> None:
    gone = report(
        declare("zenoh", title="zenoh", subject={"kind": "library", "says": "x", "install": 'pip install "a[zenoh]"'}),
        available=False, unavailable_reason="cannot import name 'x' from 'zenoh' (/opt/zenoh/__init__.py)",
    )  # fmt: skip
    text = render([gone, uorb()], REQUIREMENTS)
    assert (
        "No row for **zenoh**, which is not available here: cannot import name 'x' from 'zenoh'; "
        '`pip install "a[zenoh]"`.\n<!-- ANCHOR_END: table -->' in text
    )
    assert "| **zenoh**" not in text
    alone = render([gone], REQUIREMENTS)
    assert "No row for **zenoh**" in alone
    assert "## Notes" not in alone


def test_a_partial_run_says_so_in_the_first_line_after_the_title() -> None:
    parts = [
        msgspec.structs.replace(one, partial=True, profile="standard", why_partial="12 of 148 scenarios left out")
        for one in (cyclone(), uorb())
    ]
    assert render(parts, REQUIREMENTS).splitlines()[1:4] == [
        "# Status events: what each backend does",
        "",
        "**Partial: profile standard, 12 of 148 scenarios left out (cyclone, uorb); not for publication.**",
    ]
    assert "Partial" not in golden()


def test_reports_on_different_suites_are_refused_by_name() -> None:
    other = msgspec.structs.replace(uorb(), digest="sha256:55ab", suites_version="0.9")
    with pytest.raises(ReportError) as error:
        render([other, msgspec.structs.replace(cyclone(), digest="sha256:7c1e")], REQUIREMENTS)
    assert str(error.value) == (
        "these do not merge: cyclone is on suites 1.0 (sha256:7c1e), uorb on suites 0.9 (sha256:55ab); "
        "run one of them again"
    )


def test_two_reports_on_one_row_are_refused() -> None:
    with pytest.raises(ReportError) as error:
        render([uorb(), cyclone(), uorb()], REQUIREMENTS)
    assert str(error.value) == "2 reports on uorb; keep one of them"


@pytest.mark.parametrize("reports", [[], [reference()]])
def test_the_control_alone_makes_no_matrix(reports: list[Report]) -> None:
    with pytest.raises(ReportError) as error:
        render(reports, REQUIREMENTS)
    assert str(error.value) == "nothing to print: there is no report of any backend but the control"


def test_the_legend_holds_only_the_words_in_use() -> None:
    legend = line(golden(), "**yes**")
    assert "(`deviates`)" in legend
    assert "(`broken`)" not in legend
    assert "(`unclaimed`)" not in legend
    declaration = declare(events={LVC: REFUSED})
    lying = report(declaration, [canonical(RDM, "fail"), refusal(LVC, "unclear")])
    legend = line(render([lying], REQUIREMENTS), "**partly")
    assert re.findall(r"\(`(\w+)`\)", legend) == [
        "deviates", "broken", "not_applicable", "inconclusive", "no_evidence",
    ]  # fmt: skip
    assert "**FAIL**" in legend


@pytest.mark.parametrize(
    ("kinds", "first"),
    [
        (["library", "model"], "**No row is nano-ros' own backend.**"),
        (["library", "compiled"], "**Only *compiled* rows are about nano-ros' own backends.**"),
        (["device", "compiled"], "**Only *compiled* and *device* rows are about nano-ros' own backends.**"),
    ],
)
def test_the_subject_paragraph_names_the_kinds_in_use(kinds: list[str], first: str) -> None:
    text = render([report(declare(f"b{kind}", kind=kind)) for kind in kinds], REQUIREMENTS)
    paragraph = line(text, first)
    assert sorted(re.findall(r"\*(\w+)\*: ", paragraph)) == sorted(kinds)


def test_the_control_line_tells_what_failed() -> None:
    broken = Control(reference="passes 39 of 40; rdm.x: late", planted="", ok=False)
    reports = [
        msgspec.structs.replace(cyclone(), control=broken), uorb(), report(declare("zenoh"), control=None),
    ]  # fmt: skip
    assert line(render(reports, REQUIREMENTS), "Control") == (
        "Control: **failed**: the reference passes 39 of 40; rdm.x: late (cyclone); "
        'the reference passes 40 of 40; planted defect "fires late" is caught (uorb); '
        "none in the run of zenoh."
    )


def test_the_numbers_of_all_musts_stand_in_the_gaps() -> None:
    assert line(golden(), "99 rules") == (
        "99 rules apply to these rows: 93 hold, 2 are violated (1 not declared), 3 could not be exercised, 1 unclear."
    )
    assert "1 are violated (all known, all noted above)" in render([cyclone()], REQUIREMENTS)


def test_the_codes_of_ping_stand_apart_for_a_peer_that_answers_and_one_that_does_not() -> None:
    def ping(code: int, case: Case) -> Observation:
        return Observation(call="ping", side="session", case=case, code=code)

    other = Observation(call="destroy", side="session", case="silent", code=-3)
    answered = report(observations=[ping(0, "reachable"), ping(-2, "silent"), ping(-18, "silent"), other])
    text = section(render([answered], REQUIREMENTS), "Return codes observed")
    assert line(text, "| **Demo**").endswith("| 0, -2/-18 |")
    assert text.startswith("0 OK, -2 TIMEOUT, -18 CONNECTION_FAILED. Right side: ")


def test_gaps_with_one_reason_are_one_line() -> None:
    declaration = declare(behaviour={"derived_support": True})
    results = everything(declaration, "RDM-006", "LVC-004", "LVC-009", "ROB-001")
    blocked = [result("lvc.x", "LVC-004", "LVC-009", status="untested", reason="no child processes")]
    first = report(declaration, [*results, *blocked])
    second = report(declare("other", title="Other"), everything(declare(), "LVL-001"))
    assert [one for one in section(render([first, second], REQUIREMENTS), "Gaps").splitlines() if one[:1] == "-"] == [
        "- Ping of every row: what decides was not played: no scenario proves it.",
        "- REG-001 on Demo: not applicable, supports_event is derived from return codes.",
        "- RDM-006, ROB-001 on Demo: no scenario proves it.",
        "- LVC-004, LVC-009 on Demo: no child processes.",
        "- LVL-001 on Other: no scenario proves it.",
    ]


def test_an_untested_event_is_one_gap_and_not_one_per_rule() -> None:
    declaration = declare(events=dict.fromkeys((LVC, RDM, LVL, ODM), REFUSED))
    results = [one for one in everything(declaration) if one.canonical != MSL.label]
    text = section(render([report(declaration, results)], REQUIREMENTS), "Gaps")
    assert "- Message lost of Demo: what decides was not played: there is no scenario for it." in text
    assert "MSL-" not in text


def test_what_only_the_reference_exercised_is_said() -> None:
    assert "- RDM-006 on Cyclone DDS: needs `libfaketime`; exercised on the reference only." in golden()


def test_planted_defects_are_a_row_only_when_there_are_any() -> None:
    assert line(golden(), "| planted") == (
        "| planted defects caught | 12/12 | 0/0 | 0/0 | 0/0 | 0/0 | 14/15 | 0/0 | 0/0 | 0/0 | 0/0 | 0/0 | 0/0 | 26/27 |"
    )
    assert "planted defects caught" not in render([cyclone()], REQUIREMENTS)


def test_an_implied_invariant_counts_as_covered() -> None:
    one = report(results=[result("a.a", findings=[finding("CNT-001", implied=True)])])
    rows = section(render([one], REQUIREMENTS), "Gaps")
    assert line(rows, "| with a scenario").endswith("| 1 |")
    assert line(rows, "| exercised by").split(" | ")[3] == "1"


def test_texts_of_third_parties_cannot_break_the_page() -> None:
    declaration = declare(
        title="a | b <script>", events={LVC: {**REFUSED, "because": "x | y\n<b>z</b> ends."}},
        subject={"kind": "library", "says": "one\n\n## two"},
    )  # fmt: skip
    text = render([report(declaration, [refusal(LVC)])], REQUIREMENTS)
    assert "| **a \\| b &lt;script>**, library |" in text
    assert "- `D1` **not wired**: x | y &lt;b>z&lt;/b> ends." in text
    assert "1 of 5" not in text
    assert "**a | b &lt;script>**, 0 of 5 events: one ## two." in text


def test_versions_are_not_invented() -> None:
    plain = declare("own", title="Own", adapter="acme:Own")
    text = render([report(plain, versions={"acme": "3.1", "nros-conformance": "0.1.0"})], REQUIREMENTS)
    assert section(text, "Versions and how to repeat it").splitlines()[:3] == [
        "| Backend | Tested |",
        "|:--|:--|",
        "| **Own** | `acme` 3.1 |",
    ]
    pin = {"by": "nano-ros 0.5.0", "version": "1.10.2"}
    same = declare(subject={"kind": "library", "says": "x", "pinned": pin})
    other = declare("peer", title="Peer", subject={"kind": "protocol", "says": "x", "pinned": {**pin, "by": "ROS 2"}})
    text = render([report(same, versions={"zenoh": "1.10.2"}), report(other), report(plain)], REQUIREMENTS)
    assert section(text, "Versions and how to repeat it").splitlines()[:5] == [
        "| Backend | Tested | Pinned elsewhere | Same? |",
        "|:--|:--|:--|:--|",
        "| **Demo** | `zenoh` 1.10.2 | 1.10.2 (nano-ros 0.5.0) | yes |",
        "| **Peer** | nros-conformance 0.1.0 | 1.10.2 (ROS 2) | no, protocol only |",
        "| **Own** | nros-conformance 0.1.0 | none | \u2013 |",
    ]


def test_what_ran_is_listed_in_order() -> None:
    letters = "hgfedcba"
    rows = [
        report(
            declare(f"b{one}", title=one), tool=f"0.{one}", profile="smoke" if index % 2 else "publish", partial=True,
            why_partial=one, versions={"python": f"3.{one}", "y": "2", "x": "1"},
        )
        for index, one in enumerate(letters)
    ]  # fmt: skip
    text = render(rows, REQUIREMENTS)
    assert line(text, "Suites 1.0") == (
        "Suites 1.0 (`sha256:3f2a9c71`), profile `publish`, `smoke`, nros-conformance "
        "0.a, 0.b, 0.c, 0.d, 0.e, 0.f, 0.g, 0.h, Python 3.a, 3.b, 3.c, 3.d, 3.e, 3.f, 3.g, 3.h."
    )
    assert line(text, "**Partial: profile publish, b (bb); profile publish, d (bd); ").endswith(
        "profile publish, f (bf); profile publish, h (bh); profile smoke, a (ba); profile smoke, c (bc); "
        "profile smoke, e (be); profile smoke, g (bg); not for publication.**"
    )
    assert "| **a** | `x` 1, `y` 2 |" in text


def test_the_second_table_is_named_for_what_it_holds() -> None:
    assert "| Connection | Ping |" in golden()
    pattern = report(results=[result("pat.slow", suite="patterns", title="Slow consumer", findings=[])])
    assert "| Connection and patterns | Ping | Reconnect | Hard liveliness | Slow consumer |" in render(
        [pattern], REQUIREMENTS
    )


if __name__ == "__main__":
    GOLDEN.write_text(golden(), encoding="utf-8")
