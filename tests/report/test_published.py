"""What agrees with a published table, and what does not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

from nros_conformance.report.published import compare, count, differing, intro, not_run, section
from nros_conformance.report.results import Report
from nros_conformance.report.table import assemble
from nros_conformance.suite.published import Published, read_published
from tests.report.build import (
    LIMITED,
    LVC,
    LVL,
    MSL,
    ODM,
    RDM,
    REFUSED,
    REQUIREMENTS,
    cyclone,
    declare,
    everything,
    refusal,
    registered,
    report,
    result,
    uorb,
)
from tests.report.tables import NEWS, SMALL, demo, shipped, small, with_canonical, xrce

LINK = f"[9a7a150]({NEWS}/book/src/concepts/status-events.md#L152-L159)"
INTRO = (
    f"The nano-ros book, `status-events.md` at {LINK}, has 20 such cells (4 backends, 5 events); "
    '"yes" is *wired and tested*, "no" is *not feasible at this layer* there. It describes nano-ros\' own backends, '
)
BY_OTHERS = (
    'no cell of it is right or wrong. *Understated* means "possible", not "wired"; *overstated* means "absent from '
    'what ran here", not "wrong".'
)
READ = (
    "Read, not run: the event slots of the compiled "
    f"[Cyclone DDS]({NEWS}/packages/rmw/cyclonedds/nros-rmw-cyclonedds/src/vtable.cpp#L64-L65), "
    f"[XRCE-DDS]({NEWS}/packages/rmw/xrce/nros-rmw-xrce/src/vtable.c#L56-L57) and "
    f"[uORB]({NEWS}/packages/rmw/uorb/nros-rmw-uorb/src/vtable.cpp#L56-L57) backends are `NULL` at that revision, so a "
    'nano-ros application gets `UNSUPPORTED` from each, and its "yes" for XRCE-DDS (both deadlines) and uORB (message '
    "lost) is overstated there; the event slots of the compiled "
    f"[zenoh-pico]({NEWS}/packages/rmw/cffi/src/rust_adapter.rs#L316-L317) are filled: registering answers 0 OK, "
    "on the wrong side -5 UNSUPPORTED, without a callback -4 INVALID_ARGUMENT."
)


def rows(*reports: Report, published: Published | None = None) -> list[list[str]]:
    return differing(assemble(reports, REQUIREMENTS), published or shipped())


def counted(*reports: Report, published: Published | None = None) -> str:
    return count(assemble(reports, REQUIREMENTS), published or shipped())


def test_the_section_of_two_rows() -> None:
    assert (
        section(assemble([uorb(), cyclone()], REQUIREMENTS), shipped())
        == f"""\
## Against the published table

{INTRO}and no row here does: by the rows here {BY_OTHERS}

| Backend | Event | Documented | Observed | Drift |
|:--|:--|:--|:--|:--|
| **Cyclone DDS** | all five | no: "Not wired through the nano-ros event API yet"; "Not wired yet" | \
partly, yes, limited, yes, yes | understated: possible |

Of its 20 cells 4 agree, 0 differ in detail, 5 are understated, 0 are overstated. \
Not compared: 1 untested or unclear here (uORB: message lost); 10 without a row here (XRCE-DDS, zenoh-pico). \
Ping, reconnect and hard liveliness are not in it.

{READ}
"""
    )


def test_what_a_remark_says_beyond_the_word_is_held_against_the_requirement() -> None:
    zenoh = declare("zenoh", title="zenoh")
    assert rows(xrce(), report(zenoh, everything(zenoh))) == [
        [
            "**XRCE-DDS**", "both deadlines",
            'yes: "Shim-side clock check (sub: `has_data` / `try_recv_raw`; pub: `publish_raw`)"',
            "yes; from `drive_io` alone", "detail: where it fires",
        ],
        [
            "**zenoh**", "liveliness changed", 'yes: "Poll-based via zenoh tokens (alive_count ∈ {0,1})"',
            "yes; counts each publisher", "detail: the count",
        ],
    ]  # fmt: skip


@pytest.mark.parametrize("outcome", ["fail", "unclear", None])
def test_a_requirement_that_does_not_hold_shows_no_other_detail(outcome: Any) -> None:
    one = xrce()
    kept = [each for each in one.results if "RDM-001" not in each.proves]
    shown = [result("rdm.silence", "RDM-001", outcome=outcome)] if outcome else []
    drifts = rows(msgspec.structs.replace(one, results=(*kept, *shown)))
    assert drifts[-1][1:2] + drifts[-1][3:] == [
        "offered deadline missed", "yes; from `drive_io` alone", "detail: where it fires",
    ]  # fmt: skip
    assert [each[-1] for each in drifts[:-1]] == (["detail: rules violated"] if outcome == "fail" else [])


def test_a_backend_that_tells_presence_alone_agrees_on_the_count() -> None:
    presence = declare("zenoh", title="zenoh", events={LVC: {"claim": "yes", "how": "tokens", "presence_only": True}})
    assert rows(report(presence, everything(presence))) == []


@pytest.mark.parametrize(
    ("kind", "drift"),
    [("library", "understated: possible"), ("model", "understated: possible"), ("compiled", "understated: it works")],
)
def test_only_a_row_of_the_same_subject_contradicts(kind: str, drift: str) -> None:
    assert rows(demo(kind, events={LVC: REFUSED}), published=small())[-1] == [
        "**Demo**", "message lost, liveliness lost, offered deadline missed", 'never: "not wired"', "yes", drift,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "drift"), [("library", "overstated: absent here"), ("compiled", "overstated: absent")]
)
def test_what_is_documented_and_proved_absent_is_overstated(kind: str, drift: str) -> None:
    found = rows(demo(kind, events={LVC: REFUSED}), published=small())
    assert found[0] == ["**Demo**", "liveliness changed", 'works: "polled"', "no", drift]


@pytest.mark.parametrize(
    ("kind", "drift"), [("protocol", "overstated: broken here"), ("compiled", "overstated: broken")]
)
def test_what_is_documented_and_broken_is_overstated(kind: str, drift: str) -> None:
    found = rows(with_canonical(demo(kind), LVC, "fail"), published=small())
    assert found[0] == ["**Demo**", "liveliness changed", 'works: "polled"', "broken", drift]


def test_what_is_documented_absent_and_broken_here_differs_in_detail() -> None:
    found = rows(with_canonical(demo(), MSL, "fail"), published=small())
    assert found[1][1:] == ["message lost", 'never: "not wired"', "broken", "detail: it is broken"]


def test_what_works_undeclared_is_understated() -> None:
    refusing = declare("demo", events={MSL: REFUSED})
    one = report(
        refusing, [each for each in everything(refusing) if each.refusal != MSL.label],
        observations=[registered(MSL, 0)],
    )  # fmt: skip
    undeclared = msgspec.structs.replace(one, results=(*one.results, refusal(MSL, "fail", fired={int(MSL): 1})))
    found = rows(undeclared, published=small())
    assert found[-1][1:] == [
        "message lost, liveliness lost, offered deadline missed", 'never: "not wired"', "undeclared, yes, yes",
        "understated: possible",
    ]  # fmt: skip


def test_limits_and_violations_are_details() -> None:
    limited = demo(events={LVC: LIMITED, MSL: REFUSED, LVL: REFUSED, ODM: REFUSED})
    assert rows(limited, published=small())[0][2:] == ['works: "polled"', "limited", "detail: the limit"]
    violating = msgspec.structs.replace(
        limited, results=(*limited.results, result("rdm.x", "RDM-004", outcome="fail"))
    )  # fmt: skip
    assert rows(violating, published=small())[-1][1:] == [
        "requested deadline missed", 'works: "only on take"', "partly; anywhere", "detail: rules violated, where",
    ]  # fmt: skip


@pytest.mark.parametrize("outcome", ["unclear", "untested"])
def test_what_was_not_decided_is_not_compared(outcome: str) -> None:
    one = demo(events=dict.fromkeys((MSL, LVL, ODM), REFUSED))
    assert counted(one, published=small()) == (
        "Of its 5 cells 4 agree, 1 differs in detail, 0 are understated, 0 are overstated. "
        "Ping, reconnect and hard liveliness are not in it."
    )
    shaken = with_canonical(one, RDM, outcome)
    assert rows(shaken, published=small()) == []
    assert counted(shaken, published=small()) == (
        "Of its 5 cells 4 agree, 0 differ in detail, 0 are understated, 0 are overstated. "
        "Not compared: 1 untested or unclear here (Demo: requested deadline missed). "
        "Ping, reconnect and hard liveliness are not in it."
    )


def test_one_is_not_many() -> None:
    assert counted(demo(events=dict.fromkeys((LVC, MSL, LVL), REFUSED)), published=small()).startswith(
        "Of its 5 cells 2 agree, 1 differs in detail, 1 is understated, 1 is overstated. "
    )
    assert counted(demo(events=dict.fromkeys((LVC, RDM, LVL), REFUSED)), published=small()).startswith(
        "Of its 5 cells 1 agrees, 0 differ in detail, 2 are understated, 2 are overstated. "
    )


def test_rows_of_backends_that_are_not_in_the_table_are_named_and_not_compared() -> None:
    can, mqtt = demo(name="can"), declare("mqtt", title="MQTT <3>", adapter="acme:Mqtt")
    found = assemble([can, report(mqtt, everything(mqtt))], REQUIREMENTS)
    assert compare(found, small()) == ()
    assert count(found, small()) == (
        "Of its 5 cells 0 agree, 0 differ in detail, 0 are understated, 0 are overstated. "
        "Not compared: 5 without a row here (Demo). "
        "Demo, MQTT &lt;3>, ping, reconnect and hard liveliness are not in it."
    )


def test_of_several_rows_of_a_backend_the_one_that_differs_most_counts() -> None:
    both = [
        with_canonical(demo(variant="peer", events=dict.fromkeys((MSL, LVL, ODM), REFUSED)), LVC, "untested"),
        demo(variant="router", events=dict.fromkeys((LVC, LVL, ODM), REFUSED)),
    ]
    assert [row[0] + ": " + row[-1] for row in rows(*both, published=small())] == [
        "**Demo (peer)**: detail: where",
        "**Demo (router)**: overstated: absent here",
        "**Demo (router)**: detail: where",
        "**Demo (router)**: understated: possible",
    ]
    assert counted(*both, published=small()) == (
        "Of its 5 cells 2 agree, 1 differs in detail, 1 is understated, 1 is overstated. "
        "Ping, reconnect and hard liveliness are not in it."
    )


@pytest.mark.parametrize(
    ("kinds", "who"),
    [
        (["compiled", "device"], ", as do the rows here."),
        (["compiled", "library"], f", and of the rows here only Demo (0) does: by the others {BY_OTHERS}"),
        (["device", "model", "compiled"],
         f", and of the rows here only Demo (0) and Demo (2) do: by the others {BY_OTHERS}"),
        (["model"], f", and no row here does: by the rows here {BY_OTHERS}"),
    ],
)  # fmt: skip
def test_it_is_said_which_rows_ran_what_the_table_is_about(kinds: list[str], who: str) -> None:
    published = msgspec.structs.replace(
        small(), subject=msgspec.structs.replace(small().subject, kinds=["compiled", "device"])
    )  # fmt: skip
    reports = [demo(kind, variant=str(index)) for index, kind in enumerate(kinds)]
    text = intro(assemble(reports, REQUIREMENTS), published)
    assert text == (
        "The book at [abc1234](https://example.org/abc1234/table.md), has 5 such cells (1 backend, 5 events); "
        f'"works" is *it works*, "never" is *it does not* there. It describes their own backends{who}'
    )


def test_without_a_look_at_sources_nothing_is_said_of_them() -> None:
    assert not_run(small()) == ""
    assert section(assemble([demo()], REQUIREMENTS), small()).endswith("are not in it.\n")


@pytest.mark.parametrize(
    ("compiled", "text"),
    [
        ("event_slots: empty", "the event slots of the compiled [Demo](https://s) backend are `NULL` at that revision, "
         "so a nano-ros application gets `UNSUPPORTED` from it, and its \"yes\" for Demo (liveliness changed, "
         "requested deadline missed) is overstated there"),
        ("event_slots: filled", "the event slots of the compiled [Demo](https://s) are filled"),
    ],
)  # fmt: skip
def test_what_was_read_of_a_single_backend(compiled: str, text: str) -> None:
    whole = SMALL + f"    compiled: {{{compiled}, source: 'https://s'}}\n"
    assert not_run(read_published(Path("p.yaml"), whole, REQUIREMENTS)) == f"Read, not run: {text}."


def test_texts_of_the_table_cannot_break_the_page() -> None:
    hostile = SMALL.replace("remark: polled", 'remark: "<b> | x"')
    text = section(
        assemble([demo(events={LVC: REFUSED})], REQUIREMENTS), read_published(Path("p"), hostile, REQUIREMENTS)
    )  # fmt: skip
    assert '| works: "&lt;b> \\| x" |' in text
