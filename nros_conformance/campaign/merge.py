"""Reports of shares of one row, made by several processes side by side, as the report of the row."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from nros_conformance.report.differences import differences
from nros_conformance.report.observations import tally
from nros_conformance.report.results import Report, write_report


def merged(shares: Sequence[Report], levels: Mapping[str, str], scenarios: int) -> Report:
    """One report. ``scenarios``: how many there are in all. What was played by two counts once, the first time."""
    results = {result.key: result for share in reversed(shares) for result in share.results}
    broken = next((share for share in shares if not share.available), None)
    interrupted = next((share.why_partial for share in shares if share.why_partial.startswith("interrupted")), "")
    left_out = f"{scenarios - len(results)} of {scenarios} scenarios left out" if len(results) < scenarios else ""
    whole = msgspec.structs.replace(
        shares[0],
        results=tuple(results[key] for key in sorted(results)),
        observations=tally(one for share in shares for one in share.observations),
        incidents=tuple(one for share in shares for one in share.incidents),
        available=broken is None,
        unavailable_reason=broken.unavailable_reason if broken is not None else "",
        partial=bool(interrupted or left_out),
        why_partial=interrupted or left_out,
        control=next((share.control for share in shares if share.control is not None), None),
        seconds=max(share.seconds for share in shares),
    )
    return msgspec.structs.replace(whole, differences=tuple(differences(whole, levels)))


def publish(report: Report, shares: Path, results: Path) -> Path:
    """Write a merged report, with the traces of all its shares, to where a run by one process leaves them."""
    traces = results / report.row / "traces"
    traces.mkdir(parents=True, exist_ok=True)
    for old in traces.glob("*.jsonl"):
        old.unlink()
    for trace in shares.glob(f"*/{report.row}/traces/*.jsonl"):
        shutil.move(trace, traces / trace.name)
    return write_report(results, report)
