"""Publishers and subscriptions on a bus."""

from __future__ import annotations

from collections import deque
from functools import partial

from nros_backends.uorb.bus import Node
from nros_backends.uorb.domain import Domain
from nros_conformance.rmw.backend import MessageCallback, Publisher, Subscription
from nros_conformance.rmw.clock import Clock
from nros_conformance.rmw.codes import ReturnCode
from nros_conformance.rmw.detection import CountTracker
from nros_conformance.rmw.dispatch import EventRegistry, ReadyQueue
from nros_conformance.rmw.events import CountStatus, EventCallback, EventKind
from nros_conformance.rmw.qos import QosProfile


class Surroundings:
    """What a session lends its entities."""

    def __init__(self, domain: Domain, clock: Clock) -> None:
        self.domain = domain
        self.clock = clock
        self.ready = ReadyQueue()
        self.wake = clock.signal()
        """Raised when there is something to dispatch or to take."""
        self.entities: dict[UorbPublisher | UorbSubscription, None] = {}


class _Losses:
    """A loss counter as the event source of the driving thread, while publishers add to it."""

    def __init__(self, domain: Domain) -> None:
        self._lock = domain.lock
        self._tracker = CountTracker()

    def add(self, count: int, at_ns: int) -> None:
        """Called with the lock held."""
        self._tracker.add(count, at_ns)

    def preset(self, total: int) -> None:
        """Called with the lock held."""
        self._tracker.preset(total)

    @property
    def ready_ns(self) -> int | None:
        return self._tracker.ready_ns

    def take(self) -> CountStatus | None:
        with self._lock:
            return self._tracker.take()


class UorbPublisher(Publisher):
    """Advertises instance 0 of its topic, which any number of publishers share.

    It never unadvertises: in PX4 that would hide what is unread, of the other publishers too. PX4's
    own ``uORB::Publication`` leaves topics with a queue advertised for the same reason.
    """

    def __init__(self, here: Surroundings, topic: str, type_name: str, qos: QosProfile) -> None:
        self.topic = topic
        self.type_name = type_name
        self.qos = qos
        self.node = here.domain.advertise(topic, type_name)
        self._here = here
        self._events = EventRegistry(here.ready, {})
        here.entities[self] = None

    def supports_event(self, kind: int) -> bool:
        return self._events.supports(kind)

    def register_event(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        return self._events.register(kind, deadline_ms, callback, context)

    def publish_raw(self, data: bytes) -> int:
        """OK; MESSAGE_TOO_LARGE above the capacity of a slot; INVALID_ARGUMENT."""
        if self._events.closed or not isinstance(data, bytes | bytearray | memoryview):
            return ReturnCode.INVALID_ARGUMENT
        with self._here.domain.lock:
            stored = self.node.publish(bytes(data))
        return ReturnCode.OK if stored else ReturnCode.MESSAGE_TOO_LARGE

    def assert_liveliness(self) -> int:
        return ReturnCode.INVALID_ARGUMENT if self._events.closed else super().assert_liveliness()

    def preset(self, generation: int) -> int:
        """See `UorbBackend.preset`."""
        return _preset(self._here, self._events, self.node, generation)

    def preset_total(self, kind: int, total: int) -> int:
        """UNSUPPORTED: it has no events."""
        return ReturnCode.UNSUPPORTED

    def destroy(self) -> int:
        self._events.close()
        self._here.entities.pop(self, None)
        return ReturnCode.OK


class UorbSubscription(Subscription):
    """Reads the last ``qos.depth`` samples of instance 0 of its topic.

    Its generation is moved on by each publication that leaves more than that unread, and each sample
    passed over is lost, from that moment on. The one sample from before the subscription that PX4
    shows a late subscriber is delivered, and is history: passing over it loses nothing.
    """

    def __init__(self, here: Surroundings, topic: str, type_name: str, qos: QosProfile) -> None:
        self.topic = topic
        self.type_name = type_name
        self.qos = qos
        self._here = here
        self._losses = _Losses(here.domain)
        self._events = EventRegistry(here.ready, {EventKind.MESSAGE_LOST: self._losses})
        self._message: tuple[MessageCallback, object] | None = None
        self._arrived = 0  # samples so far: the serial number of the next one
        self._announced = 0  # serial number up to which message callbacks have been queued
        with here.domain.lock:
            self._reader = here.domain.subscribe(topic, type_name)
            node = self._reader.node
            assert node is not None
            self.node: Node = node
            self._history = self._reader.unread
            self._arrived = self._history
            # When each unread sample came, ns.
            self._unread_since = deque([here.clock.now_ns()] * self._history, maxlen=qos.depth)
            self.node.callbacks.append(self._published)
        here.entities[self] = None

    def supports_event(self, kind: int) -> bool:
        return self._events.supports(kind)

    def register_event(self, kind: int, deadline_ms: int, callback: EventCallback | None, context: object) -> int:
        with self._here.domain.lock:
            return self._events.register(kind, deadline_ms, callback, context)

    def set_message_callback(self, callback: MessageCallback | None, context: object) -> int:
        """Also called for each sample that is unread by now."""
        if self._events.closed:
            return ReturnCode.INVALID_ARGUMENT
        with self._here.domain.lock:
            if self._message is None:
                self._announced = self._arrived - len(self._unread_since)
            self._message = None if callback is None else (callback, context)
            if self._unread_since:
                self._here.wake.set()
        return ReturnCode.OK

    def has_data(self) -> bool | int:
        if self._events.closed:
            return ReturnCode.INVALID_ARGUMENT
        return len(self._unread_since) > 0

    def try_recv_raw(self, max_size: int) -> bytes | int:
        """The oldest unread sample; BUFFER_TOO_SMALL drops it, and it is then counted as lost (ROB-002)."""
        if self._events.closed or not isinstance(max_size, int) or max_size < 0:
            return ReturnCode.INVALID_ARGUMENT
        with self._here.domain.lock:
            if not self._unread_since:
                return ReturnCode.NO_DATA
            data = self._reader.copy()
            assert data is not None
            self._unread_since.popleft()
            if len(data) > max_size:
                self._passed_over(1)
                self._here.wake.set()
                return ReturnCode.BUFFER_TOO_SMALL
            self._history = 0
            return data

    def preset(self, generation: int) -> int:
        """See `UorbBackend.preset`."""
        return _preset(self._here, self._events, self.node, generation)

    def preset_total(self, kind: int, total: int) -> int:
        """As if so many samples had been lost and reported; UNSUPPORTED for another event."""
        if kind != EventKind.MESSAGE_LOST:
            return ReturnCode.UNSUPPORTED
        with self._here.domain.lock:
            self._losses.preset(total)
        return ReturnCode.OK

    def destroy(self) -> int:
        with self._here.domain.lock:
            if not self._events.closed:
                self._events.close()
                self._message = None
                self.node.callbacks.remove(self._published)
                self._reader.detach()
                self._unread_since.clear()
                self._here.entities.pop(self)
        return ReturnCode.OK

    def collect(self) -> None:
        """Queue what has become ready; the driving thread calls it."""
        with self._here.domain.lock:
            self._events.poll()
            if self._message is not None:
                oldest = self._arrived - len(self._unread_since)
                for serial in range(max(self._announced, oldest), self._arrived):
                    self._here.ready.push(self._unread_since[serial - oldest], partial(self._announce, serial))
            self._announced = self._arrived

    def _announce(self, serial: int) -> bool:
        """Call the message callback, unless the sample has been taken or lost since."""
        message = self._message
        if message is None or serial < self._arrived - len(self._unread_since):
            return False
        callback, context = message
        callback(context)
        return True

    def _published(self) -> None:
        """In the publisher's thread, with the lock held (``SubscriptionCallback::call``)."""
        self._passed_over(self._reader.trim(self.qos.depth))
        self._unread_since.append(self._here.clock.now_ns())
        self._arrived += 1
        self._here.wake.set()

    def _passed_over(self, count: int) -> None:
        """So many of the oldest unread samples will not be delivered."""
        if count:
            history = min(count, self._history)
            self._history -= history
            self._losses.add(count - history, self._here.clock.now_ns())


def _preset(here: Surroundings, events: EventRegistry, node: Node, generation: int) -> int:
    if events.closed:
        return ReturnCode.INVALID_ARGUMENT
    with here.domain.lock:
        node.preset(generation)
    return ReturnCode.OK
