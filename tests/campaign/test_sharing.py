from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest

from nros_conformance.campaign import run
from nros_conformance.campaign.run import AT_LEAST, AT_ONCE, RowRun, share_out


def shares(*totals: int, virtual: int = 0, part: int = 1) -> list[int]:
    rows = [SimpleNamespace(row=SimpleNamespace(virtual=False), total=total, at_once=0) for total in totals]
    unbound = [SimpleNamespace(row=SimpleNamespace(virtual=True), total=1_000, at_once=0) for _ in range(virtual)]
    share_out(cast(list[RowRun], rows + unbound), part)
    assert all(one.at_once == 0 for one in unbound)
    return [one.at_once for one in rows]


@pytest.mark.parametrize(("cores", "expected"), [(1, [4, 7, 6]), (2, [6, 14, 11]), (4, [13, 24, 22]), (64, [24] * 3)])
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
    assert shares(500, 500, part=4) == [4, 4]
    assert shares() == []
