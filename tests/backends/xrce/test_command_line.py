from __future__ import annotations

from pathlib import Path

import pytest

from nros_backends.xrce.agent.server import AgentServer
from nros_conformance.cli.main import main

RUN = ["run", "--backend", "xrce-embedded", "--scenario", "dsp.has-data"]


def test_a_run_uses_the_agent_that_the_user_names(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    heard: list[str] = []
    with AgentServer(watch=lambda direction, address, payload: heard.append(direction)) as server:
        code = main([*RUN, "--results", str(tmp_path), "--agent", f"127.0.0.1:{server.address[1]}"])
    assert code == 0, capsys.readouterr().out
    assert heard.count("in") > 20


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
