from __future__ import annotations

import os
from pathlib import Path

import msgspec
import pytest

from nros_conformance.campaign.plans import Row, make_plan
from nros_conformance.campaign.selection import Selection
from nros_conformance.judge.judge import judge
from nros_conformance.play.launch import PLAIN, Launch
from nros_conformance.play.plan import Plan
from nros_conformance.play.pool import Casualty, Ended, Pool, WorkerBroken
from nros_conformance.play.starvation import crowding
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.declaration import load_declaration
from nros_conformance.suite.loader import load_suites
from nros_conformance.trace.files import read_trace

ADAPTERS = Path(__file__).parent / "adapters"
BREAKS = "reg.raises-message-lost"  # its subscription has the depth at which the adapters break
FINE = ("reg.raises-liveliness-changed", "reg.wrong-side-is-refused")


@pytest.fixture(autouse=True)
def _adapters(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ADAPTERS)


def plans(
    adapter: str, folder: Path, *, virtual: bool = False, scenarios: tuple[str, ...] = (*FINE, BREAKS)
) -> list[Plan]:
    suites = load_suites()
    declaration = load_declaration(ADAPTERS / "broken" / "backend.toml")
    row = Row(declaration, f"broken:{adapter}", clock="virtual" if virtual else "real")
    chosen = Selection(scenarios=scenarios).choose(suites)
    return [msgspec.structs.replace(make_plan(one, row, suites, folder), hang_ns=400 * MS) for one in chosen]


class Play:
    """Plays in worker processes and remembers all that was said."""

    def __init__(
        self, folder: Path, *, virtual: bool = False, silence_s: float = 20.0, play_limit_s: float = 60.0,
        launch: Launch = PLAIN,
    ) -> None:  # fmt: skip
        self.ended: dict[str, Ended] = {}
        self.casualties: list[Casualty] = []
        self.pool = Pool(
            folder / "worker.log", virtual=virtual, ended=self.hear, casualty=self.casualties.append,
            silence_s=silence_s, play_limit_s=play_limit_s, launch=launch,
        )  # fmt: skip

    def hear(self, ended: Ended) -> None:
        assert ended.plan.key not in self.ended
        self.ended[ended.plan.key] = ended

    def reasons(self) -> dict[str, str]:
        found = {}
        for key, ended in self.ended.items():
            verdict = judge(read_trace(Path(ended.plan.trace)))
            found[key] = "" if verdict.verdict == "pass" else f"{verdict.verdict}: {verdict.reason}"
        return found


def test_a_healthy_backend_has_no_casualties(tmp_path: Path) -> None:
    play = Play(tmp_path)
    play.pool.play(plans("Healthy", tmp_path), 3)
    assert play.reasons() == dict.fromkeys((*FINE, BREAKS), "")
    assert play.casualties == []


@pytest.mark.parametrize(("group", "processes"), [(0, 1), (1, 3), (2, 2)])
def test_a_process_plays_as_many_scenarios_as_it_may(tmp_path: Path, group: int, processes: int) -> None:
    play = Play(tmp_path, launch=Launch(group=group))
    play.pool.play(plans("SaysWhereItIs", tmp_path), 3)
    assert play.reasons() == dict.fromkeys((*FINE, BREAKS), "")
    assert len(set((tmp_path / "worker.log").read_text(encoding="utf-8").splitlines())) == processes


@pytest.mark.parametrize("at_once", [1, 3])
def test_a_segfault_is_the_verdict_of_its_scenario_and_the_others_are_unaffected(tmp_path: Path, at_once: int) -> None:
    play = Play(tmp_path)
    play.pool.play(plans("Segfaults", tmp_path), at_once)
    reasons = play.reasons()
    assert [reasons[key] for key in FINE] == ["", ""]
    assert reasons[BREAKS].startswith("fail: the backend crashed: the process died of SIGSEGV, in string_at at ")
    assert all(casualty.what == "crash" and BREAKS in casualty.keys for casualty in play.casualties)


@pytest.mark.parametrize(("at_once", "says"), [(1, "garbage is collected"), (3, "garbage is not collected")])
def test_no_collection_stops_plays_that_share_a_process(tmp_path: Path, at_once: int, says: str) -> None:
    play = Play(tmp_path)
    play.pool.play(plans("SaysWhoCollects", tmp_path), at_once)
    assert (tmp_path / "worker.log").read_text().splitlines() == [says] * 3


def test_a_process_that_exits_is_a_crash(tmp_path: Path) -> None:
    play = Play(tmp_path)
    play.pool.play(plans("Exits", tmp_path, scenarios=(BREAKS,)), 1)
    assert play.reasons() == {BREAKS: "fail: the backend crashed: the process exited with code 7"}


def test_an_adapter_that_dies_when_it_is_made_is_a_crash_of_every_scenario(tmp_path: Path) -> None:
    play = Play(tmp_path)
    play.pool.play(plans("DiesAtOnce", tmp_path), 3)
    died = "fail: the backend crashed: the process exited with code 3"
    assert play.reasons() == dict.fromkeys((*FINE, BREAKS), died)


def test_a_worker_that_dies_before_it_writes_leaves_a_trace_that_can_be_judged(tmp_path: Path) -> None:
    (plan,) = plans("Healthy", tmp_path, scenarios=(BREAKS,))
    Path(plan.trace).write_bytes(b'{"rec":"header","form')
    play = Play(tmp_path)
    play.pool.play([msgspec.structs.replace(plan, adapter="broken:DiesAtOnce")], 1)
    assert play.reasons() == {BREAKS: "fail: the backend crashed: the process exited with code 3"}


def test_a_drive_io_that_never_returns_is_a_hang_and_the_others_are_unaffected(tmp_path: Path) -> None:
    play = Play(tmp_path)
    play.pool.play(plans("Sleeps", tmp_path), 3)
    reasons = play.reasons()
    assert [reasons[key] for key in FINE] == ["", ""]
    assert reasons[BREAKS].startswith("fail: the backend hung: drive_io on session sub has not returned after ")
    assert play.casualties == []


def test_a_backend_that_holds_the_interpreter_is_killed_and_blamed(tmp_path: Path) -> None:
    play = Play(tmp_path, silence_s=1.5)
    play.pool.play(plans("HoldsInterpreter", tmp_path), 3)
    reasons = play.reasons()
    assert [reasons[key] for key in FINE] == ["", ""]
    assert reasons[BREAKS].startswith("fail: the backend hung: the process has not run for 2 s, in breaks at ")


def test_an_endless_loop_on_the_virtual_clock_is_killed_and_blamed(tmp_path: Path) -> None:
    play = Play(tmp_path, virtual=True, play_limit_s=1.0)
    play.pool.play(plans("SpinsForEver", tmp_path, virtual=True), 1)
    reasons = play.reasons()
    assert [reasons[key] for key in FINE] == ["", ""]
    assert reasons[BREAKS].startswith("fail: the backend hung: the play did not end, in breaks at ")


@pytest.mark.parametrize("virtual", [True, False])
def test_an_exception_is_the_verdict_of_its_scenario(tmp_path: Path, virtual: bool) -> None:
    play = Play(tmp_path, virtual=virtual)
    play.pool.play(plans("Raises", tmp_path, virtual=virtual), 3)
    reasons = play.reasons()
    assert [reasons[key] for key in FINE] == ["", ""]
    assert reasons[BREAKS].startswith(
        "fail: the backend failed: drive_io raised ValueError: no such sample at __init__.py:"
    )


def test_an_adapter_that_does_not_load_says_why(tmp_path: Path) -> None:
    play = Play(tmp_path)
    with pytest.raises(WorkerBroken, match="AttributeError: module 'broken' has no attribute 'Nonsense'"):
        play.pool.play(plans("Nonsense", tmp_path), 3)


def test_a_stopped_pool_ends_its_workers_and_keeps_what_was_played(tmp_path: Path) -> None:
    play = Play(tmp_path)
    play.pool.stop()
    play.pool.play(plans("Healthy", tmp_path), 3)
    assert play.ended == {}


def test_a_play_has_longer_on_a_crowded_host(monkeypatch: pytest.MonkeyPatch) -> None:
    found = []
    for load in (0.0, 8.0, 80.0, 4_000.0):
        monkeypatch.setattr(os, "getloadavg", lambda load=load: (load, 0.0, 0.0))
        monkeypatch.setattr(os, "cpu_count", lambda: 2)
        found.append(crowding())
    assert found == [1.0, 2.0, 10.0, 10.0]
