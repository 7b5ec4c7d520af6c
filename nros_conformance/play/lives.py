"""What comes into being on a stage, and ends: sessions, entities, registrations; each on its session's thread."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nros_conformance.node.executor import Executor
from nros_conformance.play.actors import Actor, qos_profile
from nros_conformance.play.callbacks import StatusCallback
from nros_conformance.rmw.clock import MS
from nros_conformance.rmw.codes import RmwError, code_name
from nros_conformance.rmw.events import KIND_BY_LABEL, EventCallback, EventKind, Side
from nros_conformance.suite import schema
from nros_conformance.suite.kinds import registered_kinds
from nros_conformance.suite.walk import steps
from nros_conformance.trace.records import Registered, State

if TYPE_CHECKING:
    from nros_conformance.play.driver import Driver
    from nros_conformance.play.stage import Stage


class Lives:
    """Those of one stage. In a process of its own (``only`` its session) that has yet to be created."""

    def __init__(self, stage: Stage, only: str) -> None:
        self._stage = stage
        self._closed = {only} - {""}
        self._spun_sessions = {step.session for _, step in steps(stage.scenario) if isinstance(step, schema.Spin)}

    def connect(self, driver: Driver) -> int:
        """Create a session; on its thread. The return code."""
        stage, clock = self._stage, self._stage.clock
        name = driver.name
        spec = stage.spec_of(name)
        self._closed.discard(name)
        driver.session = None
        begin = clock.now_ns()
        code, detail = 0, ""
        try:
            driver.session = stage.backend.create_session(stage.options(name))
            if name in self._spun_sessions:
                stage.executors[name] = Executor(driver.session)
        except RmwError as error:
            code, detail = int(error.code), error.detail
        what = "created" if code == 0 else "refused"
        end = clock.now_ns()
        driver.keep(State(entity="", session=name, what=what, code=code, detail=detail, begin=begin, end=end))
        if code and not spec.may_fail and not spec.reconnector:
            stage.fail("raised", f"create_session answered {code_name(code)}: {detail}")
        stage.prepare(driver)
        return code

    def create(self, actor: Actor, *, stale: bool = False) -> int:
        """Create an entity and register its events; on its session's thread. The return code.

        If its session has been destroyed, or does not exist yet, that is created before, unless the stale one is
        wanted.
        """
        stage, clock = self._stage, self._stage.clock
        if not stale and (actor.driver.name in self._closed or actor.driver.session is None):
            code = self.connect(actor.driver)
            if code:
                return code
        session = actor.driver.session
        assert session is not None
        topic = stage.topic_of(actor)
        type_name = f"nros_conformance_msgs/msg/{actor.spec.type}"
        begin = clock.now_ns()
        code, detail = 0, ""
        try:
            qos = qos_profile(actor.spec.qos, stage.quantities)
            maker = session.create_publisher if actor.side is Side.PUBLISHER else session.create_subscription
            actor.handle = maker(topic, type_name, qos)
            actor.gone = False
        except RmwError as error:
            code, detail = int(error.code), error.detail
        what = "created" if code == 0 else "refused"
        actor.driver.keep(
            State(
                entity=actor.name, session=actor.driver.name, what=what, code=code, detail=detail,
                begin=begin, end=clock.now_ns(),
            )
        )  # fmt: skip
        if code and not actor.spec.may_fail and actor.driver.name not in stage.kept:
            stage.fail("raised", f"creating {actor.name} answered {code_name(code)}: {detail}")
        if code == 0:
            self._register_all(actor)
            stage.messages.watch(actor)
        return code

    def destroy(self, name: str) -> int:
        """Destroy an entity, or the session of this name; on its session's thread."""
        stage, clock = self._stage, self._stage.clock
        begin = clock.now_ns()
        if name in stage.drivers:
            driver, entity = stage.drivers[name], ""
            driver.background = False
            code = int(driver.session.destroy()) if driver.session is not None else 0
            self._closed.add(name)
            for actor in stage.actors.values():
                actor.gone |= actor.driver is driver
        else:
            actor = stage.actors[name]
            driver, entity = actor.driver, name
            code = int(actor.created().destroy())
            actor.gone |= code == 0
        end = clock.now_ns()
        driver.flush()
        driver.keep(State(entity=entity, session=driver.name, what="destroyed", code=code, begin=begin, end=end))
        return code

    def struck(self, fault: str, driver: Driver) -> None:
        """A simulated process was hit: it is driven no more, or again."""
        if fault == "thaw":
            driver.background = self._stage.spec_of(driver.name).driven
        elif fault in ("crash", "freeze"):
            driver.background = False
        if fault == "crash":
            driver.session = None
            self._closed.add(driver.name)
            for actor in self._stage.actors.values():
                actor.gone |= actor.driver is driver

    def registration_deadline_ms(self, actor: Actor) -> int:
        """``deadline_ms`` for the deadline kinds: as the scenario says, else the QoS', else 1T."""
        stage = self._stage
        if actor.spec.registration_deadline is not None:
            return actor.spec.registration_deadline.ns(stage.quantities) // MS
        deadline = actor.spec.qos.deadline
        if deadline is not None and not deadline.is_infinite and deadline.ns(stage.quantities):
            return deadline.ns(stage.quantities) // MS
        return stage.quantities["T"] // MS

    def _register_all(self, actor: Actor) -> None:
        stage, clock = self._stage, self._stage.clock
        wanted = actor.spec.register
        if wanted == "none":
            return
        side = [kind for kind in EventKind if kind.side is actor.side]
        names = registered_kinds(stage.scenario, actor.name) if wanted == "expected" else wanted
        handle = actor.created()
        for kind in side if wanted == "supported" else [KIND_BY_LABEL[name] for name in names]:
            begin = clock.now_ns()
            supports = handle.supports_event(int(kind))
            if wanted == "supported" and not supports:
                continue
            label = f"{actor.name}/{kind.label}"
            deadline = self.registration_deadline_ms(actor) if kind.is_deadline else 0
            code = handle.register_event(int(kind), deadline, self.callback(actor, label), label)
            actor.driver.keep(
                Registered(
                    registration=label, entity=actor.name, session=actor.driver.name, kind=int(kind),
                    supports=bool(supports), code=int(code), begin=begin, end=clock.now_ns(),
                )
            )  # fmt: skip

    def callback(self, actor: Actor, registration: str) -> EventCallback:
        """A callback to register."""
        return StatusCallback(self._stage, actor, registration)
