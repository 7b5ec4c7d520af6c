"""Plays that ended because something could not be created: whether the host, which gave no core, is to blame."""

from __future__ import annotations

from nros_conformance.judge.findings import no_core
from nros_conformance.judge.index import Index
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.trace.records import End

_UNANSWERED = (ReturnCode.TIMEOUT, ReturnCode.CONNECTION_FAILED)

_LOST_WITHIN = 10
"""Connection leases from a loss to the answer that tells of it: creating may wait for a peer."""


def why_unopened(index: Index, end: End) -> str:
    """What the host did to a creation that ended the play; empty if it is the backend's own doing."""
    refused = [one for _, one in index.states if one.what == "refused" and one.code in _UNANSWERED]
    if end.outcome != "raised" or not end.detail.startswith(("creating ", "create_session ")) or not refused:
        return ""
    begin, finish = refused[-1].begin, refused[-1].end
    waited = index.starvation(begin, finish)
    if 2 * waited <= finish - begin:
        waited = _cut_off(index, end) if refused[-1].code == ReturnCode.CONNECTION_FAILED else 0
    return no_core(waited) if waited else ""


def _cut_off(index: Index, end: End) -> int:
    """How long a thread had no core, ns, if that may have ended the connection without which nothing can be created."""
    lease = index.quantities.get("connection_lease", 0)
    waits = [one.wait for one in index.starved if one.end >= end.t - _LOST_WITHIN * lease]
    longest = max(waits, default=0)
    # Signs of life are sent several times a lease.
    return longest if lease and longest > lease // 2 else 0
