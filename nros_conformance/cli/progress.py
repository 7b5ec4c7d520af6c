"""Progress on stderr: one line that renews itself on a terminal, a line every ten seconds otherwise."""

from __future__ import annotations

import shutil
import time
from typing import TextIO

EVERY_S = 10.0


class ProgressLine:
    """How far each row is."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._terminal = stream.isatty()
        self._rows: dict[str, tuple[int, int, int]] = {}
        self._shown = time.monotonic()
        self._width = 0

    def update(self, row: str, done: int, total: int, *, failed: bool) -> None:
        """A scenario of this row was judged."""
        failures = self._rows.get(row, (0, 0, 0))[2] + failed
        self._rows[row] = (done, total, failures)
        now = time.monotonic()
        if self._terminal:
            text = self._fitting(shutil.get_terminal_size().columns - 1)
            self._stream.write("\r" + text.ljust(self._width))
            self._width = len(text)
            self._stream.flush()
        elif now - self._shown >= EVERY_S:
            self._shown = now
            print(self._plain(), file=self._stream, flush=True)  # a log has no use for bars

    def clear(self) -> None:
        """Make room for other output."""
        if self._terminal and self._width:
            self._stream.write("\r" + " " * self._width + "\r")
            self._stream.flush()
            self._width = 0

    def _fitting(self, columns: int) -> str:
        """What one line of the terminal holds: a longer one would not be renewed but repeated."""
        done, total, failures = (sum(column) for column in zip(*self._rows.values(), strict=True))
        short = f"{len(self._rows)} rows {done}/{total}" + _failed(failures)
        return next((text for text in (self._text(), self._plain()) if len(text) <= columns), short[:columns])

    def _plain(self) -> str:
        rows = self._rows.items()
        return "   ".join(f"{row} {done}/{total}" + _failed(failures) for row, (done, total, failures) in rows)

    def _text(self) -> str:
        parts = []
        for row, (done, total, failures) in self._rows.items():
            bar = "=" * (20 * done // total) + ("" if done == total else ">")
            parts.append(f"{row} [{bar:.<20}] {done}/{total}" + _failed(failures))
        return "   ".join(parts)


def _failed(failures: int) -> str:
    return f"  {failures} FAIL" if failures else ""
