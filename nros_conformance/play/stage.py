"""The stage of one scenario: its backend, sessions, entities, and what is recorded of them."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from nros_conformance.node.executor import Executor
from nros_conformance.play.actors import Actor
from nros_conformance.play.driver import Command, Driver, StopPlay
from nros_conformance.play.forked import ForkedModule
from nros_conformance.play.lives import Lives
from nros_conformance.play.messages import Messages
from nros_conformance.play.orders import Cast
from nros_conformance.play.peer import Peer
from nros_conformance.play.plan import Plan
from nros_conformance.play.processes import SessionProcess
from nros_conformance.play.reconnection import Kept
from nros_conformance.play.remote import RemoteDriver
from nros_conformance.play.starvation import wait_patiently
from nros_conformance.rmw.backend import Backend, Environment, Host, SessionOptions
from nros_conformance.rmw.child import launch
from nros_conformance.rmw.clock import MS, Clock
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.suite import schema
from nros_conformance.suite.kinds import faults_needed
from nros_conformance.suite.walk import members, session_of, step_labels, steps
from nros_conformance.trace.records import AnyRecord

_PATIENCE = 5
"""How much longer a call may take, in limits, while the host gives its threads no core."""


class Stage:
    """Everything that lives while one scenario is played.

    In a process of its own (``only`` its session) a part of it; ``run_tag`` and ``locator`` are then those of
    the whole, and ``failed`` is told when the play cannot go on.
    """

    def __init__(
        self, plan: Plan, scenario: schema.Scenario, adapter: type[Backend], clock: Clock,
        record: Callable[[AnyRecord], None], *, only: str = "", run_tag: int | None = None, locator: str = "",
        failed: Callable[[str, str], None] = lambda outcome, detail: None,
    ) -> None:  # fmt: skip
        self.plan = plan
        self.scenario = scenario
        self.clock = clock
        self._write = record
        self.sink: Callable[[AnyRecord], None] | None = None
        """Takes the records in place of the trace."""
        self.quantities = plan.header.quantities
        self.abort = clock.signal()
        self.stopped: StopPlay | None = None
        # Distinguishes runs that can hear each other; on a virtual clock nobody can, and plays are repeatable.
        fresh = 1 if clock.virtual else int.from_bytes(os.urandom(6), "little")
        self.run_tag = fresh if run_tag is None else run_tag
        self.start = clock.now_ns()
        self._told = failed
        self._only = only
        self._apart = set() if clock.virtual or only else sessions_apart(scenario)
        host = Host(
            clock=clock,
            variant=plan.header.variant,
            network=plan.network,
            ports=range(*plan.ports),
            scratch=Path(f"{plan.trace}.d"),
            faults=faults_needed(scenario),
            options=plan.options,
            processes=bool(only or self._apart),
            launch=launch if only else ForkedModule,  # who is forked forks nobody
        )
        self.backend = adapter(host)
        # In a process of its own a session has the peer of the whole play, by its locator.
        self.peer = Peer(Environment() if only else self.backend.environment(), clock, record)
        # Calls may last as long as a peer that does not answer lets them.
        silent = scenario.peer == "absent" or any(isinstance(step, schema.Fault) for _, step in steps(scenario))
        self.hang_ns = plan.hang_ns + 2 * silent * self.quantities.get("connection_lease", 0)
        self.lobby = Driver("", clock, record, self.fail)
        """The thread for calls without a session."""
        self.kept: dict[str, Kept] = {}
        """The sessions with a reconnector."""
        self.drivers: dict[str, Driver] = {}
        self.actors: dict[str, Actor] = {}
        self.labels = step_labels(scenario)
        """What payloads refer to by position; the same in every process."""
        self.names: list[str] = []
        """All entities, in the same way."""
        self.executors: dict[str, Executor] = {}
        self.messages = Messages(self)
        self.react: Callable[[Actor, int, str], None] = lambda actor, kind, registration: None
        """Told of each status callback while it runs: whose, of which kind and registration."""
        self.lives = Lives(self, only)
        try:
            if scenario.peer == "present":
                self.peer.start()
            elif not self.peer.endpoint():
                self.peer.appoint()
            self.locator = locator or self.peer.endpoint()
            self._cast()
        except BaseException:
            self.peer.close(self.folder)
            raise

    @property
    def folder(self) -> Path | None:
        """Where what is left of the play is kept, beside its trace; None without one."""
        return self.backend.host.scratch if self.plan.trace else None

    # Who is who.

    def topic_of(self, actor: Actor) -> str:
        """The topic as the backend gets it."""
        return actor.topic if actor.spec.raw else f"/nrcf{self.run_tag:x}/{actor.topic}"

    def members(self, name: str) -> list[Actor]:
        """The entity of this name, or all of ``count`` entities that share it."""
        if name in self.actors:
            return [self.actors[name]]
        return [actor for actor in self.actors.values() if actor.name.startswith(f"{name}[")]

    def label_index(self, label: str) -> int:
        """The position of a label in the list that payloads refer to."""
        return self.labels.index(label)

    def _cast(self) -> None:
        expanded = [(one, spec) for name, spec in self.scenario.entities.items() for one in members(name, spec)]
        names = list(self.scenario.sessions)
        for _, spec in expanded:
            names.append(session_of(spec))
        for name in dict.fromkeys(names):
            if self._only in ("", name):
                self.drivers[name] = self._driver(name)
        self.names = [name for name, _ in expanded]
        for index, (name, spec) in enumerate(expanded):
            if session_of(spec) in self.drivers:
                self.actors[name] = Actor(name, spec, self.drivers[session_of(spec)], index)

    def _driver(self, name: str) -> Driver:
        if name not in self._apart:
            return Driver(name, self.clock, self.record, self.fail)

        def cast(first_sequence: int) -> Cast:
            return Cast(self.plan, name, self.run_tag, self.start, self.locator, first_sequence)

        driven = self.scenario.sessions[name].driven
        stepped = any(
            isinstance(step, schema.Fault) and (step.fault, step.of) == ("clock_step", name)
            for _, step in steps(self.scenario)
        )
        return RemoteDriver(
            name, self.clock, self.record, self.fail, lambda: SessionProcess(name, stepped=stepped), cast, driven
        )  # fmt: skip

    def record(self, record: AnyRecord) -> None:
        """Write a record down."""
        (self.sink or self._write)(record)

    # Failing and waiting.

    def fail(self, outcome: str, detail: str) -> None:
        """End the play from any thread; the first reason counts."""
        if self.stopped is None:
            self.stopped = StopPlay(outcome, detail)
            self._told(outcome, detail)
        self.abort.set()

    def sleep_until(self, when: int) -> None:
        """Let the drivers work; raises `StopPlay` when one of them failed."""
        self.clock.wait(self.abort, when)
        if self.stopped is not None:
            raise self.stopped

    def calm(self, until: int) -> None:
        """No call will be made before ``until``."""
        for driver in self.drivers.values():
            driver.calm_until = until

    def finish(self, commands: list[Command], allowance_ns: int = 0) -> None:
        """Wait for posted calls; raises `StopPlay` for a hang or a failure."""
        apart = [driver.process.pid for driver in self.drivers.values() if isinstance(driver, RemoteDriver)]
        for command in commands:
            limit = max(command.due, self.clock.now_ns()) + allowance_ns + self.hang_ns
            if not wait_patiently(self.clock, command.done, limit, _PATIENCE * self.hang_ns, ["self", *apart]):
                raise self._hang(command)
        if self.stopped is not None:
            raise self.stopped

    def _hang(self, command: Command) -> StopPlay:
        for driver in (*self.drivers.values(), self.lobby):
            if isinstance(driver, RemoteDriver) and driver.owes(command):
                lasted = (self.clock.now_ns() - command.due) / 1e9
                return StopPlay("hang", f"{command.op} on session {driver.name} has not returned after {lasted:.1f} s")
            if driver.calling is not None:
                call, begin = driver.calling
                lasted = (self.clock.now_ns() - begin) / 1e9
                if lasted > self.hang_ns / 2e9:
                    return StopPlay("hang", f"{call} on session {driver.name} has not returned after {lasted:.1f} s")
        return StopPlay("hang", f"{command.op} on session {command.entity or '?'} did not get its turn")

    def perform(self, driver: Driver, op: str, run: Callable[[], object], entity: str = "") -> Command:
        """Make one unrecorded call on a session's thread now, and wait for it.

        ``op`` (and ``entity``) is what `orders.Order` says to a session in another process.
        """
        command = Command(self.clock, self.clock.now_ns(), run, op=op, entity=entity, record=False, order=op)
        driver.post(command)
        self.finish([command])
        return command

    # Beginning and ending.

    def open(self) -> None:
        """Start the sessions' threads, create the sessions, then the entities that are not deferred, in order."""
        for name, driver in self.drivers.items():
            if self.spec_of(name).reconnector:
                self.kept[name] = Kept(self, driver)
                self.prepare(driver)
                driver.resume()
            elif self.scenario.peer == "present":
                self.perform(driver, "connect", lambda driver=driver: self.lives.connect(driver))  # type: ignore[misc]
                self.prepare(driver)
        for actor in self.actors.values():
            if not actor.spec.deferred and actor.driver.connected:
                self.perform(actor.driver, "create", lambda actor=actor: self.lives.create(actor), actor.name)  # type: ignore[misc]

    def spec_of(self, session: str) -> schema.Session:
        """What the scenario says of a session; it need not."""
        return self.scenario.sessions.get(session, schema.Session())

    def options(self, session: str) -> SessionOptions:
        """The arguments of ``create_session``, or of a ping without one."""
        spec = self.spec_of(session)
        return SessionOptions(
            node_name=spec.node or session or "node",
            locator=self.locator,
            domain_id=spec.domain,
            connection_lease_ms=0 if spec.lease is None else spec.lease.ns(self.quantities) // MS,
            hard_liveliness_ms=0 if spec.hard_liveliness is None else spec.hard_liveliness.ns(self.quantities) // MS,
        )

    def probe(self, session: str, timeout_ms: int, attempts: int) -> int:
        """Ping without a session."""
        return int(self.backend.ping(self.options(session), timeout_ms, attempts))

    def prepare(self, driver: Driver) -> None:
        """Set how a session that has been connected is driven."""
        spec = self.spec_of(driver.name)
        driver.slice_ms = max(1, spec.slice.ns(self.quantities) // MS)
        driver.background = spec.reconnector or (driver.connected and spec.driven)

    def refused(self, fault: str, code: int) -> None:
        """End the play when the adapter did not inject a fault: what follows would prove nothing."""
        if code == ReturnCode.UNSUPPORTED:
            self.fail("raised", f"inject({fault}) answered UNSUPPORTED, though backend.toml declares the fault")

    def close(self) -> None:
        """Destroy all sessions and end their threads, then stop the peer."""
        for name in self.kept:
            driver = self.drivers[name]
            self.perform(driver, "pause", driver.pause)
        for name, driver in self.drivers.items():
            if driver.connected and not (isinstance(driver, RemoteDriver) and driver.process.frozen):
                self.perform(driver, "destroy", lambda name=name: self.lives.destroy(name))  # type: ignore[misc]
        for driver in (*self.drivers.values(), self.lobby):
            driver.stop()
            self.clock.wait(driver.task.done, self.clock.now_ns() + self.hang_ns)
        self.peer.close(self.folder, clean=True)
        self.backend.close()


def sessions_apart(scenario: schema.Scenario) -> set[str]:
    """The sessions that live in processes of their own."""
    return {name for name, spec in scenario.sessions.items() if spec.process == "own"}
