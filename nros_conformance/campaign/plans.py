"""From a scenario and a declaration to a plan that a worker can play."""

from __future__ import annotations

import dataclasses
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from nros_conformance.campaign.selection import proven
from nros_conformance.judge.tolerances import smallest_T, tolerances
from nros_conformance.play.plan import HANG_NS, Plan, expected_ns
from nros_conformance.rmw.clock import NEVER
from nros_conformance.rmw.declaration import Declaration
from nros_conformance.suite.loader import Loaded, Suites
from nros_conformance.trace.records import Header

ATTEMPTS = 3
"""An inconclusive scenario is played again with T doubled, then doubled again; a fail is final."""


@dataclasses.dataclass(frozen=True, slots=True)
class Row:
    """A backend in one of its variants: what becomes a row of the matrix."""

    declaration: Declaration
    adapter: str
    variant: str = ""
    versions: Mapping[str, str] = dataclasses.field(default_factory=dict)
    options: Mapping[str, str] = dataclasses.field(default_factory=dict)
    lacking: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """The faults that cannot be injected with these options, and why."""

    clock: str = ""
    """Another clock than the declared one; the control plays the reference on the real one too."""
    provisional: str = ""
    """Why it cannot be published, whatever it shows; empty when it can."""

    asked: str = ""
    """The name by which the command finds the backend, if not its own: ``module:Class``."""

    @property
    def name(self) -> str:
        """The folder of its results."""
        return f"{self.declaration.name}-{self.variant}" if self.variant else self.declaration.name

    @property
    def virtual(self) -> bool:
        """Whether it is played on a virtual clock."""
        return (self.clock or self.declaration.behaviour.clock) == "virtual"


def make_plan(
    one: Loaded, row: Row, suites: Suites, folder: Path, *, attempt: int = 1, stretch: int = 1,
    ports: range = range(0), patience: float = 1,
) -> Plan:  # fmt: skip
    """A plan for one attempt; ``stretch`` multiplies T, ``folder`` is where the row's traces go.

    ``patience`` multiplies how long a call may take before it counts as hanging.
    """
    declaration = row.declaration
    clock: Literal["real", "virtual"] = "virtual" if row.virtual else "real"
    bounds = declaration.quantities()
    scale = max(one.scenario.scale.T.ns(bounds), smallest_T(clock, declaration.bounds.min_deadline.ns({}))) * stretch
    late, early = tolerances(clock, scale)
    quantities = {"T": scale, "tolerance": late, "early": early, **bounds}
    header = Header(
        scenario=one.raw,
        suite=one.suite,
        source=one.source,
        parameters=one.parameters,
        levels={id_: suites.requirements.level(id_) for id_ in proven(one)},
        digest=suites.digest,
        backend=declaration.name,
        variant=row.variant,
        subject=declaration.subject.kind,
        versions=dict(row.versions),
        claims={label: str(claim) for label, claim in declaration.claims().items()},
        declares=declaration.capabilities(),
        clock=clock,
        quantities=quantities,
        attempt=attempt,
        host=socket.gethostname(),
        start=0,
    )
    return Plan(
        key=one.key,
        adapter=row.adapter,
        header=header,
        trace=str(folder / f"{one.key.replace('/', '_')}.{attempt}.jsonl"),
        ports=(ports.start, ports.stop),
        options=dict(row.options),
        expected_ns=expected_ns(one.scenario.script, quantities),
        hang_ns=int(min(HANG_NS * patience, NEVER // 4)),
    )
