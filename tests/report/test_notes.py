from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nros_conformance.report.evidence import evidence
from nros_conformance.report.notes import assign, natural
from nros_conformance.report.results import Report
from tests.report.build import (
    CLAIMED,
    LVC,
    LVL,
    MSL,
    ODM,
    RDM,
    REFUSED,
    REQUIREMENTS,
    declare,
    known,
    report,
    result,
)


def notes(*reports: Report) -> dict[str, str]:
    rows = [(one, evidence(one, REQUIREMENTS)) for one in reports]
    return {note.key: " ".join(note.texts) for note in assign(rows)[1]}


def absences(*reports: Report) -> list[dict[str, tuple[str, ...]]]:
    keys, _ = assign([(one, evidence(one, REQUIREMENTS)) for one in reports])
    return [keys[one.row].absences for one in reports]


def refused(because: str, **fields: Any) -> Mapping[str, Any]:
    return {**REFUSED, "because": because, **fields}


def test_each_class_of_absence_has_its_words() -> None:
    declaration = declare(
        events={
            LVC: refused("it has no peers", absent="never", link="https://github.com/a/b/issues/7"),
            RDM: refused("a clock would do"),
            MSL: refused("no sequence number", absent="not-yet", link="https://example.org/spec"),
            LVL: {**CLAIMED, "claim": "limited", "limit": {"b": [1], "a": True}, "because": "only `x < y`"},
            ODM: {"claim": "no"},
        },
        connection={"ping": "round_trip"},
    )
    assert notes(report(declaration)) == {
        "D1": "**never**: it has no peers ([#7](https://github.com/a/b/issues/7)).",
        "D2": "**not wired**: a clock would do.",
        "D3": "**not yet**: no sequence number ([link](https://example.org/spec)).",
        "D4": "**limit** `a = true, b = [1]`: only `x < y`.",
        "D5": "**not declared**: `backend.toml` says nothing about it.",
    }


def test_the_connection_has_notes_where_it_is_absent_or_limited() -> None:
    because = {"peer": "agent", "absent": "not-yet", "because": "one agent only"}
    limited = {**because, "reconnect": "limited", "hard_liveliness": {"claim": "limited"}, "ping": "round_trip"}
    assert absences(report(declare(connection=limited))) == [{"reconnect": ("D1",), "hard_liveliness": ("D1",)}]
    assert notes(report(declare(connection=limited))) == {"D1": "**limit**: one agent only."}
    assert notes(report(declare(connection={**because, "ping": "no"}))) == {"D1": "**not yet**: one agent only."}
    assert absences(report(declare(connection={**limited, "reconnect": "yes", "hard_liveliness": {}}))) == [{}]


def test_equal_reasons_share_a_key() -> None:
    declaration = declare(events=dict.fromkeys((LVC, LVL), refused("no liveliness")) | {RDM: refused("no rate")})
    assert absences(report(declaration)) == [
        {"LivelinessChanged": ("D1",), "LivelinessLost": ("D1",), "RequestedDeadlineMissed": ("D2",), "ping": ("D3",)}
    ]


def test_declared_keys_stay_and_derived_ones_go_around_them() -> None:
    declaration = declare(
        events={LVC: refused("one"), RDM: refused("two"), MSL: refused("three")},
        notes={"RequestedDeadlineMissed": "D1"}, known=[known("LVC-009", "x.y", "D3")],
    )  # fmt: skip
    assert absences(report(declaration))[0] == {
        "LivelinessChanged": ("D2",), "RequestedDeadlineMissed": ("D1",), "MessageLost": ("D4",), "ping": ("D5",),
    }  # fmt: skip


def test_a_key_that_another_backend_has_taken_carries_the_name() -> None:
    can = declare("can", events={LVC: refused("one")}, connection={"ping": "round_trip"})
    cyclone = declare("cyclone", events={LVC: refused("two")}, connection={"ping": "round_trip"})
    assert absences(report(can), report(cyclone)) == [
        {"LivelinessChanged": ("C1",)}, {"LivelinessChanged": ("cyclone:C1",)},
    ]  # fmt: skip


def test_variants_of_one_backend_share_their_notes() -> None:
    entry = known("LVC-004", "lvc.frozen", link="https://github.com/a/b/pull/9", cause="middleware")
    declaration = declare(known=[entry], connection={"ping": "round_trip"})
    peer = report(declaration, [result("lvc.frozen[how=stop]", "LVC-004", outcome="fail")], variant="peer")
    router = report(declaration, [result("lvc.frozen[how=kill]", "LVC-004", outcome="fail")], variant="router")
    assert notes(peer, router) == {
        "D1": "**violates LVC-004**: it was always so. Shown by `lvc.frozen[how=kill]`, `lvc.frozen[how=stop]`. "
        "Cause: middleware. Known; [#9](https://github.com/a/b/pull/9)."
    }


def test_a_variant_has_notes_of_its_own_where_it_declares_something_else() -> None:
    never = {"ping": "no", "absent": "never", "because": "nobody to ask"}
    asks = {"ping": "round_trip", "peer": "router", "reconnect": "limited", "because": "slowly"}
    declaration = declare(connection=asks, variants={"peer": {"connection": {**never, "peer": "none"}}, "router": {}})
    reports = [report(declaration.in_variant(name), variant=name) for name in ("peer", "router")]
    found, texts = assign([(one, evidence(one, REQUIREMENTS)) for one in reports])
    assert found["demo-peer"].absences == {"ping": ("D1",)}
    assert found["demo-router"].absences == {"reconnect": ("D2",)}
    assert [(note.key, *note.texts) for note in texts] == [
        ("D1", "**never**: nobody to ask."), ("D2", "**limit**: slowly."),
    ]  # fmt: skip


def test_entries_with_one_key_make_one_note() -> None:
    entries = [
        known("LVC-004", "lvc.leaves", versions=">=1.5,<2"),
        known("LVC-011", "lvc.lease", because="after the session lease", cause="adapter", versions="==1.6"),
        known("LVC-002", "lvc.other", "D9"),
    ]
    declaration = declare(
        known=entries, connection={"ping": "round_trip"},
        subject={"kind": "library", "says": "x", "package": "eclipse-zenoh"},
    )  # fmt: skip
    failing = [result("lvc.leaves", "LVC-004", outcome="fail"), result("lvc.lease", "LVC-011", outcome="fail")]
    assert notes(report(declaration, failing, versions={"eclipse-zenoh": "1.6.0"})) == {
        "D1": "**violates LVC-004, LVC-011**: it was always so; after the session lease. "
        "Shown by `lvc.lease`, `lvc.leaves`. Cause: middleware, adapter. "
        "Known in eclipse-zenoh >=1.5,&lt;2, 1.6; unreported."
    }


def test_what_nobody_declared_is_numbered_over_all_rows() -> None:
    def failing(name: str, *requirements: str) -> Report:
        declaration = declare(name, connection={"ping": "round_trip"})
        return report(declaration, [result(f"x.{name}", one, outcome="fail") for one in requirements])

    found = notes(failing("a", "REG-001", "LVC-003"), failing("b", "LVC-001", "REG-001"))
    assert found == {
        "!1": "**violates REG-001**, which no `[[known]]` entry covers. Shown by `x.a`.",
        "!2": "**violates REG-001**, which no `[[known]]` entry covers. Shown by `x.b`.",
        "!3": "**violates LVC-001**, which no `[[known]]` entry covers. Shown by `x.b`.",
    }


def test_a_surprise_names_the_scenarios_that_nobody_declared_in_order() -> None:
    declaration = declare(known=[known("REG-001", "x.known")], connection={"ping": "round_trip"})
    scenarios = ["x.known", *(f"x.{name}" for name in "hgfedcba")]
    failing = [
        *(result(one, "REG-001", outcome="fail") for one in scenarios), result("x.passes", "REG-001"),
    ]  # fmt: skip
    assert notes(report(declaration, failing))["!1"] == (
        "**violates REG-001**, which no `[[known]]` entry covers. "
        "Shown by `x.a`, `x.b`, `x.c`, `x.d`, `x.e`, `x.f`, `x.g`, `x.h`."
    )


def test_keys_sort_by_number() -> None:
    assert sorted(["C10", "C9", "B11", "can:C2"], key=natural) == ["B11", "C9", "C10", "can:C2"]
