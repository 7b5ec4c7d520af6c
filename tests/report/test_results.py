from __future__ import annotations

import json
import os
from datetime import date
from pathlib import Path

import msgspec
import pytest

from nros_conformance.judge.results import Finding
from nros_conformance.report.results import (
    FORMAT,
    Incident,
    ReportError,
    decode_report,
    encode_report,
    folder_for,
    read_latest,
    read_report,
    read_reports,
    same_suites,
    write_report,
)
from tests.report.build import LVC, canonical, cyclone, declare, known, registered, report, result, uorb


def test_a_report_survives_its_file_with_everything_in_it(tmp_path: Path) -> None:
    declaration = declare(
        known=[known("LVC-009", "lvc.frozen", review=date(2027, 5, 1))], bounds={"discovery": "500 ms"}
    )
    detailed = Finding(name="periodic", proves=("RDM-001",), outcome="fail", nearest_ns=4_000_000, at=1, got="one")
    whole = report(
        declaration,
        [canonical(LVC, fired={0: 3}), result("a.b[k=1]", parameters={"k": 1}, findings=[detailed])],
        observations=[registered(0), registered(0)],
        incidents=(Incident(what="crash", detail="signal 11", scenarios=("a.b[k=1]",), reproduced=True),),
        host={"cores": 2},
    )
    file = write_report(tmp_path, whole)
    assert file == tmp_path / "demo" / "report.json"
    assert read_report(file) == whole
    assert read_report(tmp_path / "demo") == whole
    assert whole.observations[0].count == 2


def test_writing_again_replaces_the_file_and_leaves_nothing_beside_it(tmp_path: Path) -> None:
    write_report(tmp_path, report(seconds=1.0))
    write_report(tmp_path, report(seconds=2.0))
    assert read_report(tmp_path / "demo").seconds == 2.0
    assert [file.name for file in (tmp_path / "demo").iterdir()] == ["report.json"]


def test_a_write_that_fails_leaves_the_old_report(tmp_path: Path) -> None:
    file = write_report(tmp_path, report(seconds=1.0))

    class Unwritable:
        def __str__(self) -> str:
            raise RuntimeError("cannot be written")

    with pytest.raises(RuntimeError, match="cannot be written"):
        write_report(tmp_path, report(host={"name": Unwritable()}))
    assert read_report(file).seconds == 1.0
    assert [one.name for one in file.parent.iterdir()] == ["report.json"]


def test_all_reports_of_a_directory_are_read(tmp_path: Path) -> None:
    for one in (uorb(), cyclone()):
        write_report(tmp_path, one)
    assert [one.row for one in read_reports(tmp_path)] == ["cyclone", "uorb"]


@pytest.mark.parametrize(("text", "why"), [
    ("", ", or cut short; run again"), ("not json", ", or cut short; run again"),
    ('{"format": 1, "tool": "0.1.0"', ", or cut short; run again"),
    ("[]", ""), ('{"tests": 3}', ""), ('{"format": "one", "tool": "x"}', ""),
])  # fmt: skip
def test_what_is_not_a_report_is_refused(tmp_path: Path, text: str, why: str) -> None:
    file = tmp_path / "report.json"
    file.write_text(text)
    with pytest.raises(ReportError) as error:
        read_report(file)
    assert str(error.value) == f"{file}: not a report of nros-conformance{why}"


def test_two_reports_on_one_row_are_both_named(tmp_path: Path) -> None:
    write_report(tmp_path, uorb())
    (tmp_path / "uorb").rename(tmp_path / "old")
    write_report(tmp_path, uorb())
    with pytest.raises(ReportError) as error:
        read_reports(tmp_path)
    assert str(error.value) == (
        f"two reports on uorb: {tmp_path}/old/report.json and {tmp_path}/uorb/report.json; remove one of them"
    )


def test_a_narrowed_run_leaves_the_results_of_a_whole_one(tmp_path: Path) -> None:
    apart = tmp_path / "narrowed"
    assert folder_for(tmp_path, "demo", narrowed=True) == tmp_path  # there is nothing to leave
    write_report(tmp_path, report(narrowed=True))
    assert folder_for(tmp_path, "demo", narrowed=True) == tmp_path  # a narrowed one replaces another
    whole = report(seconds=2.0)
    write_report(tmp_path, whole)
    assert folder_for(tmp_path, "demo", narrowed=True) == apart
    assert folder_for(tmp_path, "demo", narrowed=False) == tmp_path
    few = report(narrowed=True)
    file = write_report(apart, few)
    assert read_reports(tmp_path) == (whole,)
    assert read_latest(tmp_path) == ((apart, few), (tmp_path, whole))
    os.utime(file, ns=(0, 0))
    assert read_latest(tmp_path) == ((tmp_path, whole),)


def test_another_format_is_refused_by_number() -> None:
    data = json.loads(encode_report(report())) | {"format": FORMAT + 1, "tool": "9.0", "news": True}
    with pytest.raises(ReportError) as error:
        decode_report(json.dumps(data).encode(), "r.json")
    assert str(error.value) == (
        "r.json: report format 2, written by nros-conformance 9.0; this one reads format 1: run again"
    )


def test_a_damaged_report_names_the_damage() -> None:
    data = json.loads(encode_report(report(results=[canonical(LVC)])))
    data["results"][0]["status"] = "perhaps"
    with pytest.raises(ReportError) as error:
        decode_report(json.dumps(data).encode(), "r.json")
    assert str(error.value) == (
        "r.json: damaged, or written by another nros-conformance (0.1.0): "
        "Invalid enum value 'perhaps' - at `$.results[0].status`; run again"
    )


def test_missing_reports_are_named(tmp_path: Path) -> None:
    with pytest.raises(ReportError) as error:
        read_report(tmp_path / "report.json")
    assert str(error.value) == f"{tmp_path}/report.json: there is no report"
    with pytest.raises(ReportError) as error:
        read_reports(tmp_path)
    assert str(error.value) == f"{tmp_path}: no reports here; run: nros-conformance run"


def test_reports_on_other_suites_do_not_merge() -> None:
    other = msgspec.structs.replace(uorb(), digest="sha256:55ab", suites_version="0.9")
    same_suites({"run-1": cyclone(), "run-2": uorb()})
    with pytest.raises(ReportError) as error:
        same_suites({"run-2": other, "run-1": msgspec.structs.replace(cyclone(), digest="sha256:7c1e")})
    assert str(error.value) == (
        "these do not merge: run-1 is on suites 1.0 (sha256:7c1e), run-2 on suites 0.9 (sha256:55ab); "
        "run one of them again"
    )
