from __future__ import annotations

from pathlib import Path

import pytest

from nros_backends.xrce.agent.server import AgentServer
from nros_conformance.cli.main import main
from nros_conformance.report.results import read_report

RUN = ["run", "--backend", "xrce-embedded", "--scenario", "dsp.has-data"]


def test_a_run_uses_the_agent_that_the_user_names(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    heard: list[str] = []
    with AgentServer(watch=lambda direction, address, payload: heard.append(direction)) as server:
        code = main([*RUN, "--results", str(tmp_path), "--agent", f"127.0.0.1:{server.address[1]}"])
    assert code == 0, capsys.readouterr().out
    assert heard.count("in") > 20


def test_what_needs_to_stop_an_agent_that_somebody_else_runs_is_untested_and_the_rest_is_played(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenarios = [argument for one in ("con.any-stage", "con.death-is-noticed") for argument in ("--scenario", one)]
    run = ["run", "--backend", "xrce-external", *scenarios, "--results", str(tmp_path)]
    with AgentServer() as server:
        address = f"127.0.0.1:{server.address[1]}"
        assert main([*run, "--agent", address]) == 0, capsys.readouterr().out
    report = read_report(tmp_path / "xrce-external" / "report.json")
    found = {
        one.key: (one.status, one.reason)
        for one in report.results
        if one.id in ("con.any-stage", "con.death-is-noticed")
    }
    reason = f"the fault stop cannot be injected here: the agent at {address} is not ours to stop"
    assert found == {
        "con.any-stage": ("played", ""),
        "con.death-is-noticed[side=pub]": ("untested", reason),
        "con.death-is-noticed[side=sub]": ("untested", reason),
    }


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--agent", "nowhere"], "nros-conformance: --option: agent 'nowhere' is not HOST:PORT\n"),
        (
            ["--option", "agent"],
            "nros-conformance: --option: 'agent' is not NAME=VALUE; write --option agent=127.0.0.1:8888\n",
        ),
    ],
)
def test_options_that_are_none(
    tmp_path: Path, arguments: list[str], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*RUN, "--results", str(tmp_path), *arguments]) == 4
    assert capsys.readouterr().err == text
