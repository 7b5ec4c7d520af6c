"""Every suite on the C example: one scenario of each name, and nothing fails."""

from __future__ import annotations

from pathlib import Path

import msgspec

from nros_backends.native.draft import ADAPTER
from nros_backends.native.options import Options
from nros_conformance.campaign.plans import Row
from nros_conformance.campaign.run import AT_ONCE, RowRun
from nros_conformance.campaign.selection import Selection, decide
from nros_conformance.report.evidence import proofs_of
from nros_conformance.rmw.declaration import Declaration
from nros_conformance.suite.loader import load_suites


def test_the_example_passes_all_suites(loopback: Path, declared: Declaration, tmp_path: Path) -> None:
    roomy = msgspec.structs.replace(declared, bounds=msgspec.structs.replace(declared.bounds, sessions=2 * AT_ONCE))
    options = Options(str(loopback), name="loopback", supports=frozenset(range(5)))
    row = Row(roomy, ADAPTER, options=options.texts())
    suites = load_suites()
    keys = {
        one.scenario.id: one.key
        for one in Selection().choose(suites)
        if decide(one, roomy).status == "play" and one.scenario.needs.process == "shared"
    }
    selection = Selection(keys=frozenset(keys.values()))
    run = RowRun(row, suites, selection, tmp_path, ports=range(0), control=None, watch=lambda _: None)
    report = run.play()
    assert {one.key: one.verdict for one in report.results if one.verdict not in ("pass", "inconclusive")} == {}
    assert report.incidents == ()
    assert {one.suite for one in suites.scenarios if one.key in keys.values()} == {
        one.suite for one in suites.scenarios
    }
    holds = {id_ for one in report.results for id_, proof in proofs_of(one) if proof.outcome == "pass"}
    assert {"LIF-002", "LIF-003", "LIF-004", "DSP-004", "REG-007"} <= holds
