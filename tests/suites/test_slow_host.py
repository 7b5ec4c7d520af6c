"""However slow the host is, a right backend does not fail: `benchmarks/verdicts.py` plays more of the same."""

from __future__ import annotations

import functools

import pytest

from nros_conformance.campaign.plans import Row
from nros_conformance.campaign.selection import Selection, decide
from nros_conformance.suite.loader import Suites, load_suites
from tests.suites.slow_host import play_slowly, reference_row

HOSTS = {"often for short": (0.03, 1.5), "seldom for long": (0.004, 6.0)}
"""The chance of standing still, and for how many times T at most."""


@functools.cache
def prepared() -> tuple[Suites, Row]:
    return load_suites(), reference_row()


@pytest.mark.parametrize("suite", sorted({one.suite for one in load_suites().scenarios}))
@pytest.mark.parametrize("host", HOSTS)
def test_the_reference_never_fails_on_a_slow_host(suite: str, host: str) -> None:
    suites, row = prepared()
    chosen = [
        one for one in Selection("standard", (suite,)).choose(suites) if decide(one, row.declaration).status == "play"
    ]
    found = {one.key: play_slowly(one, row, suites, 1, *HOSTS[host]) for one in chosen}
    failed = {key: verdict.reason for key, verdict in found.items() if verdict.verdict not in ("pass", "inconclusive")}
    assert chosen
    assert not failed
    passed = sum(verdict.verdict == "pass" for verdict in found.values())
    assert passed > 0.5 * len(found)  # or nothing of this was judged
