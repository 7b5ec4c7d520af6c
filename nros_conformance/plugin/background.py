"""The campaign behind the items: it plays all that was selected, many at once, while the items wait for verdicts.

With pytest-xdist every worker has all items and runs some, nobody knows beforehand which. So each worker
plays a fixed share and leaves its verdicts in a folder that all of them read; an item waits there,
whoever plays it.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import threading
import time
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from nros_conformance.campaign.control import run_control
from nros_conformance.campaign.merge import merged
from nros_conformance.campaign.plans import Row
from nros_conformance.campaign.run import Progress, RowRun, share_out
from nros_conformance.campaign.selection import Selection
from nros_conformance.play.leases import lease_ports
from nros_conformance.report.results import FILE, Control, Report, ScenarioResult, read_report
from nros_conformance.suite.loader import Suites
from nros_conformance.suite.schema import Profile

_POLL_S = 0.02
_APPEAR_S = 60.0
"""How long another worker may take from the end of our collection to the end of its own."""

_T = TypeVar("_T")


class NotPlayed(Exception):
    """There will be no verdict. The text says why."""


@dataclasses.dataclass(frozen=True, slots=True)
class Share:
    """Which part of the selection this process plays: scenarios whose position is ``index`` modulo ``of``."""

    name: str = "main"
    index: int = 0
    of: int = 1

    def owner(self, position: int) -> str:
        """The process that plays the scenario at this position."""
        return f"gw{position % self.of}" if self.of > 1 else self.name

    @property
    def names(self) -> list[str]:
        """All processes."""
        return [self.owner(position) for position in range(self.of)]


class Settled(msgspec.Struct, frozen=True):
    """A result that no further attempt will change, and the folder that its traces are relative to."""

    result: ScenarioResult
    folder: str


class Background:
    """Plays the rows in threads; verdicts are read by `result` and `report`.

    ``shared`` is the folder of this test run that all processes of it see.
    """

    def __init__(self, suites: Suites, profile: Profile, shared: Path, share: Share) -> None:
        self._suites = suites
        self._profile = profile
        self._shared = shared
        self._share = share
        self._owners: dict[tuple[str, str], str] = {}
        self._runs: list[RowRun] = []
        self._thread: threading.Thread | None = None
        self._begun = time.monotonic()
        self._stopping = threading.Event()

    def start(self, selected: Mapping[str, tuple[Row, Sequence[str]]]) -> None:
        """Begin to play. ``selected``: for each row the keys of its scenarios, the same in every process."""
        plays: list[tuple[Row, frozenset[str]]] = []
        everything: set[str] = set()
        for name, (row, keys) in selected.items():
            owned = {key: self._share.owner(position) for position, key in enumerate(keys)}
            self._owners |= {(name, key): owner for key, owner in owned.items()}
            plays.append((row, frozenset(key for key, owner in owned.items() if owner == self._share.name)))
            everything |= set(keys)
        self._put("pids", self._share.name, os.getpid())
        self._begun = time.monotonic()
        self._thread = threading.Thread(target=self._run, args=(plays, everything), name="campaign", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End what is still being played; what was judged stays."""
        self._stopping.set()
        for run in self._runs:
            run.stop()
        if self._thread is not None:
            self._thread.join(30)

    def result(self, row: str, key: str) -> Settled:
        """The verdict of a scenario, as soon as it is final. Raises `NotPlayed`."""
        settled = self._await(f"results/{row}", key, Settled, self._owners[row, key])
        self._believe()
        return settled

    def report(self, row: str) -> Report:
        """The row, when all of it has been played, by all processes. Raises `NotPlayed`."""
        for owner in self._share.names:
            self._await("done", owner, bool, owner)
        self._believe()
        return gather(self._shared, row, self._suites)

    def _run(self, plays: Sequence[tuple[Row, frozenset[str]]], everything: Collection[str]) -> None:
        try:
            control = self._control(everything)
            with contextlib.ExitStack() as stack:
                self._runs = [self._row(row, keys, stack.enter_context(lease_ports()), control) for row, keys in plays]
                share_out(self._runs, self._share.of)
                threads = [threading.Thread(target=self._play, args=(run,), daemon=True) for run in self._runs]
                if not self._stopping.is_set():
                    for thread in threads:
                        thread.start()
                    for thread in threads:
                        thread.join()
        except Exception as error:
            self._put("failed", self._share.name, f"{type(error).__name__}: {error}")
        self._put("done", self._share.name, True)

    def _control(self, everything: Collection[str]) -> Control | None:
        """The first process shows for all that this run can fail."""
        if self._share.index:
            return None
        control = run_control(
            self._suites, Selection(self._profile, keys=frozenset(everything)), self._shared / self._share.name
        )
        self._put("control", "control", control)
        return control

    def _row(self, row: Row, keys: frozenset[str], ports: range, control: Control | None) -> RowRun:
        def watch(progress: Progress) -> None:
            if run.settled(progress.result):
                self._put(f"results/{row.name}", progress.result.key, Settled(progress.result, str(run.folder)))

        run = RowRun(
            row, self._suites, Selection(self._profile, keys=keys), self._shared / self._share.name,
            ports=ports, control=control, watch=watch,
        )  # fmt: skip
        return run

    def _play(self, run: RowRun) -> None:
        try:
            run.play()
            if run.broken:
                self._put("failed", self._share.name, f"{run.row.name}: {run.broken}")
        except Exception as error:
            self._put("failed", self._share.name, f"{run.row.name}: {type(error).__name__}: {error}")

    def _believe(self) -> None:
        """Raise `NotPlayed` when the control has shown that nothing can be believed here."""
        control = self._await("control", "control", Control, self._share.names[0])
        if not control.ok:
            raise NotPlayed(f"the control failed: reference {control.reference}; {control.planted}")

    # The folder that all processes see: one file a value, whole or not there.

    def _put(self, kind: str, name: str, value: Any) -> None:
        file = self._file(kind, name)
        file.parent.mkdir(parents=True, exist_ok=True)
        unfinished = file.with_suffix(f".{self._share.name}.{threading.get_ident()}")
        unfinished.write_bytes(msgspec.json.encode(value, enc_hook=str))
        unfinished.replace(file)

    def _get(self, kind: str, name: str, type_: type[_T]) -> _T | None:
        try:
            data = self._file(kind, name).read_bytes()
        except FileNotFoundError:
            return None
        return msgspec.json.decode(data, type=type_)

    def _file(self, kind: str, name: str) -> Path:
        return self._shared / kind / f"{name.replace('/', '_')}.json"

    def _await(self, kind: str, name: str, type_: type[_T], owner: str) -> _T:
        while True:
            over = self._ended(owner)  # looked at first: what it left before it ended counts
            value = self._get(kind, name, type_)
            if value is not None:
                return value
            if over:
                raise NotPlayed(over)
            time.sleep(_POLL_S)

    def _ended(self, owner: str) -> str:
        """Why nothing more will come from a process; empty while something may."""
        failed = self._get("failed", owner, str)
        if failed is not None:
            return failed
        if self._get("done", owner, bool):
            return f"{owner} has ended without playing it"
        pid = self._get("pids", owner, int)
        if pid is None:
            late = time.monotonic() - self._begun > _APPEAR_S
            return f"{owner}, which was to play it, has not begun after {_APPEAR_S:.0f} s" if late else ""
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return f"{owner}, which was to play it, is gone"
        return ""


def gather(shared: Path, row: str, suites: Suites) -> Report:
    """What all processes have reported of a row. Raises `NotPlayed` when there is nothing."""
    files = sorted(shared.glob(f"*/{row}/{FILE}"))
    if not files:
        raise NotPlayed(f"nothing of {row} was played")
    return merged([read_report(file) for file in files], suites.levels, len(suites.scenarios))
