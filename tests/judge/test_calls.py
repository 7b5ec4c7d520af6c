from __future__ import annotations

from typing import Any

import pytest

from nros_conformance.trace.records import Measure, Starved
from tests.judge.build import act, call, finding, ms, register, spin, state, take, verdict


def answer(result: Any, op: str = "register", raised: str = "", index: int = 0) -> Any:
    return act("a", 10 + index, op=op, entity="listener", session="sub", result=result, raised=raised, index=index)


@pytest.mark.parametrize(
    ("record", "words", "outcome"),
    [
        (take("a", 200, -10), ["DATA"], "unclear"),
        (take("a", 200, 2), ["NO_DATA"], "unclear"),
        (take("a", 200, -1), ["DATA"], "fail"),  # an error says nothing of arrival
        (act("a", 200, op="has_data", entity="listener", session="sub", result=False), ["true"], "unclear"),
        (act("a", 200, op="ping", session="sub", result=-2), ["OK"], "unclear"),
        (act("a", 200, op="register", entity="listener", session="sub", result=-5), ["OK"], "fail"),
    ],
)
def test_what_has_not_come_while_threads_of_the_backend_had_no_core_is_unclear(
    record: Any, words: list[str], outcome: str
) -> None:
    starved = Starved(begin=ms(150), end=ms(180), wait=ms(50) - ms(0))
    found = finding({"returns": "a", "is": words}, starved, record)
    assert found.outcome == outcome
    assert ("had to wait 50 ms for a core" in found.got) == (outcome == "unclear")
    assert finding({"returns": "a", "is": words}, record).outcome == "fail"


@pytest.mark.parametrize(("what", "outcome"), [("listed", "unclear"), ("probes", "unclear"), ("memory", "fail")])
def test_what_the_peer_counted_wrong_while_threads_had_no_core_is_unclear(what: str, outcome: str) -> None:
    records = [
        Measure(label="a", what=what, value=1, begin=ms(200), end=ms(200)),
        act("a", 200, op="measure", entity="listener", session="sub"),
    ]
    starved = Starved(begin=ms(150), end=ms(180), wait=ms(50) - ms(0))
    assert finding({"counted": "a", "is": 0}, *records).outcome == "fail"
    assert finding({"counted": "a", "is": 0}, starved, *records).outcome == outcome
    assert finding({"counted": "a", "is": 1}, starved, *records).outcome == "pass"


@pytest.mark.parametrize(
    ("record", "words", "outcome", "got"),
    [
        (answer(0), ["OK"], "pass", "OK (0)"),
        (answer(-5), ["OK"], "fail", "UNSUPPORTED (-5)"),
        (answer(-5), ["UNSUPPORTED", "INVALID_ARGUMENT"], "pass", "UNSUPPORTED (-5)"),
        (answer(-19), ["ANY_ERROR"], "pass", "INVALID_CONFIG (-19)"),
        (answer(-77), ["ANY_ERROR"], "fail", "unpublished code -77"),
        (answer(0), ["ANY_ERROR"], "fail", "OK (0)"),
        (answer(None), ["OK"], "fail", "nothing"),
        (answer(None, raised="ValueError: no"), ["ANY_ERROR"], "fail", "raised: ValueError: no"),
        (answer(True, "supports"), ["true"], "pass", "true"),
        (answer(True, "supports"), ["false"], "fail", "true"),
        (answer(False, "has_data"), ["OK"], "fail", "false"),
        (answer(True, "has_data"), ["OK"], "fail", "true"),
        (take("a", 10, 3), ["DATA"], "pass", "3 samples"),
        (take("a", 10, 1), ["OK"], "fail", "1 sample"),
        (take("a", 10, -10), ["NO_DATA"], "pass", "NO_DATA (-10)"),
        (take("a", 10, 0), ["NO_DATA"], "pass", "0 samples"),
        (take("a", 10, 0), ["DATA", "OK"], "fail", "0 samples"),
        (take("a", 10, -12), ["DATA"], "fail", "BUFFER_TOO_SMALL (-12)"),
        (answer(0), ["DATA"], "fail", "OK (0)"),
    ],
)
def test_returns(record: Any, words: list[str], outcome: str, got: str) -> None:
    found = finding({"returns": "a", "is": words}, record)
    assert found.wanted == f"a answers {' or '.join(words)}"
    assert (found.name, found.outcome, found.got) == ("returns a", outcome, got)


def test_every_one_of_several_has_to_answer_so() -> None:
    two = [answer(0), answer(-5, index=1)]
    found = finding({"returns": "a", "is": ["OK"]}, two)
    assert (found.outcome, found.got) == ("fail", "a[1] answered UNSUPPORTED (-5)")
    assert finding({"returns": "a", "is": ["OK", "UNSUPPORTED"]}, two).got == "OK (0), UNSUPPORTED (-5)"


def test_some() -> None:
    expect = {"returns": "a", "is": ["ANY_ERROR"], "some": True}
    found = finding(expect, answer(0), answer(-2, index=1))
    assert (found.outcome, found.wanted, found.got) == ("pass", "one of a answers ANY_ERROR", "TIMEOUT (-2)")
    assert finding(expect, answer(0), answer(0, index=1)).outcome == "fail"
    cut = verdict(expect, answer(0), outcome=None)
    assert cut.verdict == "inconclusive"
    assert cut.findings[0].outcome == "unclear"


def test_the_answer_of_a_creation() -> None:
    expect = {"returns": "listener", "is": ["INCOMPATIBLE_QOS"]}
    assert finding(expect, state("refused", 10, "listener", code=-6)).outcome == "pass"
    found = finding(expect, state("created", 10, "listener"))
    assert (found.outcome, found.got) == ("fail", "OK (0)")


def test_nothing_was_called() -> None:
    found = finding({"returns": "a", "is": ["OK"]})
    assert (found.outcome, found.got) == ("none", "there is no a in the trace")


def test_an_answer_that_there_is_not() -> None:
    result = verdict({"returns": "a", "is": ["OKAY"]}, answer(0))
    assert (result.verdict, result.reason) == (
        "error",
        "there is no answer OKAY; see the return codes, ANY_ERROR, true, false and DATA",
    )


@pytest.mark.parametrize(
    ("asked", "code", "outcome"),
    [(True, 0, "pass"), (False, -5, "pass"), (False, -4, "pass"), (True, -5, "fail"), (False, 0, "fail")],
)
def test_agrees(asked: bool, code: int, outcome: str) -> None:
    found = finding({"agrees": "a", "with": "reg"}, answer(asked, "supports"), register("reg", 20, result=code))
    words = {0: "OK (0)", -4: "INVALID_ARGUMENT (-4)", -5: "UNSUPPORTED (-5)"}[code]
    assert found.name == "agrees a with reg"
    assert found.wanted == "a is true exactly when reg answers OK"
    assert (found.outcome, found.got) == (outcome, f"a {str(asked).lower()}, reg {words}")


def test_agrees_pair_by_pair() -> None:
    asked = [answer(True, "supports"), answer(False, "supports", index=1)]
    codes = [
        act("reg", 20 + n, op="register", entity="listener", session="sub", index=n, result=code, kind=n)
        for n, code in enumerate((0, -5))
    ]
    expect = {"agrees": "a", "with": "reg"}
    assert finding(expect, asked, codes).outcome == "pass"
    assert finding(expect, asked, codes[:1]).got == "2 answers of a, 1 of reg"
    assert finding(expect, asked, codes[:1]).outcome == "none"
    assert finding(expect, asked).got == "there is no reg in the trace"


TAKES = {"takes": "calls", "at_most": "1T + tolerance"}


@pytest.mark.parametrize(
    ("expect", "records", "outcome", "got", "nearest"),
    [
        (TAKES, [call("calls", 0, 130)], "pass", "130 ms", None),
        (TAKES, [call("calls", 0, 90), call("calls", 100, 220, index=1)], "pass", "90 ms to 120 ms", None),
        (TAKES, [call("calls", 0, 135)], "fail", "calls[0] at 0.0 ms took 135 ms", 5),
        (
            TAKES,
            [spin(0, 134, wait=10), call("calls", 0, 135)],
            "unclear",
            "calls[0] at 0.0 ms took 135 ms, of which it may have waited 10 ms for a processor",
            5,
        ),
        (TAKES, [spin(0, 134, wait=4), call("calls", 0, 135)], "fail", "calls[0] at 0.0 ms took 135 ms", 5),
        (
            {"takes": "calls", "at_least": "0.8T"},
            [spin(0, 100), call("calls", 0, 100)],
            "pass",
            "100 ms",
            None,
        ),
        (
            {"takes": "calls", "at_least": "0.8T"},
            [spin(0, 1), call("calls", 0, 1), spin(2, 102), call("calls", 2, 102, index=1)],
            "fail",
            "calls[0] at 0.0 ms took 1 ms",
            -79,
        ),
        (
            {"takes": "calls", "at_least": "0.8T"},
            [spin(0, 100, wait=30), call("calls", 0, 100)],
            "unclear",
            "calls[0] at 0.0 ms took 100 ms, of which it may have waited 30 ms for a processor",
            -10,
        ),
        (TAKES, [act("calls", 0, 140, op="ping", wait=20)], "unclear",
         "calls[0] at 0.0 ms took 140 ms, of which it may have waited 20 ms for a processor", 10),
        (TAKES, [], "none", "there is no calls in the trace", None),
    ],
)  # fmt: skip
def test_takes(expect: Any, records: Any, outcome: str, got: str, nearest: float | None) -> None:
    found = finding(expect, records)
    assert (found.outcome, found.got) == (outcome, got)
    assert found.nearest_ns == (None if nearest is None else round(nearest * 1e6))


def test_takes_in_words() -> None:
    found = finding({"takes": "calls", "at_most": "1T", "at_least": "0.8T"}, call("calls", 0, 90))
    assert (found.name, found.wanted) == ("takes calls", "each call of calls takes at least 0.8T and at most 1T")


# --- admitted, measured ---------------------------------------------------------------------------

ADMITTED = {"admitted": "listener"}
ASKING: dict[str, Any] = {
    "talker": {"publisher": "sensor"},
    "listener": {
        "subscription": "sensor",
        "may_fail": True,
        "qos": {"lifespan": "1T", "liveliness": "manual_by_node", "depth": 129, "deadline": "infinite", "lease": "0"},
    },
}


@pytest.mark.parametrize(
    ("code", "unsupported", "outcome", "answer", "got"),
    [
        (0, [], "pass", "OK", "OK (0)"),
        (-6, [], "fail", "OK", "INCOMPATIBLE_QOS (-6)"),
        (-6, ["lifespan"], "pass", "INCOMPATIBLE_QOS for lifespan", "INCOMPATIBLE_QOS (-6)"),
        (0, ["lifespan"], "fail", "INCOMPATIBLE_QOS for lifespan", "OK (0)"),
        (-4, ["lifespan"], "fail", "INCOMPATIBLE_QOS for lifespan", "INVALID_ARGUMENT (-4)"),
        (
            -6,
            ["liveliness.manual_by_node", "deadline"],
            "pass",
            "INCOMPATIBLE_QOS for liveliness.manual_by_node",
            "INCOMPATIBLE_QOS (-6)",
        ),
        (
            -6,
            ["depth.above_128", "lifespan"],
            "pass",
            "INCOMPATIBLE_QOS for depth.above_128 and lifespan",
            "INCOMPATIBLE_QOS (-6)",
        ),
        (0, ["deadline", "lease", "depth.above_129", "liveliness.manual_by_topic", "weight"], "pass", "OK", "OK (0)"),
    ],
)
def test_admitted(code: int, unsupported: list[str], outcome: str, answer: str, got: str) -> None:
    made = state("created" if code == 0 else "refused", 10, "listener", code=code)
    found = finding(ADMITTED, made, entities=ASKING, declares={"unsupported": unsupported})
    assert (found.name, found.wanted) == ("admitted listener", f"creating listener answers {answer}")
    assert (found.outcome, found.got) == (outcome, got)


def test_admitted_without_a_creation() -> None:
    assert finding(ADMITTED, entities=ASKING).got == "listener was not created"


def cpu(label: str, value: float) -> Measure:
    return Measure(label=label, what="cpu", value=value, begin=ms(1), end=ms(1))


@pytest.mark.parametrize(
    ("grown_ms", "outcome", "got"), [(50, "pass", "50 ms"), (50.5, "fail", "50.5 ms"), (0, "pass", "0 ms")]
)
def test_measured(grown_ms: float, outcome: str, got: str) -> None:
    expect = {"measured": "cpu", "from": "before", "to": "after", "at_most": "0.5T"}
    found = finding(expect, cpu("before", 7e6), cpu("after", 7e6 + grown_ms * 1e6))
    assert found.name == "measured cpu from before to after"
    assert found.wanted == "cpu grows by at most 0.5T from before to after"
    assert (found.outcome, found.got) == (outcome, got)
    assert finding(expect, cpu("before", 7e6)).got == "there is no after in the trace"
