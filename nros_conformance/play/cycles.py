"""The records of a cycle step, summed up cycle by cycle."""

from __future__ import annotations

from collections import Counter
from typing import Any

from nros_conformance.rmw.events import EventKind, kind_label
from nros_conformance.trace.records import Act, AnyRecord, Cycles, Event, Message


class CycleSum:
    """Takes the place of the trace while its turns are played."""

    def __init__(self, label: str) -> None:
        self._label = label
        self._times = 0
        self._calls: dict[str, dict[Any, Act]] = {}
        self._answers: dict[str, Counter[Any]] = {}
        self._received: Counter[str] = Counter()
        self._events: Counter[str] = Counter()
        self._totals: dict[str, dict[str, list[int]]] = {"received": {}, "events": {}}

    def note(self, record: AnyRecord) -> None:
        """A record of the cycle in progress."""
        match record:
            case Act():
                answer = (type(record.result), record.result, bool(record.raised))
                self._calls.setdefault(record.label, {}).setdefault(answer, record)
                self._answers.setdefault(record.label, Counter())[answer] += 1
            case Message():
                self._received[record.entity] += 1
            case Event(kind=EventKind.LIVELINESS_CHANGED):
                self._events[f"{record.entity}/{kind_label(record.kind)}"] += 1
            case Event():
                change = record.status.get("total_count_change", 0)
                self._events[f"{record.entity}/{kind_label(record.kind)}"] += change
            case _:
                pass

    def cycle(self) -> None:
        """The cycle in progress is over."""
        for name, counted in (("received", self._received), ("events", self._events)):
            known = self._totals[name]
            for key in {*known, *counted}:
                # What only comes in a later cycle did not come in those before.
                few, many = known.get(key, [0, 0] if self._times else [counted[key]] * 2)
                known[key] = [min(few, counted[key]), max(many, counted[key])]
            counted.clear()
        self._times += 1

    def record(self, begin: int, end: int) -> Cycles:
        """The sum."""
        return Cycles(
            label=self._label, times=self._times,
            calls={label: list(acts.values()) for label, acts in self._calls.items()},
            answers={label: [self._answers[label][answer] for answer in acts] for label, acts in self._calls.items()},
            received=self._totals["received"], events=self._totals["events"], begin=begin, end=end,
        )  # fmt: skip
