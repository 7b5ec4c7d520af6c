"""Each check is made to fail through its own seam."""

from __future__ import annotations

import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from nros_conformance.campaign.checks import (
    Check,
    check_child,
    check_faketime,
    check_lateness,
    check_loopback,
    evidence_lost,
    try_child,
    try_multicast,
    try_tcp,
    try_udp,
)
from nros_conformance.campaign.selection import decide
from nros_conformance.play.faketime import find_faketime
from nros_conformance.suite.loader import Suites
from tests.campaign.hosts import CALM, suites_of_faults
from tests.report.build import LVC, REFUSED, declare

NOWHERE = "192.0.2.1"
"""An address for documentation (RFC 5737): no host has it."""

BRIEF_S = 0.05


@pytest.fixture(scope="module")
def suites(tmp_path_factory: pytest.TempPathFactory) -> Suites:
    return suites_of_faults(tmp_path_factory.mktemp("suites"))


REAL = declare("cyclone")
VIRTUAL = declare("uorb", behaviour={"clock": "virtual"})

# --- what is really tried ---------------------------------------------------------------------------


def test_everything_works_on_a_host_that_runs_these_tests() -> None:
    assert [try_udp(), try_multicast(), try_tcp(), try_child()] == ["", "", "", ""]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: try_udp(NOWHERE), "Cannot assign requested address"),
        (lambda: try_udp(to="127.0.0.2", wait_s=BRIEF_S), "nothing arrived within 0.05 s"),
        (lambda: try_multicast(interface=NOWHERE), "No such device"),
        (lambda: try_multicast(group="127.0.0.1"), "Invalid argument"),
        (lambda: try_multicast(to="239.255.78.83", wait_s=BRIEF_S), "nothing arrived within 0.05 s"),
        (lambda: try_tcp(NOWHERE), "Cannot assign requested address"),
        (lambda: try_tcp(to="127.0.0.2"), "Connection refused"),
        (lambda: try_child(command=("/nowhere/python",)), "no child process: No such file or directory"),
    ],
)  # fmt: skip
def test_what_does_not_work_is_said(wrong: Any, said: str) -> None:
    assert wrong() == said


@pytest.mark.parametrize(("step", "word"), [("stop", "stopped"), ("resume", "continued"), ("end", "killed")])
def test_a_signal_that_does_nothing_is_noticed(step: str, word: str) -> None:
    harmless: dict[str, Any] = {step: signal.SIGWINCH}
    assert try_child(**harmless, limit_s=BRIEF_S) == f"a child process is not {word} by SIGWINCH"


def test_a_signal_that_kills_too_early_is_noticed() -> None:
    assert try_child(stop=signal.SIGKILL) == "a child process is not stopped by SIGKILL"


def test_a_signal_that_there_is_not_is_noticed() -> None:
    assert try_child(resume=4711) == "a child process cannot be continued: Invalid argument"


def test_the_library_is_found_where_distributions_put_it(tmp_path: Path) -> None:
    places = [(str(tmp_path), "faketime/libfaketimeMT.so.1"), (str(tmp_path), "*/faketime/libfaketimeMT.so.1")]
    assert find_faketime(places) is None
    library = tmp_path / "x86_64-linux-gnu" / "faketime" / "libfaketimeMT.so.1"
    library.parent.mkdir(parents=True)
    library.touch()
    assert find_faketime(places) == library


# --- what it costs, and what brings it --------------------------------------------------------------


def test_a_calm_host() -> None:
    says = "a sleeping thread wakes 0.3 ms late, 4.1 ms at worst over 2 s"
    assert check_lateness(CALM, [REAL]) == Check("lateness", "ok", says)
    assert check_lateness(replace(CALM, worst_ms=30.0), [REAL]).state == "ok"


def test_a_host_that_is_later_than_the_judge_tolerates() -> None:
    check = check_lateness(replace(CALM, worst_ms=30.1), [REAL, VIRTUAL])
    assert check.state == "slow"
    assert check.costs == (
        "a sleeping thread wakes 0.3 ms late, 30.1 ms at worst over 2 s; more than 30 ms leaves scenarios unclear "
        "on cyclone"
    )
    assert check.remedy == ("let other work on this host end, or give it more cores",)


def test_a_loopback_that_does_not_work() -> None:
    assert check_loopback("TCP", "", [REAL]) == Check("TCP", "ok", "TCP", group="loopback")
    assert check_loopback("TCP", "timed out", [REAL, VIRTUAL]) == Check(
        "TCP", "missing", costs="timed out; no evidence from rows that talk over it: any of cyclone",
        remedy=("ip link set lo up multicast on",),
    )  # fmt: skip
    assert check_loopback("TCP", "timed out", [VIRTUAL]).costs == (
        "timed out; nothing is lost: no row that is ready here runs on the real clock"
    )


def test_processes_that_cannot_be_stopped(suites: Suites) -> None:
    assert check_child("", suites, [REAL]) == Check(
        "processes", "ok", "a child process can be stopped, continued and killed"
    )  # fmt: skip
    check = check_child("a child process is not stopped by SIGSTOP", suites, [REAL])
    assert (check.name, check.state) == ("processes", "missing")
    assert check.costs == (
        "a child process is not stopped by SIGSTOP; LVC-001, LVC-004 stay unexercised on cyclone"
    )  # fmt: skip
    assert check.remedy == ("allow signals to child processes, for instance in the container's seccomp profile",)


def test_a_library_that_is_missing(suites: Suites) -> None:
    assert check_faketime(Path("/lib/f.so"), suites, [REAL]) == Check("libfaketime", "ok", "libfaketime: /lib/f.so")
    check = check_faketime(None, suites, [REAL])
    assert (check.name, check.state) == ("libfaketime", "missing")
    assert check.costs == "RDM-006 stays unexercised on cyclone"
    reasons = {decide(one, REAL).reason for one in suites.scenarios if one.scenario.id == "sample.step"}
    besides = [f"not enough by itself: {one}" for one in reasons if one and "libfaketime" not in one]
    assert check.remedy == ("apt install libfaketime", *besides)


def test_evidence_is_lost_where_no_other_scenario_that_applies_proves_it(suites: Suites) -> None:
    silent = declare("can", events={LVC: REFUSED})
    rows = [REAL, silent, declare("zenoh")]
    assert evidence_lost(["crash"], suites, rows) == "LVC-001, LVC-004 stay unexercised on cyclone, zenoh"
    assert evidence_lost(["clock_step"], suites, rows) == "RDM-006 stays unexercised on cyclone, can, zenoh"
    assert evidence_lost(["crash", "clock_step"], suites, rows) == (
        "LVC-001, LVC-004, RDM-006 stay unexercised on cyclone, zenoh; RDM-006 stays unexercised on can"
    )
    nothing = "nothing is lost: no scenario that applies here needs it"
    assert evidence_lost(["overflow"], suites, rows) == nothing
    assert evidence_lost(["clock_step"], suites, []) == nothing
