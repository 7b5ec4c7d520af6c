"""Reports by hand: small builders with defaults, and the two backends of the golden matrix."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from nros_conformance.judge.results import Finding, Outcome, Verdict, VerdictName
from nros_conformance.report.observations import tally
from nros_conformance.report.results import (
    FORMAT,
    Attempt,
    Case,
    Control,
    Observation,
    Report,
    ScenarioResult,
    Status,
)
from nros_conformance.rmw.declaration import Declaration, Known, load_declaration
from nros_conformance.rmw.events import EventKind

LVC, RDM, MSL, LVL, ODM = EventKind

_COUNTS = {
    "REG": 9, "DSP": 12, "CNT": 7, "RDM": 9, "ODM": 4, "LVC": 11, "LVL": 6, "MSL": 8, "QOS": 6, "CON": 10, "LIF": 4,
    "ROB": 4,
}  # fmt: skip
_SHOULD = [
    "REG-007", "REG-008", "DSP-006", "DSP-009", "DSP-012", "CNT-007", "RDM-009", "LVC-003", "LVC-005", "LVL-004",
    "LVL-006", "MSL-006", "MSL-007", "MSL-008", "QOS-006", "CON-007", "ROB-004",
]  # fmt: skip
REQUIREMENTS = {
    f"{group}-{number:03}": "must" for group, count in _COUNTS.items() for number in range(1, count + 1)
}  # fmt: skip
REQUIREMENTS |= dict.fromkeys(_SHOULD, "should") | {"CNT-006": "may"}
"""The catalogue of REQUIREMENTS section 2: id to level."""

MUSTS = [requirement for requirement, level in REQUIREMENTS.items() if level == "must"]

CLAIMED = {"claim": "yes", "how": "native"}
REFUSED = {"claim": "no", "absent": "not-wired", "because": "nobody asked for it"}
LIMITED = {"claim": "limited", "how": "native", "limit": {"sources": ["wire"]}, "because": "only gaps are seen"}

CONTROL = Control(reference="passes 40 of 40", planted='planted defect "fires late" is caught', ok=True)


def declare(
    name: str = "demo", *, title: str = "Demo", adapter: str = "", kind: str = "library",
    events: Mapping[EventKind, Mapping[str, Any]] | None = None, known: Iterable[Known] = (), **fields: Any,
) -> Declaration:  # fmt: skip
    """A declaration that claims all five events unless ``events`` says otherwise."""
    sections = {one.label: dict(CLAIMED) for one in EventKind}
    sections |= {one.label: dict(section) for one, section in (events or {}).items()}
    data = {
        "schema": 1, "name": name, "title": title, "adapter": adapter or f"nros_backends.{name}:Backend",
        "subject": {"kind": kind, "says": f"the {title} library on loopback"}, "events": sections, **fields,
    }  # fmt: skip
    declaration = msgspec.convert(data, Declaration, dec_hook=lambda type_, value: type_.parse(value))
    return msgspec.structs.replace(declaration, known=list(known))


def known(requirement: str, scenario: str, key: str = "D1", **fields: Any) -> Known:
    """A ``[[known]]`` entry."""
    defaults: dict[str, Any] = {"cause": "middleware", "because": "it was always so", "link": "unreported"}
    return Known(key=key, requirement=requirement, scenario=scenario, **(defaults | fields))


def finding(*proves: str, outcome: Outcome = "pass", implied: bool = False, name: str = "") -> Finding:
    """A finding about these requirements."""
    return Finding(name=name or f"expectation {' '.join(proves)}", proves=proves, outcome=outcome, implied=implied)


def result(
    key: str, *proves: str, outcome: Outcome = "pass", findings: Iterable[Finding] | None = None,
    verdict: VerdictName | None = None, status: Status = "played", reason: str = "", **fields: Any,
) -> ScenarioResult:  # fmt: skip
    """A scenario with one finding per requirement, all with the same outcome, unless ``findings`` are given."""
    found = tuple(findings) if findings is not None else tuple(finding(one, outcome=outcome) for one in proves)
    if verdict is None:
        outcomes = {one.outcome for one in found}
        verdict = "fail" if "fail" in outcomes else "inconclusive" if "unclear" in outcomes else "pass"
    id_ = key.partition("[")[0]
    attempt = Attempt(
        number=1, T_ns=130_000_000, trace=f"traces/{key}.1.jsonl", seconds=0.5,
        verdict=Verdict(verdict=verdict, reason=reason, findings=found),
    )  # fmt: skip
    played = status == "played"
    return ScenarioResult(
        key=key, id=id_, suite=fields.pop("suite", "demo"), proves=proves, status=status,
        reason="" if played else reason, verdict=verdict if played else None, attempts=(attempt,) if played else (),
        **fields,
    )  # fmt: skip


def canonical(kind: EventKind, outcome: Outcome = "pass", **fields: Any) -> ScenarioResult:
    """The canonical stimulus of a kind."""
    return result(f"reg.raises-{kind.words.lower().replace(' ', '-')}", "REG-005", outcome=outcome,
                  canonical=kind.label, **fields)  # fmt: skip


def refusal(kind: EventKind, outcome: Outcome = "pass", **fields: Any) -> ScenarioResult:
    """The proof that a kind is absent."""
    return result(f"reg.absent-{kind.words.lower().replace(' ', '-')}", "REG-002", outcome=outcome,
                  refusal=kind.label, **fields)  # fmt: skip


def registered(kind: int, code: int = 0, case: Case = "right side", side: Any = "subscription") -> Observation:
    """An answer of ``register_event``."""
    return Observation(call="register", side=side, kind=kind, case=case, code=code)


def report(
    declaration: Declaration | None = None, results: Iterable[ScenarioResult] = (), *, variant: str = "",
    observations: Iterable[Observation] = (), **fields: Any,
) -> Report:  # fmt: skip
    """A report on suites 1.0, complete."""
    declaration = declaration or declare()
    defaults: dict[str, Any] = {
        "format": FORMAT, "tool": "0.1.0", "suites_version": "1.0", "digest": f"sha256:{'3f2a9c71' * 8}",
        "profile": "publish", "control": CONTROL,
    }  # fmt: skip
    return Report(
        row=declaration.name + (f"-{variant}" if variant else ""), backend=declaration.name, variant=variant,
        declaration=declaration, results=tuple(results), observations=tally(observations), **(defaults | fields),
    )  # fmt: skip


def everything(declaration: Declaration, *without: str) -> list[ScenarioResult]:
    """Passing scenarios: one per must and claim of the declaration, except for the requirements ``without``."""
    claims = {kind: declaration.event(kind).claim for kind in EventKind}
    found = [canonical(kind) if claim != "no" else refusal(kind) for kind, claim in claims.items()]
    return found + [
        result(f"all.{must.lower()}", must) for must in MUSTS if must not in without and must[:3] != "CON"
    ]  # fmt: skip


def answers(declaration: Declaration) -> list[Observation]:
    """What registering answers when it does what the declaration says."""
    found = []
    for kind in EventKind:
        code = -5 if declaration.event(kind).claim == "no" else 0
        found.append(registered(kind, code, side=kind.side.value))
        other = "publisher" if kind.side.value == "subscription" else "subscription"
        found.append(registered(kind, -5, "wrong side", other))
    found += [registered(kind, -5, "unknown kind") for kind in (-1, 5, 255)]
    return [*found, registered(RDM, -4, "no callback")]


def cyclone() -> Report:
    """One known deviation, one finding on a should, one limit, one gap; nothing on CON."""
    declaration = load_declaration(Path("cyclone/backend.toml"), CYCLONE)
    frozen = "lvc.frozen-idle-publisher-returns"
    results = [
        *everything(declaration, "LVC-009", "RDM-006"),
        result(frozen, "LVC-009", outcome="fail", known="C1"),
        result("lvc.lost-is-not-alive", "LVC-005", outcome="fail", verdict="warn"),
        result("rdm.clock-stepped[way=back]", "RDM-006", status="untested", reason="needs `libfaketime`"),
    ]
    return report(
        declaration, results, observations=answers(declaration),
        versions={"cyclonedds": "11.0.1", "python": "3.11", "nros-conformance": "0.1.0"},
    )  # fmt: skip


def uorb() -> Report:
    """One event; the base rules that apply without the others; one violation that nobody has declared."""
    declaration = load_declaration(Path("uorb/backend.toml"), UORB)
    results = [
        *everything(declaration, "DSP-007", "DSP-010", "MSL-003"),
        result("dsp.has-data", "DSP-010", outcome="fail"),
        result("msl.two-publishers", "MSL-003", outcome="unclear"),
    ]
    return report(declaration, results, observations=answers(declaration), clock="virtual", versions={"python": "3.11"})


def reference() -> Report:
    """The control: exercises what no row can."""
    declaration = declare("reference", title="Reference", control=True)
    return report(declaration, everything(declaration))


CYCLONE = """
schema  = 1
name    = "cyclone"
title   = "Cyclone DDS"
adapter = "nros_backends.cyclone:CycloneBackend"

[subject]
kind    = "library"
says    = "Eclipse Cyclone DDS under an adapter of this project, two participants on loopback"
not     = "nano-ros' compiled backend nros-rmw-cyclonedds (event slots NULL in 0.5.0)"
package = "cyclonedds"
range   = ">=11,<12"
pinned  = { by = "nano-ros 0.5.0", version = "0.10.5-nros1" }
install = 'pip install "nros-conformance[cyclone]"'

[events.LivelinessChanged]
claim = "yes"
how   = "polled"

[events.RequestedDeadlineMissed]
claim = "yes"
how   = "polled"

[events.MessageLost]
claim = "limited"
how   = "polled"
limit = { sources = ["wire"] }
because = "a sample replaced in a full KEEP_LAST queue is not lost in DDS"
link  = "https://github.com/eclipse-cyclonedds/cyclonedds/issues/1798"

[events.LivelinessLost]
claim = "yes"
how   = "polled"

[events.OfferedDeadlineMissed]
claim = "yes"
how   = "polled"

[connection]
ping = "no"
absent = "never"
because = "DDS has no round trip that an application can ask for"

[notes]
MessageLost = "C2"
ping = "C3"

[[known]]
key         = "C1"
requirement = "LVC-009"
scenario    = "lvc.frozen-idle-publisher-returns"
cause       = "middleware"
because     = "an idle AUTOMATIC publisher frozen past its lease is not alive again until it publishes"
link        = "unreported"
versions    = "==11.0.1"
"""

UORB = """
schema  = 1
name    = "uorb"
title   = "uORB"
adapter = "nros_backends.uorb:UorbBackend"

[subject]
kind    = "model"
says    = "this project's model of the bus of PX4"
held_to = [{ what = "PX4 v1.15 recordings", in = "tests/vectors/uorb" }]
pinned  = { by = "nano-ros 0.5.0", version = "PX4 of the integrator" }

[events.LivelinessChanged]
claim   = "no"
absent  = "never"
because = "the bus has no liveliness"
link    = "https://docs.px4.io/main/en/middleware/uorb.html"

[events.LivelinessLost]
claim   = "no"
absent  = "never"
because = "the bus has no liveliness"
link    = "https://docs.px4.io/main/en/middleware/uorb.html"

[events.RequestedDeadlineMissed]
claim   = "no"
absent  = "not-wired"
because = "the bus has no rate; a clock in the adapter could do it"

[events.OfferedDeadlineMissed]
claim   = "no"
absent  = "not-wired"
because = "the bus has no rate; a clock in the adapter could do it"

[events.MessageLost]
claim = "yes"
how   = "generations"

[connection]
ping = "no"
absent = "never"
because = "there is no peer"
link = "https://docs.px4.io/main/en/middleware/uorb.html"

[behaviour]
clock = "virtual"
"""
