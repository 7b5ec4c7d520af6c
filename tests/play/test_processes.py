from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from nros_conformance.play import preloaded, processes
from nros_conformance.play.faketime import NoFaketime, find_faketime, lacking, preload
from nros_conformance.play.plan import Plan
from nros_conformance.play.player import play as play_on
from nros_conformance.play.processes import SessionProcess, death
from nros_conformance.rmw.clock import MS, MonotonicClock
from nros_conformance.trace.records import Act, AnyRecord, End, FaultRecord, Header, Matched, Message, Spin, State
from tests.play.datagrams import DatagramBackend
from tests.play.scripts import acts, of

FAR = {"far": {"process": "own"}}
PAIR = {
    "talker": {"publisher": "sensor", "session": "far", "register": "none"},
    "listener": {"subscription": "sensor", "register": "none"},
}
EXPECT = [{"never": "MessageLost", "of": "ALL", "proves": "MSL-002"}]

needs_faketime = pytest.mark.skipif(find_faketime() is None, reason="libfaketime is not installed")

BOTH_KINDS = pytest.mark.parametrize("stepped", [False, pytest.param(True, marks=needs_faketime)])


def play(
    tmp_path: Path, script: list[Any], *, publish: str = "", hang_ns: int = 5_000 * MS, **fields: Any
) -> list[Any]:
    scenario = {"id": "x.y", "title": "t", "sessions": FAR, "entities": PAIR, "script": script, "expect": EXPECT}
    quantities = {"T": 20 * MS, "tolerance": 0, "early": 0, "discovery_bound": 10_000 * MS}
    header = Header(
        scenario={**scenario, **fields}, suite="x", backend="datagrams", clock="real", quantities=quantities, start=0
    )
    plan = Plan(
        key="x.y", adapter="tests.play.datagrams:DatagramBackend", header=header, trace=str(tmp_path / "x.jsonl"),
        options={"publish": publish}, hang_ns=hang_ns,
    )  # fmt: skip
    records: list[Header | AnyRecord] = []
    play_on(plan, DatagramBackend, MonotonicClock(), records.append)
    return records[1:]


def ended(records: list[Any]) -> tuple[str, str]:
    end = records[-1]
    assert isinstance(end, End)
    return end.outcome, end.detail


def test_a_sample_goes_from_one_process_to_another_and_is_known_by_name(tmp_path: Path) -> None:
    data = {"do": "publish", "by": "talker", "every": "0.5T", "times": 3, "as": "data"}
    records = play(tmp_path, ["settle", data, {"drive": "1T"}, {"do": "take", "from": "listener"}])
    assert ended(records) == ("done", "")
    (matched,) = of(records, Matched)
    assert (matched.publisher, matched.subscription, matched.how) == ("talker", "listener", "adapter")
    taken = [(one.publisher, one.label, one.sequence) for one in of(records, Message)]
    assert taken == [("talker", "data", 1), ("talker", "data", 2), ("talker", "data", 3)]
    first, *_, last = acts(records, "data")
    assert (first.session, first.entity, first.result, last.index) == ("far", "talker", 0, 2)
    assert first.begin - first.due < last.begin - first.begin + 10_000 * MS  # on one clock
    assert any(spin.session == "far" for spin in of(records, Spin))


def test_samples_of_another_process_are_lost_there(tmp_path: Path) -> None:
    lose = {"fault": "lose", "of": "talker", "count": 3, "as": "hole"}
    data = {"do": "publish", "by": "talker", "as": "data"}
    records = play(tmp_path, ["settle", lose, data, {"drive": "1T"}, {"do": "take", "from": "listener"}])
    assert ended(records) == ("done", "")
    assert [(one.session, one.result) for one in acts(records, "hole")] == [("far", 0)] * 3
    assert [(fault.label, fault.of, fault.detail) for fault in of(records, FaultRecord)] == [
        ("hole", "talker", {"code": 0})
    ]
    assert [(one.label, one.sequence) for one in of(records, Message)] == [("data", 4)]


def test_the_session_lives_in_another_process_and_its_records_say_so(tmp_path: Path) -> None:
    records = play(tmp_path, [{"do": "destroy", "of": "far", "as": "bye"}])
    states = [(one.session, one.entity, one.what) for one in of(records, State) if one.session == "far"]
    assert states == [
        ("far", "", "created"),
        ("far", "talker", "created"),
        ("far", "", "destroyed"),
    ]
    (bye,) = acts(records, "bye")
    assert bye.result == 0


def test_a_crash_ends_the_session_and_a_create_brings_it_back_with_new_numbers(tmp_path: Path) -> None:
    data = {"do": "publish", "by": "talker", "as": "data"}
    again = [{"do": "create", "entity": "talker", "as": "born"}, {"do": "publish", "by": "talker", "as": "more"}]
    records = play(
        tmp_path, ["settle", data, {"fault": "crash", "of": "far", "as": "gone"}, {"drive": "2T"}, *again,
                   {"drive": "1T"}, {"do": "take", "from": "listener"}],
        entities={**PAIR, "talker": {**PAIR["talker"]}},
    )  # fmt: skip
    assert ended(records) == ("done", "")
    (gone,) = of(records, FaultRecord)
    assert (gone.fault, gone.of, gone.detail) == ("crash", "far", {"code": 0})
    (born,) = acts(records, "born")
    assert not [spin for spin in of(records, Spin) if spin.session == "far" and gone.end < spin.begin < born.due]
    assert [(one.label, one.sequence) for one in of(records, Message)] == [("data", 1), ("more", 100_001)]


def test_a_frozen_process_does_nothing_until_it_is_thawed(tmp_path: Path) -> None:
    records = play(
        tmp_path,
        ["settle", {"fault": "freeze", "of": "far", "as": "still"}, {"drive": "5T"},
         {"fault": "thaw", "of": "far", "as": "on"}, {"do": "publish", "by": "talker"}, {"drive": "2T"}],
    )  # fmt: skip
    assert ended(records) == ("done", "")
    still, on = of(records, FaultRecord)
    assert on.begin - still.end >= 100 * MS
    far = [spin for spin in of(records, Spin) if spin.session == "far"]
    assert not [spin for spin in far if still.end < spin.begin < on.begin or still.end < spin.end < on.begin]
    assert [spin for spin in far if spin.begin > on.end]


def test_a_play_may_end_with_a_frozen_process(tmp_path: Path) -> None:
    records = play(tmp_path, [{"fault": "freeze", "of": "far"}])
    assert ended(records) == ("done", "")


@pytest.mark.parametrize(("publish", "outcome", "detail"), [
    ("segfault", "crash", "the process of session far died of SIGSEGV"),
    ("exit", "crash", "the process of session far exited with code 3"),
    ("hang", "hang", "publish on session far has not returned"),
    ("raise", "raised", "publish raised ValueError: no such thing at datagrams.py:"),
])  # fmt: skip
def test_what_a_backend_does_to_its_own_process_is_the_verdict(
    tmp_path: Path, publish: str, outcome: str, detail: str
) -> None:
    script = [{"do": "publish", "by": "talker"}, {"drive": "2T"}]
    ended_as, why = ended(play(tmp_path, script, publish=publish, hang_ns=1_000 * MS))
    assert (ended_as, why[: len(detail)]) == (outcome, detail)


@needs_faketime
def test_the_wall_clock_is_stepped_there_and_nowhere_else(tmp_path: Path) -> None:
    ask = {"do": "supports", "of": "talker", "kind": 0}
    script = [
        {**ask, "as": "before"},
        {"fault": "clock_step", "of": "far", "by": "1000000h"},
        {**ask, "as": "after"},
        {"do": "supports", "of": "listener", "kind": 0, "as": "here"},
        {"fault": "clock_step", "of": "far", "by": "-1000000h"},
        {**ask, "as": "back"},
    ]
    records = play(tmp_path, script)
    assert ended(records) == ("done", "")
    answers = [acts(records, label)[0].result for label in ("before", "after", "here", "back")]
    assert answers == [False, True, False, False]
    times = [one.begin for one in of(records, Act) if one.session == "far"]
    assert times == sorted(times)  # the monotonic clock is left alone


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    one = preloaded.Server()
    monkeypatch.setattr(preloaded, "server", one)
    yield
    one.stop()


@needs_faketime
@pytest.mark.usefixtures("server")
def test_a_process_that_is_long_in_starting_is_no_backend_that_hangs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = tmp_path / "python"
    slow.write_text(f'#!/bin/sh\nsleep 1.5\nexec {sys.executable} "$@"\n')
    slow.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(slow))
    step = {"fault": "clock_step", "of": "far", "by": "1h"}
    records = play(tmp_path, [{"drive": "1T"}, step, {"do": "publish", "by": "talker"}], hang_ns=1_000 * MS)
    assert ended(records) == ("done", "")


@needs_faketime
@pytest.mark.usefixtures("server")
@pytest.mark.parametrize(("script", "start_ms", "why"), [
    ("sh\nexec sleep 60", 100, "has not started within 0.1 s"),
    ("sh\nexit 1", 60_000, "has ended"),
    # what the moment between an ending process' last closed descriptor and its end looks like
    ("python3\nimport os, signal, sys\nos.close(int(sys.argv[-1]))\nsignal.pause()", 60_000, "has ended"),
], ids=["too late", "ends", "ending"])  # fmt: skip
def test_a_process_that_does_not_start_is_told_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, start_ms: int, why: str
) -> None:
    python = tmp_path / "python"
    python.write_text(f"#!/usr/bin/env {script}\n")
    python.chmod(0o755)
    step = {"fault": "clock_step", "of": "far", "by": "1h"}
    with monkeypatch.context() as broken:
        broken.setattr(sys, "executable", str(python))
        broken.setattr(processes, "START_NS", start_ms * MS)
        records = play(tmp_path, [{"drive": "1T"}, step])
    assert ended(records) == ("error", f"the process of session far: the interpreter with libfaketime {why}")
    assert ended(play(tmp_path, [{"drive": "1T"}, step])) == ("done", ""), "the next one is started anew"


@needs_faketime
def test_who_gives_up_late_does_not_end_the_new_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    idle = tmp_path / "python"
    idle.write_text("#!/bin/sh\nexec sleep 60\n")
    idle.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(idle))
    server = preloaded.Server()
    with contextlib.closing(socket.socket()) as some:
        old = server.fork(some.fileno())
        server.give_up(old)
        new = server.fork(some.fileno())
    server.give_up(old)
    assert old.poll() == -signal.SIGKILL
    assert new.poll() is None
    server.stop()
    assert new.poll() == -signal.SIGKILL


def test_without_the_library_it_is_said_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nros_conformance.play.faketime.find_faketime", lambda: None)
    assert lacking() == {"clock_step": "libfaketime is not installed (apt install libfaketime)"}
    with pytest.raises(NoFaketime, match=r"^libfaketime is not installed; apt install libfaketime$"):
        preload()


@pytest.mark.parametrize(("code", "text"), [
    (-9, "died of SIGKILL"), (3, "exited with code 3"), (None, "has closed its connection but still runs"),
])  # fmt: skip
def test_a_death_in_words(code: int | None, text: str) -> None:
    assert death(code) == text


@BOTH_KINDS
def test_a_process_is_gone_when_kill_returns(stepped: bool) -> None:
    process = SessionProcess("far", stepped=stepped)
    process.freeze()
    assert process.wait(0) is None
    process.kill()
    assert process.wait(0) == -signal.SIGKILL
    process.connection.close()


@BOTH_KINDS
def test_a_process_ends_when_nobody_talks_to_it(stepped: bool) -> None:
    other = SessionProcess("other", stepped=stepped)
    process = SessionProcess("far", stepped=stepped)
    process.connection.close()
    assert process.wait(60) == 0
    assert other.wait(0) is None
    other.kill()
    other.connection.close()


@BOTH_KINDS
def test_children_die_with_their_parent(stepped: bool) -> None:
    code = (
        "import sys, time\n"
        "from nros_conformance.play.processes import SessionProcess\n"
        f"one = SessionProcess('far', stepped={stepped})\n"
        "one.connection.send_bytes(b'')\n"
        "one.connection.recv_bytes()\n"  # it has begun, and complains
        "one.freeze()\n"
        "print(one.pid, flush=True)\n"
        "time.sleep(60)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    parent.stdout.close()
    limit = time.monotonic() + 20
    while _runs(child) and time.monotonic() < limit:
        time.sleep(0.01)
    assert not _runs(child)


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
