"""The line of progress: it never grows longer than the terminal is wide."""

from __future__ import annotations

import io
import time

import pytest

from nros_conformance.cli.progress import ProgressLine


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def last(stream: io.StringIO) -> str:
    return stream.getvalue().rpartition("\r")[2].rstrip()


@pytest.mark.parametrize(("columns", "text"), [
    (120, "can [==========>.........] 5/10   zenoh-router [====================] 10/10  1 FAIL"),
    (60, "can 5/10   zenoh-router 10/10  1 FAIL"),
    (30, "2 rows 15/20  1 FAIL"),
    (11, "2 rows 15/"),
])  # fmt: skip
def test_it_fits_into_one_line(columns: int, text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    stream = Terminal()
    line = ProgressLine(stream)
    line.update("can", 5, 10, failed=False)
    line.update("zenoh-router", 10, 10, failed=True)
    assert last(stream) == text


def test_without_a_terminal_it_is_silent_at_first() -> None:
    stream = io.StringIO()
    line = ProgressLine(stream)
    line.update("can", 5, 10, failed=False)
    line.clear()
    assert stream.getvalue() == ""


def test_in_a_log_it_is_a_line_without_bars_every_ten_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    stream = io.StringIO()
    line = ProgressLine(stream)
    line.update("can", 5, 10, failed=True)
    now[0] += 10
    line.update("uorb", 7, 7, failed=False)
    line.update("uorb", 7, 7, failed=False)
    assert stream.getvalue() == "can 5/10  1 FAIL   uorb 7/7\n"
