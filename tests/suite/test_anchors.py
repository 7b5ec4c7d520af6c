from __future__ import annotations

from collections.abc import Callable

import pytest

Message = Callable[[str], str]

CIRCLES = [
    ("[{drive: 1T, at: a, as: a}]", "5: at: the step waits for itself: a -> a; begin it at an earlier moment"),
    (
        "[{drive: 1T, at: a.begin + 1T, as: a}]",
        "5: at: the step waits for itself: a -> a; begin it at an earlier moment",
    ),
    (
        "[{drive: 1T, at: b, as: a}, {drive: 1T, as: b}]",
        "5: at: the step waits for itself: a -> b -> a; begin it at an earlier moment",
    ),
    (
        "[{drive: 1T, at: c, as: a}, settle, {drive: 1T, as: c}]",
        "5: at: the step waits for itself: a -> c -> the step in line 5 -> a; begin it at an earlier moment",
    ),
    ("[{drive: 1T, at: end, as: a}]", "5: at: the step waits for itself: a -> end -> a; begin it at an earlier moment"),
    (
        "[{parallel: [[{drive: 1T, at: b, as: a}], [{drive: 1T, at: a, as: b}]]}]",
        "5: at: the step waits for itself: a -> b -> a; begin it at an earlier moment",
    ),
    (
        "[{as: p, parallel: [[{drive: 1T, at: p.end, as: a}]]}]",
        "5: at: the step waits for itself: a -> p -> a; begin it at an earlier moment",
    ),
    (
        "[{parallel: [[{drive: 1T, at: z, as: a}], [settle]]}, {drive: 1T, as: z}]",
        "5: at: the step waits for itself: a -> z -> the step in line 5 -> a; begin it at an earlier moment",
    ),
    (
        "[{drive: 1T, at: late.created, as: a}, {do: create, entity: late, as: make}]",
        "5: at: the step waits for itself: a -> make -> a; begin it at an earlier moment",
    ),
    (
        "[{drive: 1T, at: b}, {drive: 1T, as: b}]",
        "5: at: the step waits for itself: the step in line 5 -> b -> the step in line 5; begin it at an "
        "earlier moment",
    ),
]

ANCHORED = """\
  - id: rdm.anchored
    script: {script}
    title: Anchors
    entities: {{late: {{subscription: sensor, deferred: true}}, listener: {{subscription: sensor}}}}
    expect: [{{never: ANY, of: ALL, proves: RDM-001}}]
"""


@pytest.mark.parametrize(("script", "expected"), CIRCLES)
def test_steps_that_wait_for_each_other(message: Message, script: str, expected: str) -> None:
    assert message(ANCHORED.format(script=script)) == f"suites/sample.yaml:{expected}"


@pytest.mark.parametrize(
    "script",
    [
        "[{drive: 1T, as: a}, {drive: 1T, at: a + 1T}]",
        "[{as: p, parallel: [[{drive: 1T, at: p.begin + 1T}]]}, {drive: 1T, at: p}]",
        "[{parallel: [[{drive: 1T, as: a}, {drive: 1T, at: b}], [{drive: 1T, at: a, as: b}]]}]",
        "[{parallel: [[{do: has_data, of: listener, times: 5, as: a}], [{drive: 1T, at: 'a[2]'}]]}]",
        "[{drive: 1T, at: start + 2T}, {do: create, entity: late, as: make}, {drive: 1T, at: late.created}]",
        "[{drive: 1T, at: 'listener.LivelinessChanged[0]'}]",
    ],
)
def test_steps_that_wait_for_earlier_ones(scenarios: Callable[[str], tuple[object, ...]], script: str) -> None:
    assert scenarios(ANCHORED.format(script=script))


@pytest.mark.parametrize(
    ("script", "expected"),
    [
        ("[{parallel: []}]", "parallel without a branch; add one or more, each a list"),
        ("[{parallel: [[]]}]", "parallel: an empty branch; fill it or remove it"),
        (
            "[{parallel: [[{drive: 1x}]]}]",
            "drive: unknown unit 'x' in the duration '1x'; known are ns, us, ms, s, min, h, "
            "T, tolerance, early, discovery_bound, connection_lease, hard_liveliness_timeout, hard_liveliness_grace",
        ),
        ("[{parallel: [{drive: 1T}]}]", "parallel: expected `array`, got `object`"),
    ],
)
def test_branches_that_cannot_be_played(message: Message, script: str, expected: str) -> None:
    assert message(ANCHORED.format(script=script)) == f"suites/sample.yaml:5: {expected}"
