from __future__ import annotations

from collections.abc import Callable

import pytest

from nros_conformance.suite.loader import Loaded

Scenarios = Callable[[str], tuple[Loaded, ...]]
Message = Callable[[str], str]

SCENARIO = """\
  - id: rdm.sample
    title: {title}
    for: {parameters}
    entities:
      talker: {{publisher: sensor}}
      listener: {{subscription: sensor}}
    script:
      - {step}
    expect:
      - {expect}
"""


def scenario(
    parameters: str = "{n: [1, 3]}",
    step: str = "{do: publish, by: talker, times: $n, as: data}",
    expect: str = "{never: ANY, of: ALL, proves: RDM-001}",
    title: str = "A sample",
) -> str:
    return SCENARIO.format(parameters=parameters, step=step, expect=expect, title=title)


def test_one_scenario_for_each_value(scenarios: Scenarios) -> None:
    loaded = scenarios(scenario())
    assert [one.key for one in loaded] == ["rdm.sample[n=1]", "rdm.sample[n=3]"]
    assert [one.parameters for one in loaded] == [{"n": 1}, {"n": 3}]
    assert [one.raw["script"][0].get("times", 1) for one in loaded] == [1, 3]
    assert all(one.source == "suites/sample.yaml:4" for one in loaded)


def test_the_product_runs_in_the_order_of_the_file_and_keys_in_that_of_names(scenarios: Scenarios) -> None:
    loaded = scenarios(scenario("{b: [x, y], a: [1, 2]}", "{do: publish, by: talker, times: $a, as: $b}"))
    assert [one.key for one in loaded] == [
        "rdm.sample[a=1,b=x]", "rdm.sample[a=2,b=x]", "rdm.sample[a=1,b=y]", "rdm.sample[a=2,b=y]"
    ]  # fmt: skip


def test_values_that_are_mappings_have_names(scenarios: Scenarios) -> None:
    parameters = "{call: {often: {drive: 0.1T, as: wait}, long: {drive: 10T, as: wait}}}"
    loaded = scenarios(scenario(parameters, "$call"))
    assert [one.key for one in loaded] == ["rdm.sample[call=often]", "rdm.sample[call=long]"]
    assert [one.parameters for one in loaded] == [{"call": "often"}, {"call": "long"}]
    assert [one.raw["script"] for one in loaded] == [
        [{"as": "wait", "drive": "0.1T"}],
        [{"as": "wait", "drive": "10T"}],
    ]


def test_a_value_keeps_its_type_alone_and_is_text_within_text(scenarios: Scenarios) -> None:
    step = "{do: publish, by: talker, times: $n, every: $n$unit, as: data-$n}"
    (loaded,) = scenarios(scenario("{n: [3], unit: [T]}", step, title="$n at $$5"))
    assert loaded.raw["script"] == [{"do": "publish", "by": "talker", "times": 3, "every": "3T", "as": "data-3"}]
    assert loaded.raw["title"] == "3 at $5"


@pytest.mark.parametrize(("value", "text"), [("true", "true"), ("null", "null"), ("1.50", "1.5"), ("2 * T", "2*T")])
def test_values_in_texts_and_keys(scenarios: Scenarios, value: str, text: str) -> None:
    (loaded,) = scenarios(scenario(f"{{v: [{value}]}}", "settle", title="<$v>"))
    assert loaded.key == f"rdm.sample[v={text}]"
    assert loaded.raw["title"].replace(" ", "") == f"<{text}>"


def test_keys_may_be_parameters(scenarios: Scenarios) -> None:
    text = scenario("{side: [publisher, subscription]}", "{do: register, of: third, kind: 5}")
    loaded = scenarios(text.replace("    script:", "      third: {$side: sensor}\n    script:"))
    assert [one.raw["entities"]["third"] for one in loaded] == [{"publisher": "sensor"}, {"subscription": "sensor"}]


def test_when_and_unless_choose_and_vanish(scenarios: Scenarios) -> None:
    text = """\
  - id: rdm.sample
    title: Choices
    for: {n: [1, 2, 3], drive: {often: 0.1T, long: 9T}}
    sessions:
      far: {process: own, when: {n: 3}}
    entities:
      listener: {subscription: sensor, session: far, when: {n: 3}}
      other: {subscription: sensor, unless: {n: 3}}
    script:
      - {drive: $drive, when: {drive: long}}
      - {drive: 2T, when: {n: [1, 2], drive: often}}
      - {drive: 3T, unless: {n: [1, 2], drive: often}}
      - parallel:
        - [{drive: 4T, when: {n: 2}}]
        - [{drive: 5T}]
    given:
      - {driven: sub, max: 1T, unless: {n: 3}}
    expect:
      - {never: ANY, of: ALL, proves: RDM-001, when: {n: 1}}
      - any_of:
        - [{never: MessageLost, of: ALL, when: {n: 1}}]
        - [{never: ANY, of: ALL}]
        proves: RDM-002
"""
    raw = {one.key: one.raw for one in scenarios(text)}
    first = raw["rdm.sample[drive=often,n=1]"]
    assert first["script"] == [{"drive": "2T"}, {"parallel": [[{"drive": "5T"}]]}]
    assert first["entities"] == {"other": {"subscription": "sensor"}}
    assert first["given"] == [{"driven": "sub", "max": "1T"}]
    assert len(first["expect"]) == 2
    assert len(first["expect"][1]["any_of"]) == 2
    last = raw["rdm.sample[drive=long,n=3]"]
    assert last["script"] == [{"drive": "9T"}, {"drive": "3T"}, {"parallel": [[{"drive": "5T"}]]}]
    assert last["sessions"] == {"far": {"process": "own"}}
    assert last["entities"] == {"listener": {"subscription": "sensor", "session": "far"}}
    assert "given" not in last
    assert len(last["expect"]) == 1
    middle = raw["rdm.sample[drive=long,n=2]"]
    assert middle["script"][-1] == {"parallel": [[{"drive": "4T"}], [{"drive": "5T"}]]}


def test_conditions_tell_true_from_one(scenarios: Scenarios) -> None:
    text = scenario("{v: [1, true]}", "{drive: 1T, when: {v: true}}")
    assert [len(one.raw["script"]) for one in scenarios(text)] == [0, 1]


def test_scenarios_share_no_data(scenarios: Scenarios) -> None:
    text = scenario("{qos: {deep: {depth: 5}}, n: [1, 2]}", "{do: publish, by: talker, times: $n}")
    first, second = scenarios(text.replace("{publisher: sensor}", "{publisher: sensor, qos: $qos}"))
    first.raw["entities"]["talker"]["qos"]["depth"] = 9
    assert second.raw["entities"]["talker"]["qos"] == {"depth": 5}


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ("{n: [1], m: [2]}", "6: the parameter 'm' is never used; write $m or when: {m: ...} somewhere, or remove it"),
        ("[n]", "6: for: parameters are a mapping; write for example for: {n: [1, 3]}"),
        ("{n: 1}", "6: n: 1 is not a list; write n: [VALUE, ...] or n: {NAME: VALUE, ...}"),
        ("{n: []}", "6: the parameter 'n' has no values; give it one or more"),
        ("{n: [1, 1]}", "6: n: the value 1 stands here twice"),
        ("{n: [{a: 1}]}", "6: n: a value that is a mapping needs a name; name it: n: {NAME: VALUE, ...}"),
        ("{n: [[1]]}", "6: n: a value that is a list needs a name; name it: n: {NAME: VALUE, ...}"),
        ("{n: [a/b]}", "6: n: 'a/b' cannot stand in a scenario's key; name it: n: {NAME: VALUE, ...}"),
        ("{n: [1], 2x: [1]}", "6: '2x' cannot name a parameter; use letters, digits and _"),
        ("{n: {a: {b: [$m]}}}", "6: n: '$m': a value cannot use parameters"),
        ("{m: [1]}", "11: undefined parameter $n; valid are m"),
    ],
)
def test_parameters_that_cannot_be_put_in(message: Message, parameters: str, expected: str) -> None:
    assert message(scenario(parameters)) == f"suites/sample.yaml:{expected}"


@pytest.mark.parametrize(
    ("step", "expected"),
    [
        ("{drive: $nn}", "undefined parameter $nn; did you mean 'n'?"),
        ("{drive: 1T, as: a-$m}", "undefined parameter $m; valid are n"),
        ("{drive: 1T, as: a$}", "a lone $ in 'a$'; write $$ for a dollar"),
        ("{drive: 1T, when: {m: 1}}", "undefined parameter m; valid are n"),
        ("{drive: 1T, when: {n: 2}}", "when: n is never 2; valid are 1, 3"),
        ("{drive: 1T, unless: {n: [1, 2]}}", "unless: n is never 2; valid are 1, 3"),
        ("{drive: 1T, when: n}", "when: 'n' is no condition; write when: {PARAMETER: VALUE}"),
        ("{drive: 1T, when: {}}", "when: {} is no condition; write when: {PARAMETER: VALUE}"),
        ("{drive: $n}", "drive: 1 in '1' has no unit; write for example 1ms or 1T (in rdm.sample[n=1])"),
        ("{drive: 1T, $n: 1, 1: 1}", "the key '1' stands here twice, once as a parameter"),
        ("{drive: 1T, as: $n}", "as: expected `str | null`, got `int` (in rdm.sample[n=1])"),
    ],
)
def test_uses_that_do_not_work(message: Message, step: str, expected: str) -> None:
    assert message(scenario(step=step)) == f"suites/sample.yaml:11: {expected}"


def test_an_undefined_parameter_without_any(message: Message) -> None:
    text = scenario(step="{drive: $n}").replace("    for: {n: [1, 3]}\n", "")
    assert message(text) == "suites/sample.yaml:10: undefined parameter $n; the scenario has no for:"


def test_a_mapping_within_a_text(message: Message) -> None:
    text = scenario("{n: {deep: {a: 1}}}", "{drive: 1T, as: a-$n}")
    expected = "suites/sample.yaml:11: $n is a mapping and cannot stand inside of a text"
    assert message(text) == expected


def test_an_error_within_a_value_names_the_line_of_the_value(message: Message) -> None:
    text = """\
  - id: rdm.sample
    title: A sample
    for:
      qos:
        good: {deadline: 1T}
        bad: {deadline: 1x, depth: 5}
    entities:
      listener: {subscription: sensor, qos: $qos}
    script: [settle]
    expect: [{never: ANY, of: ALL, proves: RDM-001}]
"""
    assert message(text) == (
        "suites/sample.yaml:9: deadline: unknown unit 'x' in the duration '1x'; known are ns, us, ms, s, min, h, T, "
        "tolerance, early, discovery_bound, connection_lease, hard_liveliness_timeout, hard_liveliness_grace "
        "(in rdm.sample[qos=bad])"
    )


def test_an_error_after_a_step_that_is_left_out_names_its_own_line(message: Message) -> None:
    text = """\
  - id: rdm.sample
    title: A sample
    for: {n: [1, 2]}
    entities:
      listener: {subscription: sensor}
    script:
      - {drive: 1T, when: {n: 1}}
      - {drive: 2T, when: {n: 1}}
      - {do: take, from: lisener, when: {n: 2}}
    expect: [{never: ANY, of: ALL, proves: RDM-001}]
"""
    expected = "suites/sample.yaml:12: unknown entity 'lisener'; did you mean 'listener'? (in rdm.sample[n=2])"
    assert message(text) == expected


def test_what_is_left_out_everywhere_still_uses_its_parameters(message: Message) -> None:
    text = scenario(step="{drive: $m, when: {n: 3}, unless: {n: 3}}")
    assert message(text) == "suites/sample.yaml:11: undefined parameter $m; valid are n"


def test_the_id_takes_no_parameters(message: Message) -> None:
    text = scenario().replace("rdm.sample", "rdm.$n")
    assert message(text) == (
        "suites/sample.yaml:4: id: 'rdm.$n' does not have the form ^[a-z]+\\.[a-z0-9-]+$ (in rdm.$n[n=1])"
    )
