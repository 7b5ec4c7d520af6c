from __future__ import annotations

from nros_backends.xrce.client.health import Health, State
from nros_conformance.rmw.clock import MS, NEVER

LEASE = 1_000 * MS


def state(health: Health) -> State:
    return health.state


def run(health: Health, begin: int, end: int) -> list[int]:
    """Look at every millisecond; when probes were sent."""
    return [now for now in range(begin, end, MS) if health.look(now)]


def test_silence_of_a_quarter_of_the_lease_is_probed() -> None:
    health = Health(LEASE, 0)
    assert run(health, 0, 250 * MS) == []
    assert run(health, 250 * MS, 251 * MS) == [250 * MS]
    assert state(health) is State.WELL


def test_a_dead_agent_is_noticed_within_the_lease_after_several_probes() -> None:
    health = Health(LEASE, 0)
    assert run(health, 0, 750 * MS) == [250 * MS, 375 * MS, 500 * MS, 625 * MS]
    assert state(health) is State.WELL
    run(health, 750 * MS, 751 * MS)
    assert state(health) is State.SILENT


def test_an_answer_ends_the_silence() -> None:
    health = Health(LEASE, 0)
    run(health, 0, 900 * MS)
    assert state(health) is State.SILENT
    health.heard(900 * MS)
    assert state(health) is State.WELL
    assert run(health, 900 * MS, 1_149 * MS) == []


def test_a_silent_agent_is_asked_again_and_again() -> None:
    health = Health(LEASE, 0)
    run(health, 0, 2_000 * MS)
    assert len(run(health, 2_000 * MS, 4_000 * MS)) == 16


def test_time_in_which_nobody_looks_does_not_count_against_the_agent() -> None:
    health = Health(LEASE, 0)
    assert health.look(60_000 * MS)
    assert state(health) is State.WELL
    health.heard(60_001 * MS)
    run(health, 60_001 * MS, 60_200 * MS)
    assert state(health) is State.WELL


def test_a_forgotten_session_stays_forgotten() -> None:
    health = Health(LEASE, 0)
    health.forgotten()
    health.heard(1)
    assert state(health) is State.FORGOTTEN
    assert not health.look(LEASE)
    assert health.next_due_ns == NEVER


def test_due_is_when_look_has_something_to_do() -> None:
    health = Health(LEASE, 0)
    now, seen = 0, []
    while health.state is State.WELL:
        now = health.next_due_ns
        seen.append(now)
        health.look(now)
    assert seen == [250 * MS, 375 * MS, 500 * MS, 625 * MS, 750 * MS]
