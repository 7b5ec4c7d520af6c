"""Publishers and subscriptions: an identity in the world, and a registry over what it tells of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nros_backends.reference.wire import LARGEST
from nros_conformance.model.world import Occurrence, Sample, Topic
from nros_conformance.rmw.backend import MessageCallback, Publisher, Subscription
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import CountTracker, LivelinessTally
from nros_conformance.rmw.dispatch import EventRegistry
from nros_conformance.rmw.events import EventCallback, EventKind, Side
from nros_conformance.rmw.qos import QosProfile

if TYPE_CHECKING:
    from nros_backends.reference.session import ReferenceSession


class _Entity:
    """What both ends share: an identity in the world, and a registry over count and liveliness sources."""

    side: Side
    topic: str
    type_name: str
    qos: QosProfile
    registry_type: type[EventRegistry] = EventRegistry
    tracker_type: type[CountTracker] = CountTracker
    tally_type: type[LivelinessTally] = LivelinessTally

    def __init__(self, session: ReferenceSession, key: Topic, topic: str, type_name: str, qos: QosProfile) -> None:
        self.session = session
        self.backend = session.backend
        self.key = key
        self.topic = topic
        self.type_name = type_name
        self.qos = qos
        self.id = next(self.backend.ids)
        self.sources: dict[EventKind, LivelinessTally | CountTracker] = {
            kind: self.tally_type() if kind is EventKind.LIVELINESS_CHANGED else self.tracker_type()
            for kind in EventKind
            if kind.side is self.side
        }
        self.registry = self.registry_type(session.queue, self.sources, qos_deadline_ms=qos.deadline_ms)
        self.destroyed = False
        self.backend.entities[self.id] = self  # type: ignore[assignment]
        session.entities.append(self)  # type: ignore[arg-type]

    def occurred(self, occurrence: Occurrence) -> None:
        """Note it for the next callback."""
        source = self.sources[occurrence.kind]
        if isinstance(source, LivelinessTally):
            source.add(occurrence.change[0], occurrence.change[1], occurrence.at_ns)
        else:
            source.add(occurrence.change[0], occurrence.at_ns)

    def preset(self, kind: int | None, count: int) -> int:
        """See `Backend.inject`."""
        with self.backend.lock:
            if kind is None:
                self.backend.world.preset(self.id, count)
            else:
                self.sources[EventKind(kind)].preset(count)
        return ReturnCode.OK

    def supports_event(self, kind: int) -> bool:
        return self.registry.supports(kind)

    def register_event(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        code = self.registry.register(kind, deadline_ms, callback, context)
        if code == ReturnCode.OK and EventKind(kind).is_deadline and not self.qos.has_deadline:
            with self.backend.lock:
                self.backend.world.set_deadline(self.id, deadline_ms)
        self.session.signal.set()
        return code

    def destroy(self) -> int:
        if self.destroyed:
            return ReturnCode.INVALID_ARGUMENT
        self.destroyed = True
        self.registry.close()
        with self.backend.lock:
            self.leave(self.backend.clock.now_ns())
            del self.backend.entities[self.id]
        self.session.entities.remove(self)  # type: ignore[arg-type]
        return ReturnCode.OK

    def leave(self, now_ns: int) -> None:
        """Take it out of the world."""
        raise AssertionError


class ReferencePublisher(_Entity, Publisher):
    """The sending end."""

    side = Side.PUBLISHER
    unheard = False
    """Whether the wire loses what it publishes."""

    def __init__(self, session: ReferenceSession, key: Topic, topic: str, type_name: str, qos: QosProfile) -> None:
        super().__init__(session, key, topic, type_name, qos)
        with self.backend.lock:
            now = self.backend.clock.now_ns()
            node = (session.options.domain_id, session.options.node_name)
            self.backend.tell(self.backend.world.create_publisher(self.id, key, node, qos, now))

    def publish_raw(self, data: bytes) -> int:
        if self.destroyed:
            return ReturnCode.INVALID_ARGUMENT
        if len(data) > LARGEST:
            return ReturnCode.MESSAGE_TOO_LARGE
        if self.session.lost:
            return ReturnCode.CONNECTION_FAILED
        with self.backend.lock:
            self.backend.advance()
            now = self.backend.clock.now_ns()
            if self.session.link.stalled:
                self.session.held.append(lambda: self.send(data))
            elif self.session.link.delay:
                self.backend.later(now + self.session.link.delay, lambda: self.send(data))
            else:
                self.send(data)
        return ReturnCode.OK

    def send(self, data: bytes) -> None:
        """What was published comes to the agent, and from there to whom it reaches."""
        if self.destroyed:
            return
        now = self.backend.clock.now_ns()
        heard = self.session.link.out and self.backend.agent.knows(self.session.id)
        if heard:
            self.backend.agent.hears(self.session.id, now)
        listeners = [one for one in self.backend.entities.values() if isinstance(one, ReferenceSubscription)]
        deaf = {one.id for one in listeners if not one.session.link.in_}
        lost = self.unheard or not heard
        self.backend.tell(self.backend.world.publish(self.id, data, now, lost=lost, deaf=deaf))
        for one in listeners:
            if self.backend.world.matched(self.id, one.id):
                one.arrived(self.id, now)

    def assert_liveliness(self) -> int:
        if self.destroyed:
            return ReturnCode.INVALID_ARGUMENT
        with self.backend.lock:
            self.backend.tell(self.backend.world.assert_liveliness(self.id, self.backend.clock.now_ns()))
        return ReturnCode.OK

    def leave(self, now_ns: int) -> None:
        self.backend.tell(self.backend.world.destroy_publisher(self.id, now_ns))


class ReferenceSubscription(_Entity, Subscription):
    """The receiving end."""

    side = Side.SUBSCRIPTION

    def __init__(self, session: ReferenceSession, key: Topic, topic: str, type_name: str, qos: QosProfile) -> None:
        super().__init__(session, key, topic, type_name, qos)
        with self.backend.lock:
            now = self.backend.clock.now_ns()
            self.backend.tell(self.backend.world.create_subscription(self.id, key, qos, now))

    def has_data(self) -> bool | int:
        if self.destroyed:
            return ReturnCode.INVALID_ARGUMENT
        with self.backend.lock:
            return self.backend.world.peek(self.id, self.backend.clock.now_ns()) is not None

    def arrived(self, publisher: int, now_ns: int) -> None:
        """Announce what a publisher has just sent, to be taken as long as it waits."""
        sample = self.backend.world.newest(self.id, publisher)
        if sample is not None:
            self.registry.message(now_ns, lambda: self._waits(sample))
            self.session.signal.set()

    def repeated(self, publisher: int, now_ns: int) -> None:
        """The newest sample of a publisher came once more: known already, so nothing comes of it (MSL-004)."""

    def _waits(self, sample: Sample) -> bool:
        with self.backend.lock:
            return self.backend.world.waits(self.id, sample, self.backend.clock.now_ns())

    def try_recv_raw(self, max_size: int) -> bytes | int:
        if self.destroyed or max_size < 0:
            return ReturnCode.INVALID_ARGUMENT
        with self.backend.lock:
            sample = self.backend.world.peek(self.id, self.backend.clock.now_ns())
            if sample is None:
                return ReturnCode.NO_DATA
            self.backend.world.take(self.id, self.backend.clock.now_ns())
        return sample.data if len(sample.data) <= max_size else ReturnCode.BUFFER_TOO_SMALL

    def set_message_callback(self, callback: MessageCallback | None, context: object) -> int:
        return self.registry.set_message_callback(callback, context)

    def leave(self, now_ns: int) -> None:
        self.backend.tell(self.backend.world.destroy_subscription(self.id, now_ns))
