from __future__ import annotations

from collections.abc import Callable

import pytest

from nros_conformance.formats.durations import Period
from nros_conformance.suite.injections import INJECTIONS, injectable, publishes
from nros_conformance.suite.loader import Loaded
from nros_conformance.suite.policies import unsupported
from nros_conformance.suite.schema import Fault, Qos

GOOD = """\
  - id: rdm.sample
    title: A sample
    needs: {process: own, clock: real}
    entities:
      talker: {publisher: sensor}
      listener: {subscription: sensor}
      odd: {subscription: sensor, may_fail: true}
    script:
      - {fault: lose, of: talker, count: 5, as: hole}
      - {fault: preset, of: listener, kind: MessageLost, count: 0}
      - {fault: preset, of: talker, count: 4294967293}
      - {fault: partition, of: pub}
      - {fault: block, of: pub, direction: out}
      - {fault: heal, of: pub}
      - {do: measure, what: cpu, as: before}
      - {do: measure, what: cpu, as: after}
      - {do: publish, by: talker, as: data}
    given:
      - {received: hole, of: listener, is: none}
      - {returns: hole, is: [OK]}
    expect:
      - {total: MessageLost, of: listener, at: 'hole[4]', is: 5, proves: RDM-001}
      - {measured: cpu, from: before, to: after, at_most: 1T, proves: RDM-001}
      - {admitted: odd, proves: RDM-001}
"""


def test_a_fault_that_publishes_is_referred_to_like_a_publish_step(
    scenarios: Callable[[str], tuple[Loaded, ...]],
) -> None:
    (one,) = scenarios(GOOD)
    assert [publishes(step) for step in one.scenario.script[:2]] == [True, False]


@pytest.mark.parametrize(("good", "bad", "expected"), [
    ("of: talker, count: 5", "of: listener, count: 5", "12: of: 'listener' is a subscription; name a publisher"),
    ("of: talker, count: 5", "of: pub, count: 5", "12: unknown entity 'pub'; valid are listener, odd, talker"),
    ("lose, of: talker, count", "lose, count", "12: lose without of:; add of: and a publisher"),
    ("of: talker, count: 5", "of: talker", "12: lose without count:; add count:"),
    ("count: 5", "count: 0", "12: count: 0 is less than 1"),
    ("MessageLost, count: 0", "MessageLost, count: -1", "13: count: -1 is less than 0"),
    ("count: 5,", "count: 5, kind: MessageLost,", "12: kind: lose is about no event; remove it"),
    (
        "of: listener, kind: MessageLost", "of: talker, kind: MessageLost",
        "13: MessageLost is an event of a subscription, 'talker' is a publisher; name a subscription",
    ),
    ("partition, of: pub", "partition, of: pbu", "15: unknown entity 'pbu'; did you mean 'pub'?"),
    ("of: pub, direction: out", "of: pub", "16: block without direction:; add direction:"),
    ("direction: out", "direction: aut", "16: direction: unknown value 'aut'; did you mean 'out'?"),
    ("'hole[4]'", "'hole[5]'", "25: at: there is no moment 'hole[5]': 'hole' happens 5 times"),
    (
        "    needs: {process: own, clock: real}\n", "    needs: {clock: real}\n",
        "18: others share the process; add needs: {process: own}",
    ),
    (
        "from: before", "from: data",
        "26: from: 'data' is a step with do: publish; name one with do: measure",
    ),
    ("measured: cpu, from: before", "measured: cpu, from: befor", "26: unknown label 'befor'; did you mean 'before'?"),
    ("admitted: odd", "admitted: listener", "27: admitted: 'listener' may not fail; add may_fail: true to the entity"),
    ("admitted: odd", "admitted: od", "27: unknown entity 'od'; did you mean 'odd'?"),
    (
        "{received: hole, of: listener", "{received: before, of: listener",
        "22: received: 'before' is a step with do: measure; name one with do: publish",
    ),
    (
        "{received: hole, of: listener", "{received: hole, of: talker",
        "22: of: 'talker' is a publisher; name a subscription",
    ),
])  # fmt: skip
def test_what_is_wrong_with_a_fault_or_measure(
    message: Callable[[str], str], good: str, bad: str, expected: str
) -> None:
    assert good in GOOD
    assert message(GOOD.replace(good, bad, 1)) == f"suites/sample.yaml:{expected}"


def test_what_a_backend_declares_can_be_asked_for_and_nothing_else() -> None:
    assert injectable("lose", {"lose": "how"})
    assert not injectable("lose", {"duplicate": "how"})
    assert injectable("heal", {"block": "how"})
    assert injectable("thaw", {"freeze": "how"})
    assert not injectable("overflow", {"overflow": "how"})
    assert {fault for fault in INJECTIONS if publishes(Fault(fault=fault))} == {"lose", "duplicate", "reorder"}  # type: ignore[arg-type]


@pytest.mark.parametrize(("qos", "lacking"), [
    (Qos(), []),
    (Qos(lifespan=Period.parse("2T"), deadline=Period.parse("infinite"), lease=Period.parse(0)), ["lifespan"]),
    (Qos(liveliness="manual_by_node"), ["liveliness.manual_by_node"]),
    (Qos(liveliness="manual_by_topic"), []),
    (Qos(depth=128), []),
    (Qos(depth=129, history="keep_all"), ["depth.above_128", "history.keep_all"]),
])  # fmt: skip
def test_the_unsupported_policies_that_a_qos_asks_for(qos: Qos, lacking: list[str]) -> None:
    declared = ["lifespan", "deadline", "lease", "liveliness.manual_by_node", "depth.above_128", "history.keep_all"]
    assert unsupported(qos, declared) == lacking
