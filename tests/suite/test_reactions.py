from __future__ import annotations

from collections.abc import Callable

import pytest

from nros_conformance.suite.kinds import claims_needed, registered_kinds
from nros_conformance.suite.loader import Loaded
from nros_conformance.suite.schema import Publish, Raise
from nros_conformance.suite.walk import steps

GOOD = """\
  - id: rdm.sample
    title: A sample
    entities:
      talker: {publisher: sensor}
      listener: {subscription: sensor}
      echo: {publisher: answer, session: sub}
    react:
      - to: RequestedDeadlineMissed
        of: listener
        times: 2
        script:
          - {do: publish, by: echo, times: 2, as: answered}
          - {do: drive, timeout: 1T}
          - {do: raise, as: boom}
    script:
      - {drive: 2T}
    expect:
      - {returns: answered, is: [OK], proves: RDM-001}
"""
PUBLISH = "{do: publish, by: echo, times: 2, as: answered}"
DRIVE = "{do: drive, timeout: 1T}"


def test_a_reaction_has_typed_steps_whose_labels_can_be_referred_to(
    scenarios: Callable[[str], tuple[Loaded, ...]],
) -> None:
    (one,) = scenarios(GOOD)
    (reaction,) = one.scenario.react
    assert [type(step).__name__ for step in reaction.script] == ["Publish", "Call", "Raise"]
    assert [step.as_ for _, step in steps(one.scenario) if isinstance(step, (Publish, Raise))] == ["answered", "boom"]


def test_what_a_callback_reacts_to_is_registered_and_has_to_be_claimed(
    scenarios: Callable[[str], tuple[Loaded, ...]],
) -> None:
    (one,) = scenarios(GOOD)
    assert registered_kinds(one.scenario, "listener") == ["RequestedDeadlineMissed"]
    assert claims_needed(one.scenario) == {"RequestedDeadlineMissed"}


def test_a_step_of_a_reaction_may_depend_on_a_parameter(scenarios: Callable[[str], tuple[Loaded, ...]]) -> None:
    varied = GOOD.replace("    entities:\n", "    for: {n: [1, 2]}\n    entities:\n").replace(
        DRIVE, "{do: drive, timeout: 1T, when: {n: 2}}"
    )
    assert [len(one.scenario.react[0].script) for one in scenarios(varied)] == [2, 3]


@pytest.mark.parametrize(("good", "bad", "expected"), [
    ("of: listener\n", "of: lisener\n", "12: unknown entity 'lisener'; did you mean 'listener'?"),
    (
        "of: listener\n", "of: echo\n",
        "12: RequestedDeadlineMissed is an event of a subscription, 'echo' is a publisher; name a subscription",
    ),
    ("times: 2\n", "times: 0\n", "13: times: 0 is less than 1"),
    (PUBLISH, "{drive: 1T, as: answered}", "15: a callback cannot do a step with drive:; leave it to the script:"),
    (
        PUBLISH, "{do: spin, timeout: 0, as: answered}",
        "15: a callback cannot do a step with do: spin; leave it to the script:",
    ),
    (
        PUBLISH, "{do: publish, by: echo, at: start, as: answered}",
        "15: at: a callback does its steps at once; remove it",
    ),
    (
        PUBLISH, "{do: publish, by: echo, times: 2, every: 1T, as: answered}",
        "15: every: a callback does its steps at once; remove it",
    ),
    (
        PUBLISH, f"{{do: raise, as: early}}\n          - {PUBLISH}",
        "15: nothing happens after do: raise; make it the last step",
    ),
    (
        "by: echo", "by: talker",
        "15: by: the callback runs on the session 'sub', and this is of 'pub'; "
        "it can only call what is of its own session",
    ),
    (
        DRIVE, "{do: drive, session: pub, timeout: 1T}",
        "16: session: the callback runs on the session 'sub', and this is of 'pub'; "
        "it can only call what is of its own session",
    ),
    (
        DRIVE, "{do: destroy, of: pub}",
        "16: of: the callback runs on the session 'sub', and this is of 'pub'; "
        "it can only call what is of its own session",
    ),
    (
        "      - {drive: 2T}\n", "      - {drive: 2T}\n      - {do: raise}\n",
        "20: only a callback can raise; write it under react:",
    ),
    (
        "{drive: 2T}", "{drive: 2T, at: boom + 1T}",
        "19: at: 'boom' may never happen; wait for a step of the script",
    ),
])  # fmt: skip
def test_what_a_callback_cannot_do(message: Callable[[str], str], good: str, bad: str, expected: str) -> None:
    assert good in GOOD
    assert message(GOOD.replace(good, bad)) == f"suites/sample.yaml:{expected}"


def test_a_reaction_does_something(message: Callable[[str], str]) -> None:
    start, end = GOOD.index("        script:\n"), GOOD.index("    script:\n      - {drive")
    empty = GOOD[:start] + "        script: []\n" + GOOD[end:]
    assert message(empty) == "suites/sample.yaml:11: a reaction that does nothing; add a step to its script:"
