"""The whole text of ``doctor``, with probes that find everything, or nothing."""

from __future__ import annotations

import json
import platform
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import pytest

from nros_backends.uorb import UorbBackend
from nros_conformance.campaign.checks import (
    Check,
    Probes,
)
from nros_conformance.cli.codes import ExitCode
from nros_conformance.cli.doctor import check_backend, diagnose, stored
from nros_conformance.cli.main import main
from nros_conformance.formats.places import FormatError
from nros_conformance.report.results import Report, write_report
from nros_conformance.rmw.backend import Environment
from nros_conformance.rmw.discovery import Found, find_backend
from nros_conformance.rmw.process import ProcessEnvironment
from nros_conformance.suite.loader import Suites
from tests.campaign.hosts import CALM, suites_of_faults
from tests.report.build import declare, uorb

ADAPTERS = Path(__file__).parents[1] / "play" / "adapters"


@pytest.fixture(scope="module")
def suites(tmp_path_factory: pytest.TempPathFactory) -> Suites:
    return suites_of_faults(tmp_path_factory.mktemp("suites"))


WELL = Probes(
    lateness=lambda: CALM,
    loopback={"UDP": lambda: "", "UDP multicast on lo": lambda: "", "TCP": lambda: ""},
    child=lambda: "",
    faketime=lambda: Path("/usr/lib/faketime/libfaketime.so.1"),
    compiler=lambda: "/usr/bin/cc",
    debugger=lambda: "/usr/bin/gdb",
)
ILL = Probes(
    lateness=lambda: replace(CALM, cores=1, worst_ms=80.0),
    loopback={"UDP": lambda: "", "UDP multicast on lo": lambda: "No such device", "TCP": lambda: "timed out"},
    child=lambda: "a child process is not stopped by SIGSTOP",
    faketime=lambda: None,
    compiler=lambda: "",
    debugger=lambda: "",
)


# --- backends ---------------------------------------------------------------------------------------


def test_backends_that_are_ready() -> None:
    assert check_backend(find_backend("reference")) == Check(
        "reference", "ready", "the control of every run, virtual clock"
    )  # fmt: skip
    found = check_backend(find_backend("uorb"))
    assert (found.name, found.state) == ("uorb", "ready")
    assert found.says.endswith(", model, virtual clock")


def test_the_version_that_somebody_pins_is_named_beside_the_tested_one() -> None:
    subject = {
        "kind": "library", "says": "x", "package": "PX4 uORB (model)",
        "pinned": {"by": "nano-ros 0.5.0", "version": "1.0"},
    }  # fmt: skip
    found = replace(find_backend("uorb"), declaration=declare("uorb", subject=subject))
    tested = found.load()(None).versions()["PX4 uORB (model)"]  # type: ignore[arg-type]
    assert check_backend(found).says == (
        f"PX4 uORB (model) {tested}, library, real clock (nano-ros 0.5.0 pins 1.0: cells speak for {tested})"
    )
    subject["pinned"] = {"by": "nano-ros 0.5.0", "version": tested}
    found = replace(find_backend("uorb"), declaration=declare("uorb", subject=subject))
    assert check_backend(found).says == f"PX4 uORB (model) {tested}, library, real clock"


def test_a_backend_without_its_middleware() -> None:
    subject = {"kind": "library", "says": "x", "install": 'pip install "nros-conformance[zenoh]"'}
    found = Found("zenoh", "zenoh_that_is_not_there:Zenoh", declare("zenoh", subject=subject))
    assert check_backend(found) == Check(
        "zenoh", "missing", costs="no row of it: No module named 'zenoh_that_is_not_there'",
        remedy=('pip install "nros-conformance[zenoh]"',),
    )  # fmt: skip


class Brokerless(UorbBackend):
    """Its broker is not installed here."""

    def environment(self) -> Environment:
        return ProcessEnvironment(("no-such-broker", "{port}"), self.host)


def test_a_backend_without_its_broker() -> None:
    subject = {"kind": "library", "says": "x", "install": "apt install no-such-broker"}
    found = Found("mqtt", f"{__name__}:Brokerless", declare("mqtt", subject=subject))
    assert check_backend(found) == Check(
        "mqtt", "missing", costs="no row of it: there is no program 'no-such-broker' on this machine",
        remedy=("apt install no-such-broker",),
    )  # fmt: skip
    found = replace(found, declaration=declare("mqtt", subject=subject, variants={"router": {}, "own": {}}))
    assert check_backend(found).costs == "no row of it: router: there is no program 'no-such-broker' on this machine"


@pytest.mark.parametrize(
    ("adapter", "why"),
    [
        ("json:loads", "loads is no adapter; derive it from nros_conformance.rmw.backend.Backend"),
        ("json:Backend", "there is no class 'Backend'"),
    ],
)
def test_a_backend_that_breaks_when_it_is_loaded(adapter: str, why: str) -> None:
    assert check_backend(Found("mqtt", adapter, declare("mqtt"))) == Check(
        "mqtt", "broken", costs=f"{json.__file__}: {why}"
    )  # fmt: skip


def test_a_declaration_that_cannot_be_read() -> None:
    error = FormatError("backend.toml", 9, "unknown event 'LivelinesChanged'", "did you mean 'LivelinessChanged'?")
    assert check_backend(Found("mqtt", "mqtt:Mqtt", error=error)) == Check(
        "mqtt", "broken", costs="backend.toml:9: unknown event 'LivelinesChanged'; did you mean 'LivelinessChanged'?"
    )  # fmt: skip


# --- results ----------------------------------------------------------------------------------------


def test_results_that_would_merge_and_that_would_not(suites: Suites, tmp_path: Path) -> None:
    def left(name: str, **fields: Any) -> None:
        one: Report = msgspec.structs.replace(uorb(), row=name, **fields)
        write_report(tmp_path, one)

    assert stored(tmp_path, suites) == []
    left("can", digest=suites.digest)
    left("cyclone", digest=suites.digest, partial=True)
    left("uorb", suites_version="0.9")
    left("zenoh")
    (tmp_path / "xrce").mkdir()
    (tmp_path / "xrce" / "report.json").write_text("{}", encoding="utf-8")
    assert stored(tmp_path, suites) == [
        "can (suites 1.0)",
        "cyclone (suites 1.0, partial)",
        "uorb (suites 0.9: will not merge)",
        "xrce (cannot be read: play it again)",
        "zenoh (other suites 1.0: will not merge)",
    ]


# --- the whole --------------------------------------------------------------------------------------

BACKENDS = [
    find_backend("reference"),
    Found(
        "zenoh", "zenoh_that_is_not_there:Zenoh",
        declare("zenoh", subject={"kind": "library", "says": "x", "install": "pip install zenoh"}),
    ),
    Found("mqtt", "mqtt:Mqtt", error=FormatError("nros_mqtt/backend.toml", 9, "unknown event 'LivelinesChanged'",
                                                 "did you mean 'LivelinessChanged'?")),
]  # fmt: skip


def ready(name: str) -> Found:
    """The model of uORB under another name, on the real clock."""
    return replace(find_backend("uorb"), name=name, declaration=declare(name))


def test_the_whole_of_a_host_that_is_well(suites: Suites, tmp_path: Path) -> None:
    text, code = diagnose(suites, [BACKENDS[0], ready("own")], tmp_path, named=False, probes=WELL)
    version = ready("own").load()(None).versions()["PX4 uORB (model)"]  # type: ignore[arg-type]
    assert code is ExitCode.OK
    assert text == (
        f"nros-conformance 0.1.0   Python {platform.python_version()}   suites 1.0: 3 scenarios, 90 requirements\n"
        "\n"
        "host     2 cores\n"
        "  ok       a sleeping thread wakes 0.3 ms late, 4.1 ms at worst over 2 s\n"
        "  ok       loopback: UDP, UDP multicast on lo, TCP\n"
        "  ok       a child process can be stopped, continued and killed\n"
        "  ok       libfaketime: /usr/lib/faketime/libfaketime.so.1\n"
        "  ok       compiled backends: /usr/bin/cc, /usr/bin/gdb\n"
        "\n"
        "backends\n"
        "  ready    reference     the control of every run, virtual clock\n"
        f"  ready    own           PX4 uORB (model) {version}, library, real clock\n"
        "\n"
        f"results  {tmp_path}: none yet\n"
        "\n"
        "2 of 2 backends are ready. Next:  nros-conformance run --profile smoke\n"
        "exit 0: nothing was asked for by name"
    )


def test_the_whole_of_a_host_that_lacks_everything(suites: Suites) -> None:
    text, code = diagnose(suites, [*BACKENDS, ready("own")], Path("runs"), named=True, probes=ILL)
    assert code is ExitCode.NOTHING
    lines = text.splitlines()
    assert max(map(len, lines)) <= 96
    assert lines[2:23] == [
        "host     1 core",
        "  slow     lateness      a sleeping thread wakes 0.3 ms late, 80.0 ms at worst over 2 s; more",
        "                         than 30 ms leaves scenarios unclear on own",
        "                         let other work on this host end, or give it more cores",
        "  ok       loopback: UDP",
        "  missing  UDP multicast on lo  No such device; no evidence from rows that talk over it: any of",
        "                         own",
        "                         ip link set lo up multicast on",
        "  missing  TCP           timed out; no evidence from rows that talk over it: any of own",
        "                         ip link set lo up multicast on",
        "  missing  processes     a child process is not stopped by SIGSTOP; LVC-001, LVC-004 stay",
        "                         unexercised on own",
        "                         allow signals to child processes, for instance in the container's",
        "                         seccomp profile",
        "  missing  libfaketime   RDM-006 stays unexercised on own",
        "                         apt install libfaketime",
        "                         not enough by itself: the fault clock_step cannot be injected here",
        "  missing  compiler      run --native --headers cannot compare the layout of your headers",
        "                         apt install gcc",
        "  missing  debugger      run --native cannot say where a library crashed",
        "                         apt install gdb",
    ]
    begin = lines.index("backends")
    assert lines[begin : begin + 6] == [
        "backends",
        "  ready    reference     the control of every run, virtual clock",
        "  missing  zenoh         no row of it: No module named 'zenoh_that_is_not_there'",
        "                         pip install zenoh",
        "  broken   mqtt          nros_mqtt/backend.toml:9: unknown event 'LivelinesChanged'; did you",
        "                         mean 'LivelinessChanged'?",
    ]
    assert lines[-5:] == [
        "",
        "results  runs: none yet",
        "",
        "2 of 4 backends are ready. Next:  nros-conformance run --backend own --profile smoke",
        "exit 5: not available: zenoh, mqtt",
    ]


@pytest.mark.parametrize(
    ("found", "named", "end"),
    [
        (BACKENDS[1:2], False, "0 of 1 backend is ready.\nexit 0: nothing was asked for by name "
                               "(doctor --backend zenoh would exit 5)"),
        (BACKENDS[:2], False, "1 of 2 backends is ready.\nexit 0: nothing was asked for by name "
                              "(doctor --backend zenoh would exit 5)"),
        (BACKENDS[:1], True, "1 of 1 backend is ready.\nexit 0"),
        ([], False, "backends\n  none is installed; run: pip install -e .\n\nresults  runs: none yet\n\n"
                    "0 of 0 backends are ready.\nexit 0: nothing was asked for by name"),
    ],
)  # fmt: skip
def test_how_it_ends(found: list[Found], named: bool, end: str, suites: Suites) -> None:
    text, _ = diagnose(suites, found, Path("runs"), named=named, probes=WELL)
    assert text.endswith(f"\n{end}")


# --- as a command -----------------------------------------------------------------------------------


def test_the_command_on_this_host(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--backend", "uorb", "--results", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "  ok       loopback: UDP, UDP multicast on lo, TCP\n" in out
    assert "  ready    uorb          PX4 uORB (model) " in out
    assert out.endswith("\nexit 0\n")


def test_a_named_backend_that_is_not_available_is_exit_code_5(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "nros_conformance.cli.main", "doctor", "--backend", "absent:AbsentBackend",
         "--results", str(tmp_path)],
        capture_output=True, text=True, check=False, env={"PYTHONPATH": str(ADAPTERS), "PATH": ""},
    )  # fmt: skip
    assert done.returncode == 5
    assert (
        "  missing  absent        no row of it: No module named 'middleware_that_is_not_there'\n"
        "                         pip install middleware-that-is-not-there\n"
    ) in done.stdout
    assert done.stdout.endswith("0 of 1 backend is ready.\nexit 5: not available: absent\n")


def test_a_name_that_nothing_has_is_a_usage_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--backend", "cyclon"]) == 4
    assert capsys.readouterr().err == "nros-conformance: no backend 'cyclon'; did you mean 'cyclone'?\n"
