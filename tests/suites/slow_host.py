"""A host that is too slow, simulated: the harness stands still at any moment, and nothing tells of it but the clock.

The reference is played in virtual time with the tolerances of the real one. The threads of the harness come late from
each wait, and stand still after each record that they write; those of the backend do not. Other than on a real host no
`starved` record excuses anything: threads that wait for Python's lock leave none there either.
"""

from __future__ import annotations

import sys
import zlib
from random import Random

import greenlet
import msgspec

from nros_conformance.campaign.control import find_control
from nros_conformance.campaign.plans import Row
from nros_conformance.judge.judge import judge
from nros_conformance.judge.results import Verdict
from nros_conformance.play.faults import PROCESS_FAULTS
from nros_conformance.play.plan import Plan
from nros_conformance.play.player import play
from nros_conformance.rmw.backend import Backend
from nros_conformance.rmw.clock import Signal, VirtualClock
from nros_conformance.trace.records import AnyRecord, Header, Trace

HOSTS = {"often for short": (0.03, 1.5), "now and then": (0.01, 3.0), "seldom for long": (0.004, 6.0)}
"""The chance of standing still, and for how many times T at most."""

_BACKENDS_OWN = ("/nros_backends/", "/model/")


class SlowHostClock(VirtualClock):
    """Stands still with a chance of ``often``, mostly shortly, for at most ``longest_ns``."""

    def __init__(self, dice: Random, often: float, longest_ns: int) -> None:
        super().__init__()
        self._dice = dice
        self._often = often
        self._longest_ns = longest_ns

    def wait(self, signal: Signal | None, until_ns: int) -> bool:
        up = super().wait(signal, until_ns)
        caller = sys._getframe(1).f_code.co_filename
        if not any(part in caller for part in _BACKENDS_OWN):
            self.stand_still()
        return signal.is_set() if signal is not None else up

    def stand_still(self) -> None:
        """Perhaps let time pass before the calling task goes on."""
        if self._hub not in (None, greenlet.getcurrent()) and self._dice.random() < self._often:
            super().wait(None, self.now_ns() + int(self._longest_ns * self._dice.random() ** 3))


def reference_row() -> Row:
    """The reference as on the real clock: its tolerances, and no faults that are real signals there."""
    found = find_control()
    assert found.declaration is not None
    faults = {name: how for name, how in found.declaration.faults.items() if name not in PROCESS_FAULTS}
    behaviour = msgspec.structs.replace(found.declaration.behaviour, clock="real")
    return Row(msgspec.structs.replace(found.declaration, behaviour=behaviour, faults=faults), found.adapter)


def play_slowly(plan: Plan, adapter: type[Backend], seed: int, often: float, longest: float) -> Verdict:
    """The verdict of a play that stands still for up to ``longest`` times T; the same for the same seed."""
    dice = Random(zlib.crc32(f"{plan.key} {seed}".encode()))
    clock = SlowHostClock(dice, often, int(longest * plan.header.quantities["T"]))
    records: list[Header | AnyRecord] = []

    def write(record: Header | AnyRecord) -> None:
        records.append(record)
        if not isinstance(record, Header):
            clock.stand_still()

    clock.run(lambda: play(plan, adapter, clock, write))
    header, *rest = records
    assert isinstance(header, Header)
    return judge(Trace(header, tuple(rest)))  # type: ignore[arg-type]
