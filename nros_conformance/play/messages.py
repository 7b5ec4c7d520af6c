"""The samples that the sessions of one process take."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nros_conformance.play import payload
from nros_conformance.play.actors import Actor
from nros_conformance.rmw.backend import Subscription
from nros_conformance.trace.records import Message

if TYPE_CHECKING:
    from nros_conformance.play.stage import Stage


class Messages:
    """Takes samples, and writes them down."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._drained: list[Actor] = []
        self.heard: dict[tuple[str, str], int] = {}
        """By publisher and subscription: the last sequence number that was taken."""

    def watch(self, actor: Actor) -> None:
        """Take what ``take: always`` or an executor of the session takes; for an entity just created."""
        handle = actor.handle
        if not isinstance(handle, Subscription):
            return
        if actor.spec.take == "always" and actor not in self._drained:
            self._drained.append(actor)
            actor.driver.after_drive.append(lambda: self._drain(actor))
        if actor.driver.name in self._stage.executors:
            self._stage.executors[actor.driver.name].add_subscription(handle, lambda data: self._spun(actor, data))

    def _drain(self, actor: Actor) -> None:
        if actor.handle is not None and not actor.gone:
            self.take(actor, None, 65536)

    def _spun(self, actor: Actor, data: bytes) -> None:
        actor.driver.callbacks += 1
        with actor.driver.callback():
            self._note(actor, data, callback=True)

    def take(self, actor: Actor, limit: int | None, size: int) -> int:
        """Take up to ``limit`` samples; how many, or the code when there was none."""
        handle = actor.created()
        assert isinstance(handle, Subscription)
        taken = 0
        while limit is None or taken < limit:
            data = handle.try_recv_raw(size)
            if not isinstance(data, bytes):
                return taken or int(data)
            taken += 1
            self._note(actor, data)
        return taken

    def _note(self, actor: Actor, data: bytes, *, callback: bool = False) -> None:
        """Write down a sample that was taken."""
        stage = self._stage
        t = stage.clock.now_ns()
        identity = payload.decode(data)
        ours = identity is not None and identity.run == stage.run_tag
        sender = stage.names[identity.publisher] if ours and identity else ""
        if identity is not None and sender:
            self.heard[(sender, actor.name)] = identity.sequence
        actor.driver.keep(
            Message(
                session=actor.driver.name, entity=actor.name, t=t, publisher=sender,
                sequence=identity.sequence if ours and identity else 0,
                label=stage.labels[identity.label] if ours and identity else "", size=len(data), callback=callback,
            )
        )  # fmt: skip
