"""The laws of the judge, over traces of any kind."""

from __future__ import annotations

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from nros_conformance.judge.judge import judge
from nros_conformance.trace.records import Trace
from tests.judge.stories import narrowed, plays, stories, stretched

LAWS = settings(
    max_examples=800, derandomize=True, deadline=None, database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much],
)  # fmt: skip

CONCLUSIVE = ("pass", "warn", "fail", "none")


@LAWS
@given(stories() | plays(), st.integers(0, 2**32))
def test_what_is_certain_stays_so_wherever_things_lie_within_their_intervals(wide: Trace, seed: int) -> None:
    """Also read backwards: widening an interval only takes certainty away."""
    before, after = judge(wide), judge(narrowed(wide, seed))
    for old, new in zip(before.findings, after.findings, strict=True):
        if old.outcome != "unclear":
            assert (old.name, old.outcome) == (new.name, new.outcome)
    if before.verdict in CONCLUSIVE:
        assert before.verdict == after.verdict


@LAWS
@given(stories() | plays(), st.integers(0, 90))
def test_cutting_a_trace_short_never_fails_what_the_whole_does_not(whole: Trace, kept: int) -> None:
    before, after = judge(whole), judge(Trace(whole.header, whole.records[: min(kept, len(whole.records) - 1)]))
    for old, new in zip(before.findings, after.findings, strict=True):
        assert new.outcome != "pass" or not new.proves
        if new.outcome == "fail":
            assert (old.name, old.outcome) == (new.name, "fail")
    assert after.verdict in ("inconclusive", before.verdict)


@LAWS
@given(stories() | plays(), st.integers(2, 7))
def test_a_slower_story_gets_the_same_verdict(story: Trace, factor: int) -> None:
    before, after = judge(story), judge(stretched(story, factor))
    assert before.verdict == after.verdict
    for old, new in zip(before.findings, after.findings, strict=True):
        assert (old.name, old.outcome) == (new.name, new.outcome)
        assert new.nearest_ns == (old.nearest_ns if old.nearest_ns is None else old.nearest_ns * factor)


@LAWS
@given(stories() | plays())
def test_the_verdict_follows_from_the_findings(story: Trace) -> None:
    result = judge(story)
    outcomes = {one.outcome for one in result.findings}
    if result.verdict == "pass":
        assert "fail" not in outcomes
        assert any(one.outcome == "pass" for one in result.findings if one.proves and not one.implied)
    if result.verdict == "fail":
        assert any(one.outcome == "fail" for one in result.findings)
    assert (result.reason == "") == (result.verdict == "pass")
    assert all(one.wanted and one.got for one in result.findings if one.outcome in ("fail", "unclear") and one.proves)
