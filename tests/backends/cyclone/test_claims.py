"""What a run makes of an adapter that lost a status, and of a declaration that lost a claim."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import nros_backends.cyclone
from nros_conformance.report.results import read_report
from nros_conformance.report.table import assemble
from nros_conformance.suite.loader import load_suites

DECLARATION = Path(nros_backends.cyclone.__file__).with_name("backend.toml").read_text(encoding="utf-8")
SCENARIOS = [
    argument for pattern in ("reg.raises-requested-*", "reg.absent-requested-*", "rdm.silence-after-data*")
    for argument in ("--scenario", pattern)
]  # fmt: skip

DEAF = """\
import nros_backends.cyclone.backend as original
from cyclonedds.core import DDSStatus
from nros_backends.cyclone.native import Native


class _Deaf(Native):
    def status_changes(self, entity):
        return super().status_changes(entity) & ~DDSStatus.RequestedDeadlineMissed


original.Native = _Deaf
Backend = original.CycloneBackend
"""


def run(folder: Path, code: str, declaration: str) -> subprocess.CompletedProcess[str]:
    package = folder / "variant"
    package.mkdir()
    (package / "__init__.py").write_text(code, encoding="utf-8")
    (package / "backend.toml").write_text(
        declaration.replace('name    = "cyclone"', 'name    = "variant"'), encoding="utf-8"
    )
    return subprocess.run(
        [sys.executable, "-m", "nros_conformance.cli.main", "run", "--backend", "variant:Backend",
         "--results", str(folder / "results"), *SCENARIOS],
        capture_output=True, text=True, check=False, env={"PYTHONPATH": str(folder), "PATH": ""},
    )  # fmt: skip


def cell(folder: Path) -> str:
    """The word in the column of RequestedDeadlineMissed."""
    report = read_report(folder / "results" / "variant")
    (row,) = assemble([report], load_suites().levels).rows
    return row.cell("RequestedDeadlineMissed").text


# A host that was too slow for a verdict says so, and says nothing else.


def test_the_adapter_as_it_is_passes(tmp_path: Path) -> None:
    done = run(tmp_path, "from nros_backends.cyclone import CycloneBackend as Backend\n", DECLARATION)
    assert (done.returncode, cell(tmp_path)) in [(0, "yes°"), (8, "unclear°")], done.stdout


def test_a_status_that_is_no_longer_polled_turns_its_cell_broken(tmp_path: Path) -> None:
    done = run(tmp_path, DEAF, DECLARATION)
    line, word = {1: ("FAIL  variant ", "broken"), 8: ("unclear  variant", "unclear")}[done.returncode]
    assert cell(tmp_path).rstrip("°") == word
    assert f"{line} reg.raises-requested-deadline-missed[deadline=in-qos]" in done.stdout


def test_a_claim_that_is_no_longer_made_is_said_to_be_missing(tmp_path: Path) -> None:
    without = re.sub(r"\[events\.RequestedDeadlineMissed\]\n(?:.+\n)+", "", DECLARATION)
    assert without != DECLARATION
    done = run(tmp_path, "from nros_backends.cyclone import CycloneBackend as Backend\n", without)
    assert done.returncode == 1
    assert cell(tmp_path) == "undeclared"
    report = read_report(tmp_path / "results" / "variant")
    assert any("[events.RequestedDeadlineMissed]" in difference.text for difference in report.differences)
    for difference in report.differences:
        assert f"differs  {difference.text}" in done.stdout


@pytest.mark.parametrize("left_out", [line for line in SCENARIOS if not line.startswith("--")])
def test_every_pattern_of_this_test_selects_something(left_out: str) -> None:
    listed = subprocess.run(
        [sys.executable, "-m", "nros_conformance.cli.main", "list", "scenarios"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert re.search(re.escape(left_out).replace(r"\*", ".*"), listed)
