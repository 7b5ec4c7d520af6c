"""Commands that other packages bring through the entry-point group."""

from __future__ import annotations

import argparse
import importlib.metadata
import types

import pytest

from nros_conformance.cli import extras
from nros_conformance.cli.main import main


class Entry:
    """An entry point as far as it is looked at."""

    def __init__(self, name: str, module: types.SimpleNamespace | ImportError) -> None:
        self.name = name
        self.module = module

    def load(self) -> types.SimpleNamespace:
        if isinstance(self.module, ImportError):
            raise self.module
        return self.module


def install(monkeypatch: pytest.MonkeyPatch, *entries: Entry) -> None:
    def entry_points(*, group: str) -> list[Entry]:
        assert group == "nros_conformance.commands"
        return list(entries)

    monkeypatch.setattr(importlib.metadata, "entry_points", entry_points)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--code", type=int, required=True)


GREET = types.SimpleNamespace(HELP="greet somebody", add_arguments=add_arguments, run=lambda options: options.code)


def test_a_command_of_another_package_is_listed_and_run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    install(monkeypatch, Entry("greet", GREET))
    assert main(["greet", "--code", "7"]) == 7
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "greet somebody" in capsys.readouterr().out


def test_a_command_that_cannot_be_imported_says_why(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    install(monkeypatch, Entry("greet", ImportError("No module named 'hello'")))
    assert main(["greet"]) == 5
    assert capsys.readouterr().err == (
        "nros-conformance: the command greet is not available: No module named 'hello'\n"
    )


def test_our_own_commands_are_not_replaced_and_do_not_look_for_others(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    install(monkeypatch, Entry("list", GREET))
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "greet somebody" not in capsys.readouterr().out
    monkeypatch.setattr(extras, "add_extras", lambda commands: pytest.fail("looked for more commands"))
    assert main(["list", "suites"]) == 0


def test_the_agent_of_the_xrce_backend_is_a_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["xrce-agent", "--help"])
    assert caught.value.code == 0
    assert "Run an XRCE agent on UDP, for our clients or any other." in capsys.readouterr().out
