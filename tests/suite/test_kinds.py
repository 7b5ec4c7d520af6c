from __future__ import annotations

from collections.abc import Callable

from nros_conformance.suite.kinds import claims_needed, faults_needed, registered_kinds
from nros_conformance.suite.loader import Loaded, typed
from nros_conformance.suite.schema import Scenario
from nros_conformance.suite.walk import expectations, members, session_of, steps

Scenarios = Callable[[str], tuple[Loaded, ...]]


def scenario(*expect: dict[str, object], **parts: object) -> Scenario:
    return typed(
        {
            "id": "rdm.sample",
            "title": "A sample",
            "entities": {
                "talker": {"publisher": "sensor"},
                "listener": {"subscription": "sensor"},
                "other": {"subscription": "sensor"},
                "crowd": {"publisher": "sensor", "count": 2},
            },
            "script": [],
            "expect": [{"proves": "RDM-001", **one} for one in expect],
            **parts,
        }
    )


def test_positive_expectations_need_the_claim() -> None:
    assert claims_needed(
        scenario(
            {"periodic": "RequestedDeadlineMissed", "of": "listener", "every": "1T", "since": "start"},
            {"total": "MessageLost", "of": "listener", "is": 0},
            {"level": "alive_count", "of": "listener", "is": 1, "by": "end"},
            {"inside": "call", "event": "OfferedDeadlineMissed", "of": "talker"},
        )
    ) == {"RequestedDeadlineMissed", "MessageLost", "LivelinessChanged", "OfferedDeadlineMissed"}


def test_other_expectations_need_none() -> None:
    assert (
        claims_needed(
            scenario(
                {"never": "LivelinessLost", "of": "talker"},
                {"never": "ANY", "of": "ALL"},
                {"conserved": "listener", "from": ["talker"]},
                {"callback": "registered", "is": "some", "kind": "MessageLost"},
            )
        )
        == frozenset()
    )


def test_groups_moments_and_needs_count_as_well() -> None:
    assert claims_needed(
        scenario(
            {"any_of": [[{"total": "MessageLost", "of": "listener", "is": 1}]]},
            {"never": "ANY", "of": "ALL", "from": "listener.LivelinessChanged[0]"},
            script=[{"drive": "1T", "at": "talker.OfferedDeadlineMissed[0]"}],
            needs={"claims": ["LivelinessLost"]},
        )
    ) == {"MessageLost", "LivelinessChanged", "OfferedDeadlineMissed", "LivelinessLost"}


def test_expected_registrations_are_those_that_expectations_name_for_the_entity() -> None:
    one = scenario(
        {"never": ["MessageLost", "LivelinessChanged"], "of": ["listener"]},
        {"any_of": [[{"total": "RequestedDeadlineMissed", "of": "other", "is": 1}]]},
        {"level": "alive_count", "of": ["other", "listener"], "is": 1, "by": "talker.LivelinessLost[0]"},
    )
    assert registered_kinds(one, "listener") == ["LivelinessChanged", "MessageLost"]
    assert registered_kinds(one, "other") == ["LivelinessChanged", "RequestedDeadlineMissed"]
    assert registered_kinds(one, "talker") == ["LivelinessLost"]


def test_any_and_all_register_nothing() -> None:
    one = scenario({"never": "ANY", "of": "listener"}, {"never": "MessageLost", "of": "ALL"})
    assert registered_kinds(one, "listener") == []


def test_conservation_registers_loss() -> None:
    one = scenario({"conserved": "listener", "from": ["talker"]})
    assert registered_kinds(one, "listener") == ["MessageLost"]
    assert registered_kinds(one, "talker") == []


def test_one_of_several_registers_what_is_named_for_it_or_for_all() -> None:
    one = scenario(
        {"total": "LivelinessLost", "of": "crowd[1]", "is": 1}, {"never": "OfferedDeadlineMissed", "of": "crowd"}
    )
    assert registered_kinds(one, "crowd[0]") == ["OfferedDeadlineMissed"]
    assert registered_kinds(one, "crowd[1]") == ["LivelinessLost", "OfferedDeadlineMissed"]
    assert registered_kinds(one, "crowd") == ["LivelinessLost", "OfferedDeadlineMissed"]


def test_faults_are_found_in_branches_too() -> None:
    script = [{"fault": "crash", "of": "pub"}, {"parallel": [["settle"], [{"parallel": [[{"fault": "lose"}]]}]]}]
    assert faults_needed(scenario(script=script)) == {"crash", "lose"}
    assert faults_needed(scenario()) == frozenset()


def test_paths_lead_through_branches_and_groups() -> None:
    one = scenario(
        {"any_of": [[{"never": "ANY", "of": "ALL"}]]},
        script=["settle", {"parallel": [[{"drive": "1T"}], ["settle", {"idle": "1T"}]]}, {"drive": "2T"}],
    )
    assert [path for path, _ in steps(one)] == [
        ("script", 0),
        ("script", 1),
        ("script", 1, "parallel", 0, 0),
        ("script", 1, "parallel", 1, 0),
        ("script", 1, "parallel", 1, 1),
        ("script", 2),
    ]
    assert [path for path, _ in expectations(one)] == [("expect", 0), ("expect", 0, "any_of", 0, 0)]


def test_default_sessions_lie_on_two_sides() -> None:
    entities = scenario().entities
    assert [session_of(entities[name]) for name in ("talker", "listener")] == ["pub", "sub"]


def test_one_entity_is_itself_and_several_are_numbered() -> None:
    entities = scenario().entities
    assert members("talker", entities["talker"]) == ("talker",)
    assert members("crowd", entities["crowd"]) == ("crowd[0]", "crowd[1]")
