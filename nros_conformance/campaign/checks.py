"""What this host offers and lacks, each really tried, with the evidence that it costs and what brings it."""

from __future__ import annotations

import dataclasses
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Literal, TypeAlias

from nros_conformance.campaign.host import HostCheck, check_host
from nros_conformance.campaign.selection import decide, proven
from nros_conformance.judge.tolerances import LATE_FLOOR_NS
from nros_conformance.play.faketime import INSTALL, find_faketime
from nros_conformance.rmw.backtraces import find_debugger
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.declaration import Declaration
from nros_conformance.rmw.loading import find_compiler
from nros_conformance.suite.kinds import faults_needed
from nros_conformance.suite.loader import Suites

State: TypeAlias = Literal["ok", "ready", "slow", "missing", "broken"]

LOOPBACK = "127.0.0.1"
GROUP = "239.255.78.82"
"""A multicast group of the range that no router passes on (RFC 2365)."""

WAIT_S = 1.0
"""For a datagram or a connection on loopback, which takes microseconds."""

LIMIT_S = 5.0
"""For a child to be stopped, continued or killed."""

LATENESS_S = 2.0
"""How long the lateness of a sleeping thread is measured."""

PROCESS_FAULTS = ("crash", "freeze", "thaw")
"""The faults that the harness injects into a child process by signals."""

CLOCK_FAULTS = ("clock_step",)


@dataclasses.dataclass(frozen=True, slots=True)
class Check:
    """One thing that was looked at.

    ``says`` is what was found, ``costs`` the evidence that is lost without it, ``remedy`` what brings it:
    commands or instructions, one a line. A ``group`` of checks that are all right is one line.
    """

    name: str
    state: State
    says: str = ""
    costs: str = ""
    remedy: tuple[str, ...] = ()
    group: str = ""


Probe: TypeAlias = Callable[[], str]
"""Tries something: what is wrong, or an empty text."""


@dataclasses.dataclass(frozen=True, slots=True)
class Probes:
    """How each thing is tried. Tests put in ones that fail."""

    lateness: Callable[[], HostCheck] = lambda: check_host(LATENESS_S)
    loopback: Mapping[str, Probe] = dataclasses.field(
        default_factory=lambda: {"UDP": try_udp, "UDP multicast on lo": try_multicast, "TCP": try_tcp}
    )
    child: Probe = dataclasses.field(default_factory=lambda: try_child)
    faketime: Callable[[], Path | None] = dataclasses.field(default_factory=lambda: find_faketime)
    compiler: Callable[[], str] = dataclasses.field(default_factory=lambda: find_compiler)
    debugger: Callable[[], str] = dataclasses.field(default_factory=lambda: find_debugger)


def host_checks(host: HostCheck, suites: Suites, rows: Sequence[Declaration], probes: Probes) -> list[Check]:
    """All of them. ``rows``: the backends that are ready here, whose evidence is at stake."""
    return [
        check_lateness(host, rows),
        *(check_loopback(name, probe(), rows) for name, probe in probes.loopback.items()),
        check_child(probes.child(), suites, rows),
        check_faketime(probes.faketime(), suites, rows),
        check_compiled(
            "compiler", probes.compiler(), "run --native --headers cannot compare the layout of your headers",
            "apt install gcc",
        ),
        check_compiled(
            "debugger", probes.debugger(), "run --native cannot say where a library crashed",
            "apt install gdb",
        ),
    ]  # fmt: skip


def check_lateness(host: HostCheck, rows: Sequence[Declaration]) -> Check:
    """Whether timing can be judged: what is later than the judge's tolerance leaves verdicts unclear."""
    says = (
        f"a sleeping thread wakes {host.median_ms:.1f} ms late, {host.worst_ms:.1f} ms at worst "
        f"over {host.seconds:g} s"
    )  # fmt: skip
    floor_ms = LATE_FLOOR_NS / MS
    if host.worst_ms <= floor_ms:
        return Check("lateness", "ok", says)
    return Check(
        "lateness", "slow", says,
        costs=f"{says}; {_on_real(f'more than {floor_ms:g} ms leaves scenarios unclear on', rows)}",
        remedy=("let other work on this host end, or give it more cores",),
    )  # fmt: skip


def check_loopback(name: str, wrong: str, rows: Sequence[Declaration]) -> Check:
    """What middleware talks over. Declarations do not say what each one needs."""
    if not wrong:
        return Check(name, "ok", name, group="loopback")
    return Check(
        name, "missing", costs=f"{wrong}; {_on_real('no evidence from rows that talk over it: any of', rows)}",
        remedy=("ip link set lo up multicast on",),
    )  # fmt: skip


def check_child(wrong: str, suites: Suites, rows: Sequence[Declaration]) -> Check:
    """What stands behind the faults crash, freeze and thaw."""
    if not wrong:
        return Check("processes", "ok", "a child process can be stopped, continued and killed")
    return Check(
        "processes", "missing", costs=f"{wrong}; {evidence_lost(PROCESS_FAULTS, suites, rows)}",
        remedy=("allow signals to child processes, for instance in the container's seccomp profile",),
    )  # fmt: skip


def check_faketime(library: Path | None, suites: Suites, rows: Sequence[Declaration]) -> Check:
    """What steps the wall clock of a session's own process."""
    if library is not None:
        return Check("libfaketime", "ok", f"libfaketime: {library}")
    return Check(
        "libfaketime", "missing", costs=evidence_lost(CLOCK_FAULTS, suites, rows),
        remedy=(INSTALL, *_besides(CLOCK_FAULTS, suites, rows)),
    )  # fmt: skip


def check_compiled(name: str, tool: str, costs: str, remedy: str) -> Check:
    """What is used for compiled backends alone; they are played without it."""
    if tool:
        return Check(name, "ok", tool, group="compiled backends")
    return Check(name, "missing", costs=costs, remedy=(remedy,))


def evidence_lost(faults: Iterable[str], suites: Suites, rows: Sequence[Declaration]) -> str:
    """The requirements that no scenario proves without one of these faults, and on which rows."""
    lost: dict[tuple[str, ...], list[str]] = {}
    for row in rows:
        with_, without = set[str](), set[str]()
        for one in suites.scenarios:
            if decide(one, row).status != "not-applicable":
                (with_ if set(faults) & faults_needed(one.scenario) else without).update(proven(one))
        if requirements := tuple(sorted(with_ - without)):
            lost.setdefault(requirements, []).append(row.name)
    texts = [
        f"{', '.join(requirements)} {'stays' if len(requirements) == 1 else 'stay'} unexercised on {', '.join(names)}"
        for requirements, names in lost.items()
    ]
    return "; ".join(texts) or "nothing is lost: no scenario that applies here needs it"


def try_udp(address: str = LOOPBACK, to: str = "", wait_s: float = WAIT_S) -> str:
    """A datagram from one socket to another; ``to``: the address that it is sent to, if not ``address``."""
    try:
        with _udp(wait_s) as receiver, _udp(wait_s) as sender:
            receiver.bind((address, 0))
            sender.sendto(b"1", (to or address, receiver.getsockname()[1]))
            return _received(receiver)
    except OSError as error:
        return _reason(error)


def try_multicast(
    group: str = GROUP, interface: str = LOOPBACK, to: str = "", wait_s: float = WAIT_S
) -> str:  # fmt: skip
    """A datagram to a group that another socket has joined; ``to``: the group it is sent to, if not ``group``."""
    try:
        with _udp(wait_s) as receiver, _udp(wait_s) as sender:
            receiver.bind(("", 0))
            membership = socket.inet_aton(group) + socket.inet_aton(interface)
            receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(interface))
            sender.sendto(b"1", (to or group, receiver.getsockname()[1]))
            return _received(receiver)
    except OSError as error:
        return _reason(error)


def try_tcp(address: str = LOOPBACK, to: str = "", wait_s: float = WAIT_S) -> str:
    """A connection and a byte through it; ``to``: the address that is called, if not ``address``."""
    try:
        with socket.create_server((address, 0)) as listener:
            listener.settimeout(wait_s)
            with socket.create_connection((to or address, listener.getsockname()[1]), wait_s) as caller:
                called, _ = listener.accept()
                with called:
                    called.settimeout(wait_s)
                    caller.sendall(b"1")
                    return _received(called)
    except OSError as error:
        return _reason(error)


def try_child(
    stop: int = signal.SIGSTOP, resume: int = signal.SIGCONT, end: int = signal.SIGKILL, limit_s: float = LIMIT_S,
    command: Sequence[str] = (sys.executable, "-S", "-c", "import signal; signal.alarm(60); signal.pause()"),
) -> str:  # fmt: skip
    """A child process that is stopped, continued and killed; each must show within ``limit_s``."""
    try:
        child = os.posix_spawn(command[0], list(command), os.environ)
    except OSError as error:
        return f"no child process: {_reason(error)}"
    late = threading.Event()

    def give_up() -> None:
        late.set()
        os.kill(child, signal.SIGKILL)

    steps: tuple[tuple[str, int, int, Callable[[int], bool]], ...] = (
        ("stopped", stop, os.WUNTRACED, os.WIFSTOPPED),
        ("continued", resume, os.WCONTINUED, os.WIFCONTINUED),
        ("killed", end, 0, os.WIFSIGNALED),
    )
    alive = True
    try:
        for word, number, options, happened in steps:
            watchdog = threading.Timer(limit_s, give_up)
            watchdog.start()
            try:
                os.kill(child, number)
                _, status = os.waitpid(child, options)
            except OSError as error:
                return f"a child process cannot be {word}: {_reason(error)}"
            finally:
                watchdog.cancel()
                watchdog.join()
            alive = not (os.WIFSIGNALED(status) or os.WIFEXITED(status))
            if late.is_set() or not happened(status):
                return f"a child process is not {word} by {signal.Signals(number).name}"
    finally:
        if alive:  # none is left behind
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
    return ""


def _besides(faults: Iterable[str], suites: Suites, rows: Sequence[Declaration]) -> list[str]:
    """What stands against these scenarios, whatever is installed."""
    decisions = (
        decide(one, row) for row in rows for one in suites.scenarios if set(faults) & faults_needed(one.scenario)
    )  # fmt: skip
    reasons = {one.reason for one in decisions if one.status == "untested" and "libfaketime" not in one.reason}
    return [f"not enough by itself: {reason}" for reason in sorted(reasons)]


def _udp(wait_s: float) -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.settimeout(wait_s)
    return made


def _received(receiver: socket.socket) -> str:
    try:
        return "" if receiver.recv(1) == b"1" else "something else arrived"
    except TimeoutError:
        return f"nothing arrived within {receiver.gettimeout():g} s"


def _reason(error: OSError) -> str:
    return os.strerror(error.errno) if error.errno else str(error)


def _on_real(costs: str, rows: Iterable[Declaration]) -> str:
    """What is lost on the rows that meet the real host; a virtual clock stands still for it."""
    names = ", ".join(row.name for row in rows if row.behaviour.clock == "real")
    return f"{costs} {names}" if names else "nothing is lost: no row that is ready here runs on the real clock"
