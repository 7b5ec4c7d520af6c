"""Timelines: short lists of actions on a fixed cast, and the scenario that each one is.

Actions happen on a grid of T/2; deadlines and leases are chosen so that nothing falls due on it.
"""

from __future__ import annotations

import copy
import dataclasses
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, TypeAlias

from nros_conformance.explore.cast import (
    DEADLINE_MS,
    DEPTH,
    ENTITIES,
    LEASE_MS,
    PUBLISHERS,
    SUBSCRIPTIONS,
    TIME,
    Cast,
)
from nros_conformance.model.world import Id, Occurrence, World
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.events import EventKind, Side
from nros_conformance.trace.records import Act, AnyRecord, FaultRecord

T = 100 * MS
TICK = T // 2
LOOK = 3 * T // 10
"""So long before the next action the numbers are looked at: each step of time ends 0.2T early, so that one that
began late delays nothing, and the look is 0.1T before its end."""

BY_TIME = (
    EventKind.REQUESTED_DEADLINE_MISSED, EventKind.LIVELINESS_LOST, EventKind.OFFERED_DEADLINE_MISSED,
)  # fmt: skip
"""What happens by itself."""

FULL = Cast()
"""Everything, as the reference does it."""

AT_ONCE = 4
"""Actions without time between them: each waits for a drive of 5 ms, and what they are late by has to fit into the
0.2T that a step of time ends early."""

_RACES = {"create": {"publish", "lose"}, "publish": {"take"}}
"""What cannot follow at once, because of the way from one end to the other."""

_PROVES = {
    EventKind.REQUESTED_DEADLINE_MISSED: "RDM-003",
    EventKind.OFFERED_DEADLINE_MISSED: "ODM-003",
    EventKind.LIVELINESS_LOST: "LVL-002",
    EventKind.MESSAGE_LOST: "MSL-001",
    EventKind.LIVELINESS_CHANGED: "LVC-009",
}


@dataclasses.dataclass(frozen=True, slots=True)
class Action:
    """One action: so many ticks of time, or so many samples; 1 for all others."""

    verb: str
    subject: str = ""
    count: int = 1


LAST = Action("drive", count=3)
"""What every timeline ends with."""


@dataclasses.dataclass(frozen=True, slots=True)
class Timeline:
    """Actions one after the other, and the kinds that are registered from the start."""

    actions: tuple[Action, ...]
    kinds: tuple[EventKind, ...] = tuple(EventKind)

    @property
    def lossy(self) -> bool:
        """Whether a sample gets lost on the wire."""
        return any(action.verb == "lose" for action in self.actions)

    def sensible(self) -> Timeline:
        """The same without what cannot be done: using or destroying what is not there, creating what is.

        Time passes after so many actions at once, before a sample is sent to, or by, one that was just created, and
        before one is taken that was just sent.
        """
        alive, late, at_once, races = set(ENTITIES), set(SUBSCRIPTIONS), 0, set[str]()
        kept: list[Action] = []
        for action in self.actions:
            verb, subject = action.verb, action.subject
            if subject and (subject in alive) is (verb == "create"):
                continue
            if verb == "register" and subject not in late:
                continue
            alive ^= {subject} if verb in ("create", "destroy") else set()
            late -= {subject} if verb in ("register", "destroy") else set()
            if verb in TIME:
                at_once, races = 0, set()
            elif at_once == AT_ONCE or verb in races:
                kept.append(Action("drive"))
                at_once, races = 1, set()
            else:
                at_once += 1
            races |= _RACES.get(verb, set())
            kept.append(action)
        return dataclasses.replace(self, actions=tuple(kept))


_Happening: TypeAlias = tuple[int, str, EventKind, tuple[int, ...]]
"""When, to whom, what, and by how much the total changed."""


class _Told:
    """What the model says happens, when and to whom.

    ``swallows``: what is lost on the wire takes the assertion of its publisher with it.
    """

    def __init__(
        self, timeline: Timeline, slack_ns: int, cast: Cast, world: type[World], *, swallows: bool = False
    ) -> None:
        self.slack_ns = slack_ns
        self._swallows = swallows
        self._forgets = cast.forgets
        self.born = dict.fromkeys(ENTITIES, 0)
        """The first occurrence that can concern the present life of each."""
        self.world = world()
        self.now = 0
        self.kinds = timeline.kinds
        self.qos = {name: cast.qos(name, timeline.lossy) for name in ENTITIES}
        self.happened: list[_Happening] = []
        self.perhaps: Counter[_Happening] = Counter()
        """What happened, and what did not, so close to an action that a late one may change it."""
        self.unseen: dict[tuple[str, Id], int] = {}
        """By subscription and publisher: samples lost since the last that arrived. The next one shows the gap, and a
        backend that learns of it earlier may say so (MSL-001)."""
        self._heard: set[tuple[str, int, Id]] = set()
        """By subscription and publisher: who has had a sample of whom. What is lost before the first one is no gap
        between samples that were delivered, and need not be counted (C12)."""
        self.driven = 0
        """When the last drive ended: what happened since dies undelivered with its entity."""
        self._ids: dict[str, int] = {}
        self._names: dict[Id, str] = {}
        for name in ENTITIES:
            self.create(name)

    def note(self, found: list[Occurrence] | Iterator[Occurrence]) -> None:
        for one in found:
            name = self._names[one.entity]
            self.happened.append((one.at_ns, name, one.kind, one.change))
            if one.kind is EventKind.LIVELINESS_LOST and self._forgets:
                self._heard = {pair for pair in self._heard if pair[2] != one.entity}

    def create(self, name: str) -> None:
        id_ = len(self._names)
        self.born[name] = len(self.happened) if id_ >= len(ENTITIES) else 0
        self._ids[name], self._names[id_] = id_, name
        topic = (0, "t", "T")
        if name in PUBLISHERS:
            self.note(self.world.create_publisher(id_, topic, "pub", self.qos[name], self.now))
            deadline = EventKind.OFFERED_DEADLINE_MISSED
        else:
            self.note(self.world.create_subscription(id_, topic, self.qos[name], self.now))
            deadline = EventKind.REQUESTED_DEADLINE_MISSED
        if deadline in self.kinds:
            self.world.set_deadline(id_, DEADLINE_MS)

    def do(self, action: Action) -> None:
        name, id_ = action.subject, self._ids.get(action.subject)
        if action.verb not in TIME:
            self.doubt()
        if action.verb == "destroy":
            undelivered = [one for one in self.happened if one[0] >= self.driven - self.slack_ns and one[1] == name]
            self.perhaps |= Counter(undelivered)
        match action.verb:
            case "drive" | "idle":
                self.now += action.count * TICK
                self.note(self.world.advance(self.now))
                self.driven = self.now if action.verb == "drive" else self.driven
            case "lose" if self._swallows:
                self.note(self.world.advance(self.now))
            case "publish" | "lose":
                for _ in range(action.count):
                    found = self.world.publish(id_, b"", self.now, lost=action.verb == "lose")
                    self.note(found)
                    if action.verb == "publish":
                        self._doubt_first(id_, found)
                for pair in [(one, id_) for one in SUBSCRIPTIONS]:
                    self.unseen[pair] = self.unseen.get(pair, 0) + action.count if action.verb == "lose" else 0
            case "assert":
                self.note(self.world.assert_liveliness(id_, self.now))
            case "take":
                while self.world.take(id_, self.now) is not None:
                    pass
            case "destroy" if name in PUBLISHERS:
                self.note(self.world.destroy_publisher(id_, self.now))
            case "destroy":
                self.note(self.world.destroy_subscription(id_, self.now))
            case "create":
                self.create(name)

    def _doubt_first(self, publisher: Id, found: list[Occurrence]) -> None:
        """A loss that shows with the first sample that a subscription gets from a publisher may go uncounted."""
        for name in SUBSCRIPTIONS:
            pair = name, self._ids[name], publisher
            lost = [one for one in found if (self._names[one.entity], one.kind) == (name, EventKind.MESSAGE_LOST)]
            if lost and pair not in self._heard and self.unseen.get((name, publisher)):
                self.perhaps[lost[0].at_ns, name, lost[0].kind, lost[0].change] += 1
            self._heard.add(pair)

    def ahead(self) -> _Told:
        """What would happen if nothing was done: a play that is behind has not done it yet."""
        later = copy.deepcopy(self)
        later.note(later.world.advance(self.now + self.slack_ns))
        return later

    def doubt(self) -> None:
        """An action comes now: what falls due just before or after it may do so just after or before it."""
        near = [one for one in self.ahead().happened if one[0] >= self.now - self.slack_ns and one[2] in BY_TIME]
        self.perhaps |= Counter(near)

    def bounds(self, name: str, kind: EventKind, at: int) -> tuple[int, int]:
        """The least and the most that a count can be at a moment."""
        told = Counter(self.happened)
        sure, possible = told - self.perhaps, told | self.perhaps
        least, most = (
            sum(one[3][0] * times for one, times in some.items() if one[1:3] == (name, kind) and one[0] <= until)
            for some, until in ((sure, at - self.slack_ns), (possible, at + self.slack_ns))
        )
        if kind is EventKind.MESSAGE_LOST:
            most += sum(lost for (subscription, _), lost in self.unseen.items() if subscription == name)
        return least, most

    def total(self, name: str, kind: EventKind, until: int, first: int = 0) -> tuple[int, ...]:
        changes = [
            change for at, of, what, change in self.happened[first:] if (of, what) == (name, kind) and at <= until
        ]
        return tuple(map(sum, zip(*changes, strict=True))) if changes else (0, 0)


def scenario(
    timeline: Timeline, *, slack_ns: int = 0, id_: str = "x.explored", cast: Cast = FULL, world: type[World] = World
) -> dict[str, Any]:
    """The timeline as a scenario in the suites' notation, with what the model says about it as expectations.

    ``slack_ns``: by how much the play may be behind the timeline. Calls wait for a background drive to end, so
    it is never 0; nothing adds up, because every step has its time. ``world``: the model that is asked.
    """
    told, deaf = (_Told(timeline, slack_ns, cast, world, swallows=one) for one in (False, True))
    script: list[Any] = ["settle", {"drive": "0.5T", "as": "go"}]
    told.do(Action("drive"))
    deaf.do(Action("drive"))
    looks: list[tuple[_Told, _Told, str, int, set[str]]] = []
    for index, action in enumerate((*timeline.actions, LAST)):
        label = f"a{index}"
        begin = f"go.end + {(told.now - TICK) / T:g}T" if told.now > TICK else "go.end"
        told.do(action)
        deaf.do(action)
        gone = {one for one in ENTITIES if _gone(timeline.actions[: index + 1], one)}
        script.append(_step(action, label) | {"at": begin})
        if action.verb == "create":
            script.append("settle")
        if action.verb == "drive":
            looks.append((told.ahead(), deaf.ahead(), label, told.now - LOOK, gone))
    script.append({"drive": "0.4T"})  # so that what is judged at the last look can still be late
    expect = [one for look in looks for one in _expectations(*look, slack_ns)]
    registered = {side: [kind.label for kind in timeline.kinds if kind.side is side] for side in Side}
    entities: dict[str, Any] = {}
    for name in ENTITIES:
        side = Side.PUBLISHER if name in PUBLISHERS else Side.SUBSCRIPTION
        qos: dict[str, Any] = {"depth": 16} if name in PUBLISHERS else {"depth": DEPTH}
        if timeline.lossy:
            qos |= {"reliability": "best_effort"}
        if told.qos[name].lease_ms:
            qos |= {"liveliness": "manual_by_topic", "lease": f"{LEASE_MS * MS / T:g}T"}
        entities[name] = {side.value: "sensor", "qos": qos, "register": registered[side] or "none"}
        entities[name]["registration_deadline"] = f"{DEADLINE_MS * MS / T:g}T"
    return {
        "id": id_, "title": "A timeline that was generated", "scale": {"T": "100ms"},
        "sessions": {name: {"slice": "5ms"} for name in ("pub", "sub")}, "entities": entities,
        "script": script, "expect": expect,
    }  # fmt: skip


def behind(timeline: Timeline, records: Iterable[AnyRecord], scale_ns: int = T) -> float:
    """By how many T a play was behind its timeline at most; 0 when it did not even begin. ``scale_ns``: its T."""
    due, now = {}, 0.0
    for index, action in enumerate((*timeline.actions, LAST)):
        lasts = action.count * TICK / T if action.verb in TIME else 0
        due[f"a{index}"] = now + lasts - (0.2 if lasts else 0)
        now += lasts
    begun, worst = None, 0.0
    for one in records:
        if not isinstance(one, Act | FaultRecord):
            continue
        if one.label == "go":
            begun = one.end
        elif begun is not None and one.label in due:
            worst = max(worst, (one.end - begun) / scale_ns - due[one.label])
    return worst


def _gone(actions: Sequence[Action], name: str) -> bool:
    last = next(
        (one.verb for one in reversed(actions) if one.subject == name and one.verb in ("create", "destroy")), ""
    )
    return last == "destroy"


def _step(action: Action, label: str) -> dict[str, Any]:
    length, subject = f"{action.count * TICK / T - 0.2:g}T", action.subject
    match action.verb:
        case "drive" | "idle":
            step: dict[str, Any] = {action.verb: length}
        case "publish":
            step = {"do": "publish", "by": subject} | ({"times": action.count} if action.count > 1 else {})
        case "lose":
            step = {"fault": "lose", "of": subject, "count": action.count}
        case "assert":
            step = {"do": "assert", "by": subject}
        case "take":
            step = {"do": "take", "from": subject}
        case "create":
            step = {"do": "create", "entity": subject}
        case "register":
            step = {"do": "register", "of": subject, "kind": "LivelinessChanged"}
        case _:
            step = {"do": action.verb, "of": subject}
    return step | {"as": label}


def _expectations(
    told: _Told, deaf: _Told, label: str, at: int, gone: set[str], slack_ns: int
) -> Iterator[dict[str, Any]]:
    """``deaf``: what is told if lost samples do not assert. Whether others hear of the assertion is left open."""
    for kind in told.kinds:
        for name in PUBLISHERS if kind.side is Side.PUBLISHER else SUBSCRIPTIONS:
            if name in gone or (kind is EventKind.LIVELINESS_LOST and not told.qos[name].lease_ms):
                continue
            if kind is EventKind.LIVELINESS_CHANGED:
                times = [at + shift for shift in (-slack_ns, 0, slack_ns)]
                numbers = {one.total(name, kind, until, one.born[name])[0] for one in (told, deaf) for until in times}
                if len(numbers) == 1:
                    yield {
                        "level": "alive_count", "of": name, "is": numbers.pop(), "by": f"{label}.end - 0.1T",
                        "proves": _PROVES[kind],
                    }  # fmt: skip
                continue
            least, most = told.bounds(name, kind, at)
            bounds = {"is": least} if least == most else {"at_least": least, "at_most": most}
            yield {"total": kind.label, "of": name, "at": f"{label}.end - 0.1T", **bounds, "proves": _PROVES[kind]}
