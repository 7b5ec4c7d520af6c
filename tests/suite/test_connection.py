"""Steps about the connection: what they must keep to, and how repeats count."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from nros_conformance.suite import schema
from nros_conformance.suite.loader import Loaded
from nros_conformance.suite.walk import steps

TEXT = """\
  - id: con.sample
    title: A sample
    peer: absent
    sessions:
      pub: {{reconnector: true, lease: 2T, hard_liveliness: 0}}
    entities:
      talker: {{publisher: sensor}}
      listener: {{subscription: sensor, take: always}}
      other: {{subscription: sensor}}
    script:
      - {{do: publish, by: talker}}
      - {step}
    expect:
      - {{received: data, of: listener, proves: RDM-001}}
"""

GOOD = """\
  - id: con.sample
    title: A sample
    needs: {declares: {peer: [agent, router], hard_liveliness.claim: "yes"}}
    entities:
      talker: {publisher: sensor}
      listener: {subscription: sensor, take: always}
    script:
      - repeat: 3
        script:
          - {fault: stop, kill: true, as: down}
          - {fault: start}
          - {until: heard, by: talker, of: listener, limit: 3T, as: flow}
          - {do: publish, by: talker, times: 2, as: data}
      - {do: ping, timeout: 1T, attempts: 2, as: asked}
      - {do: measure, what: listed, of: talker, as: there}
      - {do: drive, timeout: 1T, at: "data[5].end"}
    expect:
      - {returns: flow, is: [true], proves: RDM-001}
      - {returns: asked, is: [OK], proves: RDM-001}
      - {counted: there, is: 1, proves: RDM-001}
"""

Message = Callable[[str], str]


def test_the_steps_of_a_repeat_are_steps_of_the_scenario(scenarios: Callable[[str], tuple[Loaded, ...]]) -> None:
    (one,) = scenarios(GOOD)
    assert [path for path, step in steps(one.scenario) if isinstance(step, schema.Fault)] == [
        ("script", 0, "script", 0),
        ("script", 0, "script", 1),
    ]
    assert one.scenario.peer == "present"


def test_a_repeat_multiplies_the_actions_of_a_label(message: Message) -> None:
    assert message(GOOD.replace("data[5]", "data[6]")).endswith(
        "at: there is no moment 'data[6].end': 'data' happens 6 times"
    )


def test_a_repeat_waits_for_nothing_after_it(message: Message) -> None:
    text = GOOD.replace("limit: 3T, as: flow}", "limit: 3T, as: flow, at: asked}")
    assert "at: the step waits for itself: flow -> asked -> " in message(text)


@pytest.mark.parametrize(("step", "says"), [
    ("{until: heard, by: talker, limit: 1T}", "heard without of:; add of:"),
    ("{until: heard, by: talker, of: other, limit: 1T}",
        "of: 'other' takes nothing by itself; add take: always to the entity"),
    ("{until: heard, by: other, of: listener, limit: 1T}", "by: 'other' is a subscription; name a publisher"),
    ("{until: reported, limit: 1T}", "reported without session:; add session:"),
    ("{until: reachable, session: pub, limit: 1T}", "session: reachable has no use for it; remove it"),
    ("{until: connected, session: sub, limit: 1T}", "session: 'sub' has no reconnector; add reconnector: true"),
    ("{until: connected, session: sup, limit: 1T}", "unknown session 'sup'; did you mean 'sub'?"),
    ("{repeat: 0, script: [settle]}", "repeat: 0 is less than 1"),
    ("{repeat: 2, script: []}", "repeat without a step; add one or more to its script:"),
    ("{do: ping, session: sup, timeout: 1T}", "unknown session 'sup'; did you mean 'sub'?"),
    ("{do: ping, timeout: 1T, attempts: 0}", "attempts: 0 is less than 1"),
    ("{do: measure, what: listed}", "listed without of:; add of: and an entity"),
    ("{do: measure, what: probes, of: talker}", "of: probes is of no single entity; remove it"),
    ("{fault: stop, of: sub}", "of: stop is about the peer, which has no name; remove it"),
    ("{fault: start, kill: true}", "kill: start ends no peer; remove it"),
])  # fmt: skip
def test_what_a_step_about_the_connection_lacks(message: Message, step: str, says: str) -> None:
    assert message(TEXT.format(step=step)).removeprefix("suites/sample.yaml:15: ") == says


def test_counted_wants_a_number(message: Message) -> None:
    assert message(GOOD.replace("counted: there, is: 1,", "counted: there,")).endswith(
        "counted without a number; add is:, at_least: or at_most:"
    )
