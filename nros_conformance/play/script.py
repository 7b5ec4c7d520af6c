"""Steps of a script as calls on session threads, at the times that the script asks for."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from nros_conformance.play.actors import Actor
from nros_conformance.play.calls import Calls
from nros_conformance.play.cycles import CycleSum
from nros_conformance.play.driver import Command, Driver, Scripted, StopPlay
from nros_conformance.play.faults import Injector
from nros_conformance.play.process import QUANTITIES
from nros_conformance.play.settling import settle
from nros_conformance.play.stage import Stage
from nros_conformance.play.waiting import Waiting
from nros_conformance.rmw.backend import Listed
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.events import KIND_BY_LABEL
from nros_conformance.suite import schema
from nros_conformance.suite.injections import about_the_peer
from nros_conformance.suite.moments import Moment
from nros_conformance.suite.walk import base_name, steps
from nros_conformance.trace.records import Act, Measure


class Script:
    """Plays the steps of one scenario on a stage."""

    def __init__(self, stage: Stage, start_ns: int) -> None:
        self.stage = stage
        self.clock = stage.clock
        self._start = start_ns
        self._performed: dict[str, list[Command]] = {}
        self._paused: dict[str, list[Driver]] = {}
        """Sessions that an idle step finds paused already, by its label."""
        self._steps = {label: step for label, (_, step) in zip(stage.labels, steps(stage.scenario), strict=True)}
        self._names = {id(step): label for label, step in self._steps.items()}
        self._calls = Calls(stage)
        self._injector = Injector(stage, lambda actor, label, args: self._calls.publish(actor, label, None, args))
        self._reacted: Counter[int] = Counter()
        """Callbacks so far, by the number of the reaction."""
        self._made: Counter[str] = Counter()
        """Calls made so far, by label: those of reactions and of turns of a repeat are numbered on."""
        self._waiting = Waiting(stage, self._calls.publish)
        self._random = random.Random(stage.plan.header.seed)
        self._branches = 0
        """Side by side now."""
        stage.react = self._react

    def step(self, label: str) -> Any:
        """The step of this label."""
        return self._steps[label]

    def command(self, step: Any, label: str, index: int, entity: str, due: int) -> Command:
        """The call of one step on one entity, for a session of this process."""
        if isinstance(step, schema.Fault):
            return self._injector.command(step, label, due)[1]
        for _, name, op, args, run in self._calls.of(step, label):
            if name == entity:
                return Command(self.clock, due, run, op=op, label=label, index=index, entity=entity, args=args)
        raise StopPlay("error", f"{label} does nothing with {entity}")

    def play(self, script: Sequence[Any]) -> None:
        """Play them one after the other. Raises `StopPlay`."""
        for step in script:
            label = self._names[id(step)]
            begin = self._await(step.at) if step.at is not None else self.clock.now_ns()
            match step:
                case schema.Drive():
                    self._pause(label, "drive", begin, step.drive.ns(self.stage.quantities))
                case schema.Idle():
                    self._idle(label, begin, step.idle.ns(self.stage.quantities))
                case schema.Phase():
                    self._pause(label, "drive", begin, self._random.randrange(step.phase.ns(self.stage.quantities)))
                case schema.Cycle():
                    self._cycle(step, label, begin)
                case schema.Released():
                    self._mark(label, "released", begin, self._calls.released(step))
                case schema.Parallel():
                    self._parallel(step.parallel)
                    self._mark(label, "parallel", begin)
                case schema.Settle():
                    self._mark(label, "settle", begin, settle(self.stage))
                case schema.Measure():
                    self._measure(label, begin, step)
                case schema.Until():
                    self._mark(label, "until", begin, self._waiting.until(step, label, begin))
                case schema.Repeat():
                    for _ in range(step.repeat):
                        self.play(step.script)
                    self._mark(label, "repeat", begin)
                case schema.Fault() if about_the_peer(step):
                    record = self.stage.peer.inject(step, label)
                    self._performed[label] = [self._done(step.fault, record.begin, record.end)]
                case schema.Fault():
                    self._post([self._injector.command(step, label, begin)], label)
                case _:
                    self._do(step, label, begin)

    # Time passing.

    def _pause(self, label: str, op: str, begin: int, duration: int) -> None:
        if not self._branches:
            self.stage.calm(begin + duration)
        self.stage.sleep_until(begin + duration)
        self._mark(label, op, begin)

    def _mark(self, label: str, op: str, begin: int, result: object = None) -> None:
        """Write down a step that is no call, so that anchors can refer to it."""
        command = self._done(op, begin, self.clock.now_ns())
        self._performed[label] = [command]
        index = self._made[label]
        self._made[label] += 1
        self.stage.record(Act(label=label, index=index, op=op, due=begin, begin=begin, end=command.end, result=result))

    def _done(self, op: str, begin: int, end: int) -> Command:
        command = Command(self.clock, begin, lambda: None, op=op)
        command.begin, command.end = begin, end
        command.done.set()
        return command

    def _measure(self, label: str, begin: int, step: schema.Measure) -> None:
        value: int | None
        if step.what in QUANTITIES:
            value = QUANTITIES[step.what]()
        elif step.of is None:
            value = self.stage.peer.counted(step.what)
        else:
            actors = self.stage.members(step.of)
            found = [self.stage.peer.listed(Listed(one.side, self.stage.topic_of(one))) for one in actors]
            known = [one for one in found if one is not None]
            value = sum(known) if known else None
        self._mark(label, "measure", begin)
        end = self.clock.now_ns()
        if value is not None:
            self.stage.record(Measure(label=label, what=step.what, value=value, begin=begin, end=end))

    def _cycle(self, step: schema.Cycle, label: str, begin: int) -> None:
        total = CycleSum(label)
        self._flush()
        self.stage.sink = total.note
        try:
            for _ in range(step.cycle):
                self.play(step.script)
                total.cycle()
            self._flush()
        finally:
            self.stage.sink = None
        end = self.clock.now_ns()
        self.stage.record(total.record(begin, end))
        self._mark(label, "cycle", begin)

    def _flush(self) -> None:
        """Have the quiet spins so far written down, each on its thread."""
        for driver in self.stage.drivers.values():
            self.stage.perform(driver, "flush", driver.flush)

    def _idle(self, label: str, begin: int, duration: int) -> None:
        driven = self._paused.pop(label, None) or self._pause_all()
        self._pause(label, "idle", max(begin, self.clock.now_ns()), duration)
        for driver in driven:
            driver.resume()

    def _pause_all(self) -> list[Driver]:
        """Have nobody driven in the background any more; whom that concerned."""
        driven = [driver for driver in self.stage.drivers.values() if driver.background]
        for driver in driven:
            self.stage.perform(driver, "pause", driver.pause)
        return driven

    def _parallel(self, branches: Sequence[Sequence[Any]]) -> None:
        stops: list[StopPlay] = []

        def branch(script: Sequence[Any]) -> Callable[[], None]:
            def run() -> None:
                try:
                    self.play(script)
                except StopPlay as stop:
                    stops.append(stop)
                    self.stage.fail(stop.outcome, stop.detail)

            return run

        # What happens beside an idle shall not begin before that: on a busy host pausing takes its time.
        for first in (script[0] for script in branches):
            if isinstance(first, schema.Idle):
                self._paused[self._names[id(first)]] = self._pause_all()
        self._branches += len(branches)
        tasks = [self.clock.spawn("branch", branch(script)) for script in branches]
        for task in tasks:
            while not self.clock.wait(task.done, self.clock.now_ns() + 60_000 * MS):
                pass  # its own steps are bounded: a hang stops the play from inside
            if task.error is not None:
                raise task.error
        self._branches -= len(branches)
        if stops:
            raise stops[0]

    # Calls.

    def _do(self, step: Any, label: str, begin: int) -> None:
        every = step.every.ns(self.stage.quantities) if isinstance(step, schema.Repeated) else 0
        times = step.times if isinstance(step, schema.Repeated) else 1
        posts: list[tuple[Driver, Command]] = []
        allowance = 0
        for turn in range(times):
            due = begin + turn * every
            for driver, entity, op, args, run in self._calls.of(step, label):
                index = self._made[label] + len(posts)
                command = Command(
                    self.clock, due, run, op=op, label=label, index=index, entity=entity, args=args, order="step"
                )  # fmt: skip
                posts.append((driver, command))
        self._made[label] += len(posts)
        if isinstance(step, schema.Call | schema.Spin | schema.Ping):
            allowance = step.timeout.ns(self.stage.quantities)
            allowance *= len(posts) * step.attempts if isinstance(step, schema.Ping) else 1
        if every and times > 1:
            # The first one shall not wait for a drive in progress, or it would come too close to the second.
            lead = max((driver.slice_ms * MS for driver, _ in posts if driver.background), default=0)
            for _, command in posts:
                command.due += lead
            if not self._branches:
                self.stage.calm(posts[-1][1].due)  # what is posted besides is on its way already
        resumed: list[Driver] = []
        if isinstance(step, schema.Call | schema.Spin):
            resumed = [driver for driver in dict.fromkeys(driver for driver, _ in posts) if driver.background]
            for driver in resumed:
                driver.background = False
        self._post(posts, label, allowance)
        for driver in resumed:
            driver.resume()

    def _post(self, posts: list[tuple[Driver, Command]], label: str, allowance: int = 0) -> None:
        """Have the calls of a step made, and wait until they are."""
        self._performed[label] = [command for _, command in posts]
        for driver, command in posts:
            driver.post(command)
        self.stage.finish([command for _, command in posts], allowance)

    def _react(self, actor: Actor, kind: int, registration: str) -> None:
        """Do in a callback what the script says; on its thread."""
        for number, reaction in enumerate(self.stage.scenario.react):
            if int(KIND_BY_LABEL[reaction.to]) != kind or reaction.of not in (actor.name, base_name(actor.name)):
                continue
            self._reacted[number] += 1
            if self._reacted[number] > reaction.times:
                continue
            for step in reaction.script:
                self._do_within(step, actor, registration)

    def _do_within(self, step: Any, actor: Actor, registration: str) -> None:
        label, driver, clock = self._names[id(step)], actor.driver, self.clock
        if isinstance(step, schema.Raise):
            command = Command(
                clock, clock.now_ns(), lambda: None, op="raise", label=label, index=self._made[label],
                entity=actor.name,
            )  # fmt: skip
            self._made[label] += 1
            driver.execute(command, registration)
            raise Scripted(label)
        for _ in range(step.times if isinstance(step, schema.Repeated) else 1):
            for _, entity, op, args, run in self._calls.of(step, label, within=True):
                command = Command(
                    clock, clock.now_ns(), run, op=op, label=label, index=self._made[label], entity=entity, args=args
                )  # fmt: skip
                self._made[label] += 1
                driver.execute(command, registration)

    # Anchors of ``at``.

    def _await(self, moment: Moment) -> int:
        offset = moment.offset.ns(self.stage.quantities)
        if moment.label == "start":
            when = self._start + offset
        else:
            while moment.label not in self._performed:
                self.stage.sleep_until(self.clock.now_ns() + MS)
            commands = self._performed[moment.label]
            chosen = commands if moment.index is None else [commands[moment.index]]
            self.stage.finish(chosen, 60_000 * MS)
            when = (chosen[0].begin if moment.edge == "begin" else chosen[-1].end) + offset
        self.stage.sleep_until(when)
        return max(when, self.clock.now_ns())
