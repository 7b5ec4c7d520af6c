from __future__ import annotations

import contextlib
import io
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from nros_backends.reference import ReferenceBackend
from nros_backends.uorb import UorbBackend
from nros_conformance.node import Context
from nros_conformance.rmw.backend import Backend, Host
from nros_conformance.rmw.clock import MS, VirtualClock
from tests.examples.adapters import (
    FiresTwice,
    LosesEverything,
    NeverFires,
    RefusesEveryEvent,
    RefusesManualLiveliness,
)

ROOT = Path(__file__).parents[2]
EXAMPLES = ("fail_over", "deadline_alarm", "slow_consumer")
README = (ROOT / "examples" / "README.md").read_text()


def printed(command: str) -> list[str]:
    """What the README says that a command prints."""
    found = re.search(rf"^`{re.escape(command)}`[^\n]*\n\n```text\n(.*?)```", README, re.DOTALL | re.MULTILINE)
    assert found is not None
    return found[1].splitlines()


def play(example: str, adapter: type[Backend]) -> tuple[bool, list[str], int]:
    """Run it on a virtual clock: whether it says that it worked, its lines, and how long it took in ms."""
    clock = VirtualClock()
    begin = clock.now_ns()
    lines: list[str] = []
    run = runpy.run_path(str(ROOT / "examples" / f"{example}.py"))["run"]
    with Context(adapter(Host(clock))) as context:
        worked = clock.run(lambda: run(context, lines.append))
    return worked, lines, (clock.now_ns() - begin) // MS


def run(
    example: str, backend: str | None = None, path: Path | None = None
) -> subprocess.CompletedProcess[str]:  # fmt: skip
    """Run it as a user does."""
    arguments = [] if backend is None else ["--backend", backend]
    environment = {**os.environ, **({"PYTHONPATH": str(path)} if path else {})}
    return subprocess.run(
        [sys.executable, str(ROOT / "examples" / f"{example}.py"), *arguments],
        capture_output=True, text=True, timeout=60, check=False, env=environment,
    )  # fmt: skip


# On a virtual clock every line is certain.


@pytest.mark.parametrize(("command", "adapter"), [
    ("fail_over.py", ReferenceBackend), ("fail_over.py --backend uorb", UorbBackend),
    ("deadline_alarm.py", ReferenceBackend), ("slow_consumer.py", UorbBackend), ("slow_consumer.py", ReferenceBackend),
])  # fmt: skip
def test_the_readme_shows_what_an_example_prints(command: str, adapter: type[Backend]) -> None:
    worked, lines, took_ms = play(command.partition(".py")[0], adapter)
    assert worked
    assert lines == printed(command)
    assert took_ms < 2_000


@pytest.mark.parametrize(("example", "adapter", "first"), [
    ("fail_over", RefusesEveryEvent,
        "LivelinessChanged: unsupported, the bridge watches the data (no sample for 300 ms)"),
    ("deadline_alarm", RefusesEveryEvent, "RequestedDeadlineMissed: unsupported, the alarm watches the time"),
    ("deadline_alarm", UorbBackend, "RequestedDeadlineMissed: unsupported, the alarm watches the time"),
    ("slow_consumer", RefusesEveryEvent, "MessageLost: unsupported, the consumer counts the gaps between frames"),
])  # fmt: skip
def test_without_the_event_an_example_falls_back_and_says_so(
    example: str, adapter: type[Backend], first: str
) -> None:  # fmt: skip
    worked, lines, _ = play(example, adapter)
    assert worked
    assert lines[0] == first
    assert lines[-1] == printed(f"{example}.py")[-1]


def test_the_fallbacks_see_what_the_events_tell() -> None:
    for example in ("deadline_alarm", "slow_consumer"):
        late = play(example, RefusesEveryEvent)[1][1:]
        if example == "deadline_alarm":
            assert late == printed("deadline_alarm.py")[1:]
        else:
            assert "dropped 3 pointcloud frames (total: 26)" in late


def test_a_commander_that_cannot_fall_silent_leaves() -> None:
    worked, lines, _ = play("fail_over", RefusesManualLiveliness)
    assert worked
    assert lines == [
        "LivelinessChanged: supported, the middleware watches the commander",
        "MANUAL_BY_TOPIC: refused, the commander leaves in place of falling silent",
        *printed("fail_over.py")[1:],
    ]


@pytest.mark.parametrize(("example", "adapter", "last"), [
    ("fail_over", NeverFires, "failed: requested 0, cleared 0"),
    ("fail_over", LosesEverything, "failed: requested 1, cleared 0"),
    ("deadline_alarm", NeverFires, "failed: total 0, the gaps between samples say 6 to 6"),
    ("deadline_alarm", FiresTwice, "failed: total 12, the gaps between samples say 6 to 6"),
    ("deadline_alarm", LosesEverything, "failed: total 0, the gaps between samples say 6 to 6"),
    ("slow_consumer", NeverFires, "failed: received 15 + lost 0 = 15, sent 41"),
    ("slow_consumer", LosesEverything, "failed: received 0 + lost 0 = 0, sent 65"),
])  # fmt: skip
def test_on_a_defective_backend_an_example_fails(example: str, adapter: type[Backend], last: str) -> None:
    worked, lines, took_ms = play(example, adapter)
    assert not worked
    assert lines[-1] == last
    assert took_ms < 2_500


# As a user runs them, on the real clock: what the host's load cannot change.


@pytest.mark.parametrize("backend", [None, "cyclone"])
def test_fail_over_runs(backend: str | None) -> None:
    if backend == "cyclone":
        pytest.importorskip("cyclonedds", reason="the extra nros-conformance[cyclone] is not installed")
    done = run("fail_over", backend)
    lines = iter(done.stdout.splitlines())
    assert done.returncode == 0, done.stdout + done.stderr
    for expected in printed("fail_over.py")[:-1]:
        assert expected in lines, done.stdout  # in this order
    assert re.fullmatch(r"worked: requested (\d+), cleared \1", list(lines)[-1])


@pytest.mark.parametrize("backend", [None, "uorb", "cyclone"])
def test_deadline_alarm_runs(backend: str | None) -> None:
    if backend == "cyclone":
        pytest.importorskip("cyclonedds", reason="the extra nros-conformance[cyclone] is not installed")
    done = run("deadline_alarm", backend)
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.splitlines()
    late = [re.fullmatch(r"IMU late: (\d+) missed deadlines \(total (\d+)\)", line) for line in lines]
    changes = [(int(found[1]), int(found[2])) for found in late if found is not None]
    total = sum(change for change, _ in changes)
    assert changes[-1][1] == total >= 6
    assert re.fullmatch(rf"worked: total {total}, the gaps between samples say \d+ to \d+", lines[-1])


@pytest.mark.parametrize("backend", [None, "cyclone"])
def test_slow_consumer_runs(backend: str | None) -> None:
    if backend == "cyclone":
        pytest.importorskip("cyclonedds", reason="the extra nros-conformance[cyclone] is not installed")
    done = run("slow_consumer", backend)
    assert done.returncode == 0, done.stdout + done.stderr
    last = done.stdout.splitlines()[-1]
    found = re.fullmatch(r"worked: received (\d+) \+ lost (\d+) = (\d+), sent (\d+)", last)
    assert found is not None, last
    received, lost, total, sent = map(int, found.groups())
    assert received + lost == total == sent >= 41


def test_a_pattern_that_did_not_work_is_exit_code_1() -> None:
    done = run("slow_consumer", "adapters:NeverFires", path=Path(__file__).parent)
    assert (done.returncode, done.stderr) == (1, "")
    assert done.stdout.splitlines()[-1] == "failed: received 15 + lost 0 = 15, sent 41"


@pytest.mark.parametrize("example", EXAMPLES)
def test_an_unknown_backend_is_told_in_one_line(example: str) -> None:
    done = run(example, "uorp")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "UNKNOWN_BACKEND (-17): no backend 'uorp'; did you mean 'uorb'?\n"


def test_the_awaits_of_the_readme_run() -> None:
    found = re.search(r"```python\n(.*?)```\n\n```text\n(.*?)```", README, re.DOTALL)
    assert found is not None
    with contextlib.redirect_stdout(io.StringIO()) as said:
        exec(compile(found[1], "README.md", "exec"), {})
    assert re.sub(r"late: \d+", "late: 1", said.getvalue()) == found[2]
