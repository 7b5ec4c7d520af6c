from __future__ import annotations

from collections.abc import Callable

import pytest

GOOD = """\
  - id: rdm.sample
    title: A sample
    entities:
      talker: {publisher: sensor}
      listener: {subscription: sensor}
    script:
      - settle
      - {do: publish, by: talker, times: 3, as: data}
      - {do: drive, timeout: 1T, as: call}
      - {drive: 2T, as: silence}
    given:
      - {gap: data, max: 1T}
    expect:
      - {periodic: RequestedDeadlineMissed, of: listener, every: 1T, since: data.last, proves: RDM-001}
"""

GIVEN = "      - {gap: data, max: 1T}\n"
EXPECT = "      - {periodic: RequestedDeadlineMissed, of: listener, every: 1T, since: data.last, proves: RDM-001}\n"
SILENCE = "      - {drive: 2T, as: silence}\n"
TALKER = "      talker: {publisher: sensor}\n"
TITLE = "    title: A sample\n"

Message = Callable[[str], str]


def test_the_sample_that_the_other_tests_spoil_is_good(scenarios: Callable[[str], tuple[object, ...]]) -> None:
    assert len(scenarios(GOOD)) == 1


STRUCTURE = [
    ("    title:", "    titel:", "5: unknown key 'titel'; did you mean 'title'?"),
    (TITLE, "", "4: the key 'title' is missing; add title: ..."),
    ("rdm.sample", "RDM sample", "4: id: 'RDM sample' does not have the form ^[a-z]+\\.[a-z0-9-]+$"),
    (TITLE, f"{TITLE}    profile: smok\n", "6: profile: unknown value 'smok'; did you mean 'smoke'?"),
    ("talker: {", "1st: {", "7: the key '1st' does not have the form ^[A-Za-z][A-Za-z0-9_-]*$"),
    ("{publisher: sensor}", "{publisher: sensor, qos: {depht: 5}}", "7: unknown key 'depht'; did you mean 'depth'?"),
    (
        "{publisher: sensor}",
        "{publisher: sensor, qos: {liveliness: forced}}",
        "7: liveliness: unknown value 'forced'; valid are automatic, manual_by_node, manual_by_topic, none",
    ),
    ("times: 3", "times: three", "11: times: expected `int`, got `str`"),
    ("drive: 2T", "drive: 2sec", "13: drive: unknown unit 'sec' in the duration '2sec'; did you mean 's'?"),
    ("drive: 2T", "drive: 2", "13: drive: 2 in '2' has no unit; write for example 2ms or 2T"),
    (
        "since: data.last",
        "since: data.lst",
        "17: since: cannot read the moment 'data.lst'; write for example data.last, start or gone.end + 2T",
    ),
    ("every: 1T,", "evry: 1T,", "17: unknown key 'evry'; did you mean 'every'?"),
    ("proves: RDM-001", "proves: RDM1", "17: unknown requirement 'RDM1'; did you mean 'RDM-001'?"),
    ("proves: RDM-001", "proves: [RDM1]", "17: proves: 'RDM1' does not have the form ^[A-Z]{3}-[0-9]{3}$"),
    ("{drive: 2T,", "{driv: 2T,", "13: unknown head 'driv' of a step; did you mean 'drive'?"),
    (
        "{drive: 2T,",
        "{wait: 2T,",
        "13: unknown head 'wait' of a step; valid are cycle, do, drive, fault, idle, parallel, phase, repeat, until",
    ),
    ("{drive: 2T,", "{drive: 2T, idle: 2T,", "13: a step with several heads: drive, idle; write one for each"),
    (
        "{drive: 2T, as: silence}",
        "{}",
        "13: a step that says nothing; a step has one of drive, idle, phase, cycle, parallel, fault, until, repeat, do",
    ),
    (
        "{drive: 2T, as: silence}",
        "2",
        "13: 2 is not a step; a step is a mapping with one of "
        "drive, idle, phase, cycle, parallel, fault, until, repeat, do",
    ),
    ("do: publish", "do: publsh", "11: do: unknown value 'publsh'; did you mean 'publish'?"),
    ("do: publish", "do: [publish]", "11: do: unknown value ['publish']; did you mean 'publish'?"),
    ("- settle", "- setle", "10: do: unknown value 'setle'; did you mean 'settle'?"),
    ("- settle", "- publish", "10: the key 'by' is missing; add by: ..."),
    ("{gap: data", "{gpa: data", "15: unknown head 'gpa' of a given; did you mean 'gap'?"),
    ("{periodic:", "{peridoic:", "17: unknown head 'peridoic' of an expectation; did you mean 'periodic'?"),
    ("{periodic:", "{of: listener, peridoic:", "17: the key 'of' stands here twice; the first is in line 17"),
    (
        EXPECT,
        "      - {of: listener, evr: R, proves: RDM-001}\n",
        "17: unknown head 'evr' of an expectation; did you mean 'never'?",
    ),
    (
        "periodic: RequestedDeadlineMissed",
        "periodic: RequestedDeadlinMissed",
        "17: periodic: unknown value 'RequestedDeadlinMissed'; did you mean 'RequestedDeadlineMissed'?",
    ),
]


@pytest.mark.parametrize(("good", "bad", "expected"), STRUCTURE)
def test_what_the_format_does_not_know(message: Message, good: str, bad: str, expected: str) -> None:
    assert good in GOOD
    assert message(GOOD.replace(good, bad)) == f"suites/sample.yaml:{expected}"


NAMES = [
    ("by: talker", "by: taker", "11: unknown entity 'taker'; did you mean 'talker'?"),
    ("by: talker", "by: 'talker[0]'", "11: unknown entity 'talker[0]'; did you mean 'talker'?"),
    ("by: talker", "by: listener", "11: by: 'listener' is a subscription; name a publisher"),
    ("{drive: 2T,", "{do: take, from: talker,", "13: from: 'talker' is a publisher; name a subscription"),
    ("{drive: 2T,", "{do: has_data, of: talker,", "13: of: 'talker' is a publisher; name a subscription"),
    ("{drive: 2T,", "{do: register, of: lisener, kind: 5,", "13: unknown entity 'lisener'; did you mean 'listener'?"),
    ("{drive: 2T,", "{do: destroy, of: pbu,", "13: unknown entity 'pbu'; did you mean 'pub'?"),
    (
        "{drive: 2T,",
        "{fault: freeze, of: nowhere,",
        "13: unknown entity 'nowhere'; valid are listener, pub, sub, talker",
    ),
    (
        "{drive: 2T,",
        "{do: create, entity: talker,",
        "13: 'talker' exists from the start; add deferred: true to the entity",
    ),
    ("timeout: 1T", "timeout: 1T, session: sbu", "12: unknown session 'sbu'; did you mean 'sub'?"),
    ("of: listener", "of: lisener", "17: unknown entity 'lisener'; did you mean 'listener'?"),
    (
        "of: listener",
        "of: talker",
        "17: RequestedDeadlineMissed is an event of a subscription, 'talker' is a publisher; name a subscription",
    ),
    ("proves: RDM-001", "proves: [RDM-001, RDM-003]", "17: unknown requirement 'RDM-003'; did you mean 'RDM-002'?"),
    ("as: silence", "as: data", "13: the label 'data' stands here twice; the first is in line 11"),
    ("as: silence", "as: end", "13: the label 'end' is reserved; choose another one"),
    (
        "as: silence",
        "as: talker",
        "13: the label 'talker' is also an entity; rename one of the two; that one is in line 7",
    ),
    ("talker: {", "start: {", "7: 'start' is reserved; choose another name for this entity"),
    ("talker: {", "ALL: {", "7: 'ALL' is reserved; choose another name for this entity"),
    ("talker: {", "sub: {", "7: 'sub' names an entity and a session; rename one of the two"),
    (
        "{publisher: sensor}",
        "{}",
        "7: 'talker' is neither a publisher nor a subscription; add publisher: or subscription:",
    ),
    (
        "{publisher: sensor}",
        "{publisher: sensor, subscription: sensor}",
        "7: 'talker' is both a publisher and a subscription; keep one of the two keys",
    ),
    (
        "{publisher: sensor}",
        "{publisher: sensor, register: [MessageLost]}",
        "7: MessageLost is an event of a subscription, 'talker' is a publisher; name a subscription",
    ),
    ("{publisher: sensor}", "{publisher: sensor, count: 0}", "7: count: 0 is less than 1"),
    ("{publisher: sensor}", "{publisher: sensor, count: 1001}", "7: count: 1001 is more than 1000"),
    (
        TITLE,
        f"{TITLE}    sessions: {{far: {{process: own}}}}\n",
        "6: nothing names the session 'far'; valid are pub, sub",
    ),
    (
        TITLE,
        f"{TITLE}    sessions: {{pbu: {{process: own}}}}\n",
        "6: nothing names the session 'pbu'; did you mean 'pub'?",
    ),
    (
        TITLE,
        f"{TITLE}    needs: {{declares: {{calback_cap: true}}}}\n",
        "6: declarations have no field 'calback_cap'; did you mean 'callback_cap'?",
    ),
    ("{gap: data", "{gap: dta", "15: unknown label 'dta'; did you mean 'data'?"),
    ("{gap: data", "{gap: [data, dta]", "15: unknown label 'dta'; did you mean 'data'?"),
    (
        "{gap: data",
        "{gap: silence",
        "15: gap: 'silence' is a step with drive:; name one with do:",
    ),
    (GIVEN, "      - {driven: sbu, max: 1T}\n", "15: unknown session 'sbu'; did you mean 'sub'?"),
]


@pytest.mark.parametrize(("good", "bad", "expected"), NAMES)
def test_names_that_nothing_has(message: Message, good: str, bad: str, expected: str) -> None:
    assert good in GOOD
    assert message(GOOD.replace(good, bad)) == f"suites/sample.yaml:{expected}"


EXPECTATIONS = [
    (
        "never: LivelinessLost, of: listener",
        "LivelinessLost is an event of a publisher, 'listener' is a subscription; name a publisher",
    ),
    (
        "never: [MessageLost, LivelinessLost], of: [listener]",
        "LivelinessLost is an event of a publisher, 'listener' is a subscription; name a publisher",
    ),
    ("total: MessageLost, of: listener", "total without a number; add is:, at_least: or at_most:"),
    (
        "total: MessageLost, of: listener, is: 1, at_least: 1",
        "is: stands beside a bound; keep is: alone, or the bounds",
    ),
    ("total: MessageLost, of: listener, at_least: 2, at_most: 1", "at_least: 2 is more than at_most: 1"),
    ("total: MessageLost, of: listener, is: -1", "is: -1 is less than 0"),
    ("callbacks: call", "callbacks without a number; add at_least: or at_most:"),
    (
        "callbacks: silence, at_most: 1",
        "callbacks: 'silence' is a step with drive:; name one with do: drive or do: spin",
    ),
    ("level: alive_count, of: listener, is: 1", "level needs either by:, or from: and until:"),
    ("level: alive_count, of: listener, is: 1, from: start", "level needs either by:, or from: and until:"),
    ("level: alive_count, of: listener, is: 1, by: end, until: end", "level needs either by:, or from: and until:"),
    ("level: alive_count, of: talker, is: 1, by: end", "of: 'talker' is a publisher; name a subscription"),
    ("level: count, of: listener, is: 1, by: end", "level: unknown value 'count'; did you mean 'alive_count'?"),
    ("takes: data", "takes without a bound; add at_most: or at_least:"),
    ("takes: silence, at_most: 1T", "takes: 'silence' is a step with drive:; name one with do:"),
    ("returns: data, is: [UNSUPORTED]", "unknown answer 'UNSUPORTED'; did you mean 'UNSUPPORTED'?"),
    ("returns: data, is: []", "is: no answer is listed; list one or more"),
    ("returns: silence, is: [OK]", "returns: 'silence' is a step with drive:, which answers nothing"),
    ("returns: talker, is: [OK]", "unknown label 'talker'; valid are call, data, silence"),
    ("agrees: data, with: data", "agrees: 'data' is a step with do: publish; name one with do: supports"),
    ("callback: data, is: some", "callback: 'data' is a step with do: publish; name one with do: register"),
    ("received: call, of: listener", "received: 'call' is a step with do: drive; name one with do: publish"),
    ("received: data, of: talker", "of: 'talker' is a publisher; name a subscription"),
    ("conserved: talker, from: [talker]", "conserved: 'talker' is a publisher; name a subscription"),
    ("conserved: listener, from: [listener]", "from: 'listener' is a subscription; name a publisher"),
    (
        "inside: data, event: MessageLost, of: listener",
        "inside: 'data' is a step with do: publish; name one with do: drive or do: spin",
    ),
    (
        "inside: call, event: MessageLost, of: listener, status: {alive_count: 1}",
        "unknown field of MessageLost 'alive_count'; did you mean 'total_count'?",
    ),
    (
        "inside: call, event: LivelinessChanged, of: listener, status: {alive: 1}",
        "unknown field of LivelinessChanged 'alive'; did you mean 'alive_count'?",
    ),
    ("any_of: []", "any_of without a group; add one or more, each a list"),
    ("any_of: [[]]", "any_of: an empty group; fill it or remove it"),
    ("any_of: [[{never: MessageLost, of: lisener}]]", "unknown entity 'lisener'; did you mean 'listener'?"),
    (
        "periodic: MessageLost, of: listener, every: 0, since: data",
        "every: the period is 0; events repeat after a positive time",
    ),
    ("periodic: MessageLost, of: listener, every: 1T - 1s, since: data", "every: the duration '1T - 1s' is negative"),
    ("never: ANY, of: ALL, from: dta", "unknown label 'dta'; did you mean 'data'?"),
    ("never: ANY, of: ALL, from: datas", "unknown label 'datas'; did you mean 'data'?"),
    ("never: ANY, of: ALL, from: data-2T", "unknown label 'data-2T'; to subtract, write spaces: data - 2T"),
    ("never: ANY, of: ALL, from: 'data[3]'", "from: there is no moment 'data[3]': 'data' happens 3 times"),
    ("never: ANY, of: ALL, from: 'silence[1]'", "from: there is no moment 'silence[1]': 'silence' happens once"),
    (
        "never: ANY, of: ALL, from: data.created",
        "from: there is no moment 'data.created': 'data' is a step and not an entity",
    ),
    (
        "never: ANY, of: ALL, from: data.settled",
        "from: there is no moment 'data.settled': 'data' is a step with do: publish and not with do: settle",
    ),
    ("never: ANY, of: ALL, from: start.begin", "from: there is no moment 'start.begin': 'start' is one moment"),
    (
        "never: ANY, of: ALL, from: listener",
        "from: there is no moment 'listener': 'listener' is an entity; write listener.created, "
        "listener.settled or listener.EVENT[0]",
    ),
    (
        "never: ANY, of: ALL, from: 'listener.LivelinessChange[0]'",
        "unknown event 'LivelinessChange'; did you mean 'LivelinessChanged'?",
    ),
    (
        "never: ANY, of: ALL, from: 'talker.LivelinessChanged[0]'",
        "LivelinessChanged is an event of a subscription, 'talker' is a publisher; name a subscription",
    ),
]


@pytest.mark.parametrize(("bad", "expected"), EXPECTATIONS)
def test_expectations_that_cannot_be_judged(message: Message, bad: str, expected: str) -> None:
    text = GOOD.replace(EXPECT, f"      - {{{bad}, proves: RDM-001}}\n")
    assert message(text) == f"suites/sample.yaml:17: {expected}"


def test_a_scenario_that_expects_nothing(message: Message) -> None:
    text = GOOD.replace(f"    expect:\n{EXPECT}", "    expect: []\n")
    assert message(text) == "suites/sample.yaml:16: the scenario expects nothing; say what it proves"


def test_a_gap_without_a_bound(message: Message) -> None:
    expected = "suites/sample.yaml:15: gap without a bound; add max: or min:"
    assert message(GOOD.replace("{gap: data, max: 1T}", "{gap: data}")) == expected


def test_an_event_that_nobody_registers(message: Message) -> None:
    text = GOOD.replace("{subscription: sensor}", "{subscription: sensor, register: none}")
    expected = "suites/sample.yaml:17: nothing registers RequestedDeadlineMissed on 'listener'; add a register step"
    assert message(text) == expected


def test_a_list_registers_what_it_lists(message: Message, scenarios: Callable[[str], tuple[object, ...]]) -> None:
    text = GOOD.replace("{subscription: sensor}", "{subscription: sensor, register: [KIND]}")
    assert scenarios(text.replace("KIND", "RequestedDeadlineMissed"))
    expected = "suites/sample.yaml:17: nothing registers RequestedDeadlineMissed on 'listener'; add a register step"
    assert message(text.replace("KIND", "MessageLost")) == expected


def test_bounds_may_be_equal(scenarios: Callable[[str], tuple[object, ...]]) -> None:
    bounds = "total: MessageLost, of: listener, at_least: 2, at_most: 2"
    assert scenarios(GOOD.replace(EXPECT, f"      - {{{bounds}, proves: RDM-001}}\n"))


@pytest.mark.parametrize("kind", ["RequestedDeadlineMissed", "1"])
def test_a_register_step_is_a_registration(scenarios: Callable[[str], tuple[object, ...]], kind: str) -> None:
    text = GOOD.replace("{subscription: sensor}", "{subscription: sensor, register: none}")
    assert scenarios(text.replace("- settle", f"- {{do: register, of: listener, kind: {kind}}}"))


def test_an_event_of_all_where_no_entity_has_it(message: Message) -> None:
    text = GOOD.replace(TALKER, "").replace("by: talker", "by: listener")
    text = text.replace("- {do: publish, by: listener, times: 3, as: data}", "- {do: has_data, of: listener, as: data}")
    text = text.replace(EXPECT, "      - {never: LivelinessLost, of: ALL, proves: RDM-001}\n")
    expected = "suites/sample.yaml:16: LivelinessLost is an event of a publisher, and there is none"
    assert message(text) == expected


DURATIONS = [
    ("{drive: 2T,", "{drive: -2T,", "13: drive: the duration '-2T' is negative"),
    ("{drive: 2T,", "{drive: -1 * connection_lease,", "13: drive: the duration '-1 * connection_lease' is negative"),
    ("times: 3", "times: 0", "11: times: 0 is less than 1"),
    ("times: 3", "times: 3, every: -1ms", "11: every: the duration '-1ms' is negative"),
    ("{publisher: sensor}", "{publisher: sensor, qos: {lease: -1T}}", "7: lease: the duration '-1T' is negative"),
    (
        "{publisher: sensor}",
        "{publisher: sensor, registration_deadline: -1T}",
        "7: registration_deadline: the duration '-1T' is negative",
    ),
    (TITLE, f"{TITLE}    scale: {{T: 1T}}\n", "6: T: 1T depends on T; give a plain duration such as 130ms"),
    (TITLE, f"{TITLE}    scale: {{T: 0}}\n", "6: T: 0 is not a positive duration"),
    ("{drive: 2T,", "{fault: delay, of: sub, by: -1T,", "13: by: the duration '-1T' is negative"),
    (
        TITLE,
        f"{TITLE}    sessions: {{pub: {{slice: 0}}}}\n",
        "6: slice: drive_io would not wait at all; give it some milliseconds",
    ),
    (TITLE, f"{TITLE}    sessions: {{pub: {{slice: -1ms}}}}\n", "6: slice: the duration '-1ms' is negative"),
]


@pytest.mark.parametrize(("good", "bad", "expected"), DURATIONS)
def test_durations_that_do_not_pass(message: Message, good: str, bad: str, expected: str) -> None:
    assert good in GOOD
    assert message(GOOD.replace(good, bad)) == f"suites/sample.yaml:{expected}"


@pytest.mark.parametrize("duration", ["0", "1T - 129ms", "hard_liveliness_timeout - tolerance", "2 * connection_lease"])
def test_durations_that_may_pass(scenarios: Callable[[str], tuple[object, ...]], duration: str) -> None:
    assert scenarios(GOOD.replace("drive: 2T", f"drive: {duration}"))


def test_a_wall_clock_may_step_back(scenarios: Callable[[str], tuple[object, ...]]) -> None:
    apart = GOOD.replace(TITLE, f"{TITLE}    sessions: {{sub: {{process: own}}}}\n")
    assert scenarios(apart.replace("{drive: 2T,", "{fault: clock_step, of: sub, by: -3600s,"))


@pytest.mark.parametrize("fault", ["crash", "freeze", "thaw", "clock_step, by: 1s"])
def test_a_fault_of_a_process_needs_one(message: Message, fault: str) -> None:
    assert message(GOOD.replace("{drive: 2T,", f"{{fault: {fault}, of: sub,")) == (
        f"suites/sample.yaml:13: {fault.split(',')[0]} hits a process, and session 'sub' shares one; "
        "add sessions: {sub: {process: own}}"
    )
