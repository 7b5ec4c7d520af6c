from __future__ import annotations

from typing import Any

import pytest

from tests.judge.build import ENTITIES, act, counted, finding, matched, publish, registered, spins, take, taken

ALL_OF = {"received": "data", "of": "listener"}
DATA = publish("data", 10, 20, 30, 40)
LATER = [spins(0, 100), take("last", 100, -10)]


@pytest.mark.parametrize(
    ("is_", "came", "outcome", "got"),
    [
        ("all", taken(90, 1, 2, 3, 4), "pass", "4 of 4"),
        ("all", taken(90, 1, 2, 4), "fail", "3 of 4, sample 3 of talker is missing"),
        ("all", taken(90, 1, 2, 3, 3, 4), "fail", "sample 3 of talker came twice, the second time at 90.0 ms"),
        ("all", taken(90, 1, 3, 2, 4), "fail", "sample 2 of talker came at 90.0 ms, after sample 3"),
        ("all", [], "fail", "0 of 4, sample 1 of talker is missing"),
        ("none", [], "pass", "0 of 4"),
        ("none", taken(90, 3), "fail", "1 sample, such as sample 3 of talker at 90.0 ms"),
        (2, taken(90, 3, 4), "pass", "2 of 4"),
        (2, taken(90, 2, 3, 4), "fail", "3 samples, such as sample 4 of talker at 90.0 ms"),
        (2, taken(90, 4), "fail", "1 of 4, sample 1 of talker is missing"),
    ],
)
def test_received(is_: Any, came: list[Any], outcome: str, got: str) -> None:
    found = finding(ALL_OF | {"is": is_}, DATA, came, LATER)
    assert (found.outcome, found.got) == (outcome, got)


@pytest.mark.parametrize(("is_", "amount"), [("all", "all samples"), ("none", "no sample"), (1, "1 sample")])
def test_received_in_words(is_: Any, amount: str) -> None:
    found = finding(ALL_OF | {"is": is_}, DATA, LATER)
    assert (found.name, found.wanted) == (
        "received data of listener",
        f"{amount} of data, in order and once, on listener",
    )


def test_samples_of_others_are_not_judged() -> None:
    others = [*taken(90, 9, label="other"), *taken(90, 0, label="", publisher="")]
    assert finding(ALL_OF, DATA, others, taken(90, 1, 2, 3, 4), LATER).outcome == "pass"


def test_order_is_kept_per_publisher() -> None:
    two = [*DATA[:1], act("data", 15, entity="other", index=1, sequence=1)]
    came = [*taken(90, 1, publisher="other"), *taken(90, 1)]
    entities = {**ENTITIES, "other": {"publisher": "sensor"}}
    assert finding(ALL_OF, two, came, LATER, entities=entities).outcome == "pass"


def test_what_answered_an_error_was_not_published() -> None:
    refused = [*DATA[:3], act("data", 40, index=3, sequence=4, result=-13)]
    assert finding(ALL_OF, refused, taken(90, 1, 2, 3), LATER).got == "3 of 3"
    nothing = [act("data", 40, sequence=1, result=-13)]
    found = finding(ALL_OF, nothing, LATER)
    assert (found.outcome, found.got) == ("none", "data answered MESSAGE_TOO_LARGE (-13)")
    assert finding(ALL_OF, LATER).got == "there is no data in the trace"


@pytest.mark.parametrize(
    "looks",
    [
        [spins(0, 60), take("last", 60, -10)],
        [spins(0, 100)],
        [take("last", 100, -10)],
        [spins(0, 100), take("last", 100, 2, limit=2)],
    ],
    ids=["too soon", "no take", "nobody drove", "a take with a limit"],
)
def test_missing_samples_that_nobody_looked_for(looks: list[Any]) -> None:
    found = finding(ALL_OF, DATA, looks)
    assert (found.outcome, found.got) == (
        "unclear",
        "0 of 4, sample 1 of talker is missing, and nobody looked for it later",
    )
    found = finding(ALL_OF | {"is": "none"}, DATA, looks)
    assert (found.outcome, found.got) == ("unclear", "0 of 4, and nobody looked for more later")


def test_what_is_missing_so_far_may_still_come() -> None:
    assert finding(ALL_OF, DATA, LATER, outcome=None).outcome == "unclear"
    assert finding(CONSERVED, played(1, 2, 9, 10), outcome=None).outcome == "unclear"
    assert finding(CONSERVED, played(1, 2, number=9), outcome=None).outcome == "unclear"


def test_taking_always_is_looking() -> None:
    always = {**ENTITIES, "listener": {"subscription": "sensor", "take": "always"}}
    assert finding(ALL_OF, DATA, spins(0, 100), entities=always).outcome == "fail"


def test_message_callbacks_are_looking() -> None:
    found = finding(ALL_OF, DATA, taken(50, 1, 2, 3, callback=True), spins(50, 100))
    assert (found.outcome, found.got) == ("fail", "3 of 4, sample 4 of talker is missing")


# --- conserved ------------------------------------------------------------------------------------

CONSERVED = {"conserved": "listener", "from": ["talker"]}


def lost(t: float, total: int, change: int, **more: Any) -> Any:
    return counted(t, total, change, kind="MessageLost", **more)


def played(*came: int, number: int = 0, at: float = 150) -> list[Any]:
    """Ten samples; what was taken of them at 100 ms, how many were reported lost."""
    return [
        publish("data", *range(10, 60, 5)),
        spins(0, 100),
        taken(100, *came),
        take("all", 100, len(came)),
        [lost(at, number, number)] if number else [],
        spins(100, 200),
    ]


@pytest.mark.parametrize(
    ("records", "outcome", "got"),
    [
        (played(*range(1, 11)), "pass", "10 received + 0 lost, 10 published"),
        (played(1, 2, 9, 10, number=6), "pass", "4 received + 6 lost, 10 published"),
        (played(1, 2, 9, 10, number=5), "fail", "4 received + 5 lost, 10 published"),
        (played(1, 2, 9, 10), "fail", "4 received + 0 lost, 10 published"),
        (played(1, 2, 9, 10, number=7), "fail", "4 received + 7 lost, 10 published"),
        (played(*range(1, 11), number=1), "fail", "10 received + 1 lost, 10 published"),
        (played(1, 2), "pass", "2 received + 0 lost, 2 published"),
        (played(1, 2, number=8), "pass", "2 received + 8 lost, 2 published"),
        (played(1, 2, number=9), "fail", "2 received + 9 lost, 2 published"),
        (played(2, 4, 4, 10, number=7), "pass", "3 received + 7 lost, 10 published"),
        (played(number=10), "none", "no sample was received"),
    ],
    ids=[
        "all", "some lost", "one too few", "none reported", "one too many", "none lost", "the rest on its way",
        "the rest lost", "more than the rest", "duplicates", "nothing received",
    ],
)  # fmt: skip
def test_conserved(records: list[Any], outcome: str, got: str) -> None:
    found = finding(CONSERVED, records)
    assert (found.name, found.wanted) == ("conserved listener", "received + lost = published by talker on listener")
    assert (found.outcome, found.got) == (outcome, got)


@pytest.mark.parametrize(("later", "outcome"), [([], "unclear"), ([matched(9, 10)], "fail")], ids=["never", "later"])
def test_samples_of_a_publisher_that_was_not_met_in_time_may_be_older_than_the_match(
    later: list[Any], outcome: str
) -> None:
    found = finding(CONSERVED, matched(0, 5, "timeout"), later, played(7, 8, 9, 10))
    assert found.outcome == outcome
    assert found.got == (
        "4 received + 0 lost, 10 published" if later else "talker and listener had not met within the discovery bound"
    )


def test_losses_that_there_was_no_call_to_report_in() -> None:
    found = finding(CONSERVED, played(1, 2, 9, 10)[:-1])
    assert (found.outcome, found.got) == (
        "unclear",
        "4 received + 0 lost, 10 published, and nobody drove it after the last take",
    )


def test_what_was_sent_before_since_is_history() -> None:
    before = publish("old", 1, 2, 3, first=1)
    later = publish("data", 20, 30, 40, first=4)
    came = [spins(0, 100), taken(100, 2, label="old"), taken(100, 4, 6), take("all", 100, 3)]
    expect = CONSERVED | {"since": "matched"}
    settled = act("matched", 10, 11, op="settle", entity="", session="")
    records = [lost(5, 2, 2), before, settled, later, came, lost(150, 3, 1), spins(100, 200)]
    found = finding(expect, records)
    assert found.wanted == "received + lost = published by talker on listener since matched"
    assert (found.outcome, found.got) == ("pass", "2 received + 1 lost, 3 published")


def test_a_sample_sent_while_since_happened_leaves_it_open() -> None:
    settled = act("matched", 10, 25, op="settle", entity="", session="")
    data = publish("data", 20, 30, 40)
    came = [spins(0, 100), taken(100, 2, 3), take("all", 100, 2), spins(100, 200)]
    found = finding(CONSERVED | {"since": "matched"}, settled, data, came)
    assert (found.outcome, found.got) == ("unclear", "sample 1 of talker was perhaps published before matched")


def test_of_several_publishers_together() -> None:
    entities = {**ENTITIES, "other": {"publisher": "sensor"}}
    both = [publish("data", 10, 20, 30), publish("more", 15, 25, 35, entity="other")]
    came = [taken(100, 1, 3), taken(100, 1, 3, publisher="other", label="more"), take("all", 100, 4)]
    records = [both, spins(0, 100), came, lost(150, 2, 2), spins(100, 200)]
    expect = CONSERVED | {"from": ["talker", "other"]}
    assert finding(expect, records, entities=entities).got == "4 received + 2 lost, 6 published"
    assert finding(expect, records, entities=entities).outcome == "pass"


def test_without_a_registration_nothing_is_known_about_losses() -> None:
    setup = [registered("MessageLost", code=-5)]
    found = finding(CONSERVED, played(1), setup=setup)
    assert (found.outcome, found.got) == ("fail", "register answered UNSUPPORTED (-5)")
    assert finding(CONSERVED, played(1), setup=setup, claims={"MessageLost": "no"}).outcome == "none"
