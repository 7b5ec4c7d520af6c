from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from nros_conformance.rmw.backend import Host
from nros_conformance.rmw.clock import MonotonicClock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.process import ProcessEnvironment
from tests.ports import leased_ports

BROKER = (
    sys.executable, "-S", "-c",
    "import os, socket, sys\n"
    "server = socket.create_server(('127.0.0.1', int(sys.argv[1])))\n"
    "print(os.getpid(), flush=True)\n"
    "while True: server.accept()",
    "{port}",
)  # fmt: skip


def environment(tmp_path: Path, *command: str, ready_s: float = 10.0) -> ProcessEnvironment:
    host = Host(clock=MonotonicClock(), scratch=tmp_path / "play.d", ports=leased_ports())
    return ProcessEnvironment(command, host, ready_s=ready_s)


@pytest.mark.parametrize("kill", [False, True])
def test_it_runs_from_start_to_stop_and_can_be_started_again(tmp_path: Path, kill: bool) -> None:
    broker = environment(tmp_path, *BROKER)
    for _ in range(2):
        broker.start()
        assert broker.endpoint() == f"127.0.0.1:{broker.port}"
        process = int(broker.log().splitlines()[-1])
        assert broker.processes() == (process,)
        os.kill(process, 0)
        broker.stop(kill=kill)
        assert broker.processes() == ()
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)
    broker.stop()


@pytest.mark.parametrize(("command", "message"), [
    (("no-such-broker", "{port}"), "there is no program 'no-such-broker' on this machine"),
    ((sys.executable, "-S", "-c", "print('port is taken'); raise SystemExit(3)"),
     f"{sys.executable} ended with 3: port is taken"),
    ((sys.executable, "-S", "-c", "raise SystemExit(4)"), f"{sys.executable} ended with 4: it printed nothing"),
])  # fmt: skip
def test_one_that_does_not_come_up_says_why(tmp_path: Path, command: tuple[str, ...], message: str) -> None:
    with pytest.raises(RmwError) as caught:
        environment(tmp_path, *command).start()
    assert (caught.value.code, caught.value.detail) == (ReturnCode.CONNECTION_FAILED, message)


def test_one_that_never_listens_is_given_up(tmp_path: Path) -> None:
    broker = environment(tmp_path, sys.executable, "-S", "-c", "import time; time.sleep(60)", ready_s=0.2)
    with pytest.raises(RmwError) as caught:
        broker.start()
    assert caught.value.detail == (
        f"{sys.executable} accepts no connection on port {broker.port} after 0.2 s: it printed nothing"
    )


def test_all_processes_of_a_play_compute_the_same_port(tmp_path: Path) -> None:
    host = Host(clock=MonotonicClock(), scratch=tmp_path, ports=range(12_000, 12_100), network=7)
    assert {ProcessEnvironment((), host).port for _ in range(2)} == {12_007}
