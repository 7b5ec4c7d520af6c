"""However slow the host is, a right backend does not fail: `benchmarks/verdicts.py` plays more of the same."""

from __future__ import annotations

import functools
from pathlib import Path

import pytest

from nros_conformance.campaign.plans import Row, make_plan
from nros_conformance.campaign.selection import Selection, decide
from nros_conformance.play.adapters import load_adapter
from nros_conformance.suite.loader import Suites, load_suites
from tests.suites.slow_host import HOSTS, play_slowly, reference_row


@functools.cache
def prepared() -> tuple[Suites, Row]:
    return load_suites(), reference_row()


@pytest.mark.parametrize("suite", sorted({one.suite for one in load_suites().scenarios}))
@pytest.mark.parametrize("host", ["often for short", "seldom for long"])
def test_the_reference_never_fails_on_a_slow_host(suite: str, host: str) -> None:
    suites, row = prepared()
    chosen = [
        one for one in Selection("standard", (suite,)).choose(suites) if decide(one, row.declaration).status == "play"
    ]
    adapter, plans = load_adapter(row.adapter), [make_plan(one, row, suites, Path()) for one in chosen]
    found = {plan.key: play_slowly(plan, adapter, 1, *HOSTS[host]) for plan in plans}
    failed = {key: verdict.reason for key, verdict in found.items() if verdict.verdict not in ("pass", "inconclusive")}
    assert chosen
    assert not failed
    passed = sum(verdict.verdict == "pass" for verdict in found.values())
    assert passed > 0.5 * len(found)  # or nothing of this was judged
