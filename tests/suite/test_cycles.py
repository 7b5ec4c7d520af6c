from __future__ import annotations

import pytest

from tests.suite.test_errors import GOOD, Message

LINE = "      - {drive: 2T, as: silence}\n"
EXPECT = "    expect:\n"


@pytest.mark.parametrize(
    ("step", "expected"),
    [
        ("{cycle: 0, script: [settle]}", "cycle: 0 is less than 1"),
        ("{cycle: 2, script: []}", "cycle without a step; add one to its script:"),
        (
            "{cycle: 2, script: [{idle: 1T}]}",
            "a step with idle: cannot be repeated; write it before or after the cycle",
        ),
        (
            "{cycle: 2, script: [{drive: 1T, at: start + 1T}]}",
            "at: each cycle does its steps one after the other; remove it",
        ),
        ("{do: measure, what: threads}", "others share the process; add needs: {process: own}"),
        (
            "{do: released, registration: data}",
            "registration: 'data' is a step with do: publish; name one with do: register",
        ),
    ],
)  # fmt: skip
def test_steps(message: Message, step: str, expected: str) -> None:
    assert message(GOOD.replace(LINE, f"{LINE}      - {step}\n")).partition(": ")[2] == expected


@pytest.mark.parametrize(
    ("expectation", "expected"),
    [
        ("{cycles: loop, proves: RDM-001}", "cycles: says not what to expect; add one of step:, sampled: and event:"),
        ("{cycles: loop, step: inner, proves: RDM-001}", "cycles: is: belongs to step:; write both or neither"),
        ("{cycles: loop, event: MessageLost, proves: RDM-001}", "cycles: of: belongs to event:; write both or neither"),
        (
            "{cycles: data, step: inner, is: [OK], proves: RDM-001}",
            "cycles: 'data' is a step with do: publish; name one with cycle:",
        ),
        (
            "{cycles: loop, step: inner, is: [TIMEUT], proves: RDM-001}",
            "unknown answer 'TIMEUT'; did you mean 'TIMEOUT'?",
        ),
        (
            "{counted: data, is: 1, proves: RDM-001}",
            "counted: 'data' is a step with do: publish; name one with do: measure",
        ),
    ],
)  # fmt: skip
def test_expectations(message: Message, expectation: str, expected: str) -> None:
    loop = "      - {cycle: 2, as: loop, script: [{do: publish, by: talker, as: inner}]}\n"
    text = GOOD.replace(LINE, LINE + loop).replace(EXPECT, f"{EXPECT}      - {expectation}\n")
    assert message(text).partition(": ")[2] == expected
