from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from nros_conformance.campaign import run
from nros_conformance.campaign.plans import Row, make_plan
from nros_conformance.campaign.run import AT_LEAST, AT_ONCE, SET_UP_S, RowRun, share_out
from nros_conformance.campaign.selection import Selection
from nros_conformance.play.plan import Plan
from nros_conformance.rmw.discovery import find_backend
from nros_conformance.suite.loader import load_suites


def run_of(seconds: float, *, virtual: bool = False) -> Any:
    return SimpleNamespace(row=SimpleNamespace(virtual=virtual), shared_s=lambda: seconds, at_once=0)


def shares(*lasts: int, virtual: int = 0, part: int = 1) -> list[int]:
    rows = [run_of(seconds) for seconds in lasts]
    unbound = [run_of(1_000, virtual=True) for _ in range(virtual)]
    share_out(cast(list[RowRun], rows + unbound), part)
    assert all(one.at_once == 0 for one in unbound)
    return [one.at_once for one in rows]


@pytest.mark.parametrize(("cores", "expected"), [(1, [6, 13, 10]), (2, [11, 24, 20]), (64, [24] * 3)])
def test_rows_share_the_cores_by_what_they_have_to_play(
    monkeypatch: pytest.MonkeyPatch, cores: int, expected: list[int]
) -> None:
    monkeypatch.setattr(run, "cores", lambda: cores)
    assert shares(200, 450, 350, virtual=2) == expected


def test_each_row_has_some_places_and_none_too_many(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "cores", lambda: 2)
    assert shares(500) == [AT_ONCE]
    assert shares(0) == shares(1, 1_000, 1_000)[:1] == [AT_LEAST]
    assert shares(*[300] * 20) == [AT_LEAST] * 20
    assert shares(500, 500, part=4) == [7, 7]
    assert shares() == []


def row_run(tmp_path: Path) -> RowRun:
    found = find_backend("uorb")
    assert found.declaration is not None
    row = RowRun(
        Row(found.declaration, found.adapter), load_suites(), Selection("publish"), tmp_path,
        ports=range(0), control=None, watch=lambda progress: None,
    )  # fmt: skip
    row.at_once = AT_LEAST
    return row


def test_a_row_lasts_as_long_as_what_its_plays_ask_for(tmp_path: Path) -> None:
    row = row_run(tmp_path)
    own = sum(one.scenario.needs.process != "shared" for one in row._to_play.values())
    assert 0 < own < row.total
    whole = row.shared_s()
    assert whole > SET_UP_S * (row.total - own)
    one = next(key for key, one in row._to_play.items() if one.scenario.needs.process == "shared")
    plan = make_plan(row._to_play.pop(one), row.row, row.suites, tmp_path)
    assert whole - row.shared_s() == pytest.approx(SET_UP_S + plan.expected_ns / 1e9)


class _Pool:
    """Writes down what it is told to play; what is shared lasts until all the others have begun."""

    def __init__(self, others: int) -> None:
        self.began: list[Sequence[Plan]] = []
        self.lanes: set[int] = set()
        self._others = threading.Semaphore(0)
        self._count = others

    def play(self, plans: Sequence[Plan], at_once: int, place: int = 0) -> None:
        if at_once > 1:
            for _ in range(self._count):
                assert self._others.acquire(timeout=10)
            return
        self.began.append(plans)
        self.lanes.add(place)
        self._others.release()


def test_what_has_a_process_of_its_own_begins_with_the_longest(tmp_path: Path) -> None:
    row = row_run(tmp_path)
    suites = row.suites
    own = [one for one in suites.scenarios if one.scenario.needs.process == "own"]
    pool = _Pool(len(own) + 1)
    row._to_play = {one.key: one for one in suites.scenarios}
    row._round(cast(Any, pool), suites.scenarios, 1)
    lasts = [sum(plan.expected_ns for plan in plans) for plans in pool.began]
    assert len(lasts) == len(own) + 1 > 6
    assert lasts == sorted(lasts, reverse=True)
    assert pool.lanes == {AT_ONCE}, "one at a time, as long as there is something beside it"
