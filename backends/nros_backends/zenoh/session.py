"""A session: one zenoh session, the graph that it sees, and the loop that dispatches for its entities.

What zenoh's threads call does three things: it notes what came and when, in one queue for all, updates the
graph, and wakes `drive_io`, which works the queue off.
"""

from __future__ import annotations

import atexit
import collections
import threading
import weakref
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import zenoh

from nros_backends.zenoh import attachment, keys
from nros_backends.zenoh.config import HANDSHAKE_MS
from nros_backends.zenoh.ends import End
from nros_backends.zenoh.keys import Token
from nros_backends.zenoh.leases import Watch
from nros_backends.zenoh.network import Network
from nros_backends.zenoh.ping import ping_router
from nros_backends.zenoh.policies import admit
from nros_backends.zenoh.publisher import ZenohPublisher
from nros_backends.zenoh.subscription import ZenohSubscription
from nros_conformance.rmw.backend import Publisher, Session, Subscription
from nros_conformance.rmw.clock import NEVER, Clock
from nros_conformance.rmw.codes import ReturnCode, RmwError
from nros_conformance.rmw.dispatch import ReadyQueue
from nros_conformance.rmw.driving import Driving
from nros_conformance.rmw.events import Side
from nros_conformance.rmw.qos import Liveliness, QosProfile, is_finite

_E = TypeVar("_E", bound=End)
_Note = Callable[[], bool]
"""Something that came, to be worked off on the driving thread; whether a sample was among it."""


class ZenohSession(Session):
    """Node and transport in one, as in nano-ros."""

    def __init__(
        self, clock: Clock, network: Network, locator: str, domain: int, node_name: str, lease_ms: int
    ) -> None:
        self.clock = clock
        self.domain = domain
        self.queue = ReadyQueue()
        self.closed = False
        self.dispatching = threading.RLock()
        """Held while events are found and callbacks run, not while `drive_io` waits."""
        self.leasing = threading.RLock()
        """Guards leases and tokens of publishers."""
        self.zenoh: zenoh.Session
        self._network = network
        self.locator = locator
        self._node_name = node_name
        self.lease_ms = lease_ms
        self._transports: dict[int, zenoh.Session] = {}
        """By lease, ms: those for leases shorter than the session's."""
        self._signal = clock.signal()
        self._inbox: collections.deque[_Note] = collections.deque()
        self._graph: dict[str, Token] = {}
        """All tokens of the domain, kept up to date by zenoh's threads."""
        self._known: dict[str, Token] = {}
        """The same as far as the inbox has been worked off."""
        self._ends: dict[int, End] = {}
        self._numbers = 0
        self._subscribers: dict[str, tuple[zenoh.Subscriber[None], list[int]]] = {}
        """By key: the subscriber, and the numbers of the subscriptions that share it."""
        self._links: set[str] = set()
        """Whom its transport is connected to."""
        self._watch: Watch | None = None
        self._driving = Driving(clock)
        self._closing = threading.Lock()
        self.zenoh = network.join(self, locator, lease_ms).session
        try:
            self._introduce()
        except BaseException:
            network.leave(self)
            raise
        _living.add(self)

    def _introduce(self) -> None:
        self._listener = self.zenoh.info.declare_transport_events_listener(_callback(self._on_transport), history=True)
        self._node = self.zenoh.liveliness().declare_token(
            keys.node_key(self.domain, str(self.zenoh.zid()), self._node_name)
        )
        self._tokens = self.zenoh.liveliness().declare_subscriber(
            f"{keys.TOKENS}/{self.domain}/**", _callback(self._on_token), history=True
        )

    @property
    def connected(self) -> bool:
        """Whether a router is there, for a client; peers need nobody."""
        # The notifications may be a moment behind a session that has just been opened.
        return not self.locator or bool(self._links) or bool(self.zenoh.info.routers_zid())

    def create_publisher(self, topic: str, type_name: str, qos: QosProfile) -> Publisher:
        token = self._admit(Side.PUBLISHER, topic, type_name, qos)
        data_key = keys.data_key(self.domain, topic, type_name)
        with self._translated():
            publisher = ZenohPublisher(self, topic, type_name, token, data_key, self._transport_for(token.qos))
            self._add(publisher)
        if publisher.lease.due_ns != NEVER:
            if self._watch is None:
                self._watch = Watch(self.clock, self._expire)
            self._watch.nudge()
        return publisher

    def create_subscription(self, topic: str, type_name: str, qos: QosProfile) -> Subscription:
        token = self._admit(Side.SUBSCRIPTION, topic, type_name, qos)
        with self._translated():
            subscription = ZenohSubscription(self, topic, type_name, token)
            self._add(subscription)
            subscription.declare()
        return subscription

    def drive_io(self, timeout_ms: int, max_callbacks: int | None = None) -> int:
        """OK; WOULD_BLOCK while another drive_io of this session is in progress; INVALID_ARGUMENT.

        CONNECTION_FAILED when it is over and the router is not there. Returns early once a callback ran or a
        sample came. A negative timeout is 0 (C10).
        """
        if self.closed:
            return ReturnCode.INVALID_ARGUMENT
        code = self._driving.drive(timeout_ms, max_callbacks, self._drive)
        reached = self.closed or self.connected
        return ReturnCode.CONNECTION_FAILED if code == ReturnCode.OK and not reached else code

    def ping(self, timeout_ms: int, attempts: int = 1) -> int:
        """OK when the router has answered; UNSUPPORTED between peers."""
        if self.closed or not isinstance(timeout_ms, int) or not isinstance(attempts, int) or attempts < 1:
            return ReturnCode.INVALID_ARGUMENT
        if not self.locator:
            return ReturnCode.UNSUPPORTED
        return ping_router(self.zenoh, max(timeout_ms, 0), attempts)

    def destroy(self) -> int:
        """OK; INVALID_ARGUMENT, and no harm, the second time."""
        with self._closing:
            if self.closed:
                return ReturnCode.INVALID_ARGUMENT
            self.closed = True
        self.note()
        with self._driving.ended():
            if self._watch is not None:
                self._watch.stop()
            for end in tuple(self._ends.values()):
                end.destroy()
            # Nothing of ours is held here: closing waits for callbacks of zenoh that are running.
            self._network.leave(self)
            self._inbox.clear()
        return ReturnCode.OK

    # For the entities, and the harness.

    def note(self) -> None:
        """Have `drive_io` look, now if it waits."""
        self._signal.set()

    def subscribe(self, key: str, number: int) -> None:
        """Have the samples on this key for the subscription with this number too.

        Subscriptions to one key share a zenoh subscriber: zenoh would call Python once for each.
        """
        with self.dispatching:
            if key in self._subscribers:
                self._subscribers[key][1].append(number)
                return
            numbers = [number]

            def on_sample(sample: zenoh.Sample) -> None:
                at_ns = self.clock.now_ns()
                if sample.kind == zenoh.SampleKind.PUT:
                    payload, extra = sample.payload.to_bytes(), _bytes(sample.attachment)
                    self._note(lambda: self._sample(numbers, payload, extra, at_ns))

            self._subscribers[key] = self.zenoh.declare_subscriber(key, _callback(on_sample)), numbers

    def unsubscribe(self, key: str, number: int) -> None:
        """The contrary."""
        with self.dispatching:
            subscriber, numbers = self._subscribers[key]
            numbers.remove(number)
            if numbers:
                return
            del self._subscribers[key]
        subscriber.undeclare()

    def collector(self, number: int, gid: bytes) -> tuple[Callable[[zenoh.Sample], None], Callable[[], None]]:
        """What takes in the history of a publisher for a subscription, and its end."""
        kept: list[tuple[bytes, bytes | None]] = []

        def on_sample(sample: zenoh.Sample) -> None:
            kept.append((sample.payload.to_bytes(), _bytes(sample.attachment)))

        def on_end() -> None:
            at_ns = self.clock.now_ns()
            self._note(lambda: self._subscription(number, lambda end: end.history(gid, kept, at_ns)))

        return on_sample, on_end

    def assert_node(self, now_ns: int) -> None:
        """An assertion for all MANUAL_BY_NODE publishers of this session."""
        for publisher in self.publishers():
            if publisher.qos.liveliness is Liveliness.MANUAL_BY_NODE:
                publisher.renew(now_ns)

    def forget(self, end: End) -> None:
        """An entity is about to be destroyed."""
        self._ends.pop(end.number, None)

    def sees(self, token: Token) -> bool:
        """Whether it knows that entity, as of now."""
        return token.key in self._graph

    def counterparts(self, end: End) -> int:
        """How many entities it knows that match this one, as of now."""
        return sum(end.meets(token) for token in tuple(self._graph.values()))

    def subscriptions(self) -> Iterator[ZenohSubscription]:
        """Those that exist."""
        return (end for end in tuple(self._ends.values()) if isinstance(end, ZenohSubscription))

    def publishers(self) -> Iterator[ZenohPublisher]:
        """Those that exist."""
        return (end for end in tuple(self._ends.values()) if isinstance(end, ZenohPublisher))

    # On threads of zenoh.

    def _on_token(self, sample: zenoh.Sample) -> None:
        at_ns = self.clock.now_ns()
        key = str(sample.key_expr)
        token = keys.parse_token(key)
        if token is None:
            return  # a node, or something malformed
        alive = sample.kind == zenoh.SampleKind.PUT
        if alive:
            self._graph[key] = token
        else:
            self._graph.pop(key, None)
        self._note(lambda: self._token(token, alive, at_ns))

    def _on_transport(self, event: zenoh.TransportEvent) -> None:
        zid = str(event.transport.zid)
        if event.kind == zenoh.SampleKind.PUT:
            self._links.add(zid)
        else:
            self._links.discard(zid)
        self.note()

    def _note(self, note: _Note) -> None:
        self._inbox.append(note)
        self._signal.set()

    # On the driving thread.

    def _drive(self, until_ns: int, max_callbacks: int | None) -> None:
        while not self.closed:
            self._signal.clear()
            with self.dispatching:
                fresh = self._look()
                ran = self.queue.drain(max_callbacks)
            due_ns = self._next_due_ns()
            if ran or fresh or len(self.queue) or self.clock.now_ns() >= until_ns:
                return
            self.clock.wait(self._signal, min(until_ns, due_ns))

    def _look(self) -> bool:
        """Work off what came, then let every entity find what has happened; whether samples came."""
        fresh = False
        for _ in range(len(self._inbox)):
            fresh |= self._inbox.popleft()()
        now = self.clock.now_ns()
        for end in tuple(self._ends.values()):
            end.look(now)
        return fresh

    def _next_due_ns(self) -> int:
        return min((end.next_due_ns() for end in tuple(self._ends.values())), default=NEVER)

    def _token(self, token: Token, alive: bool, at_ns: int) -> bool:
        if alive:
            self._known[token.key] = token
        else:
            self._known.pop(token.key, None)
        for subscription in self.subscriptions():
            (subscription.publisher_came if alive else subscription.publisher_left)(token, at_ns)
        return False

    def _sample(self, numbers: list[int], payload: bytes, extra: bytes | None, at_ns: int) -> bool:
        about = attachment.decode(extra, payload)
        if about is None:
            return False
        ends = [self._ends.get(number) for number in numbers]
        fresh = [end.sample(payload, about, at_ns) for end in ends if isinstance(end, ZenohSubscription)]
        return any(fresh)

    def _subscription(self, number: int, tell: Callable[[ZenohSubscription], bool]) -> bool:
        end = self._ends.get(number)
        return tell(end) if isinstance(end, ZenohSubscription) else False

    # Creating.

    def _admit(self, side: Side, topic: str, type_name: str, qos: QosProfile) -> Token:
        """All the checks; the token of the entity to be. Raises `RmwError`."""
        if self.closed:
            raise RmwError(ReturnCode.INVALID_ARGUMENT, "the session is destroyed")
        in_force = admit(topic, type_name, qos)
        # zenoh declares into the void without a word, and learns of a router's death a moment later. A busy host can
        # lose the connection for a moment, too; CON-006 wants an answer within twice the lease.
        if self.locator and ping_router(self.zenoh, min(HANDSHAKE_MS, self.lease_ms * 3 // 2), 1) != ReturnCode.OK:
            raise RmwError(ReturnCode.CONNECTION_FAILED, f"no router answers at {self.locator}")
        name, wire_type = keys.absolute(topic), keys.wire_type(type_name)
        for other in tuple(self._graph.values()):
            if other.topic == name and other.type_name != wire_type:
                raise RmwError(ReturnCode.TOPIC_NAME_INVALID, f"topic {topic!r} has the type {other.type_name!r}")
        with self.dispatching:
            self._numbers += 1
            number = self._numbers
        zid = str(self.zenoh.zid())
        key = keys.entity_key(self.domain, zid, number, side, self._node_name, topic, type_name, in_force)
        return Token(key, zid, side, name, wire_type, in_force, keys.gid_of(key))

    def _add(self, end: End) -> None:
        with self.dispatching:
            end.number = int(end.token.key.split("/")[4])
            self._ends[end.number] = end
            if isinstance(end, ZenohSubscription):
                now = self.clock.now_ns()
                for token in self._known.values():
                    end.publisher_came(token, now)
        self.note()

    def _transport_for(self, qos: QosProfile) -> zenoh.Session:
        """Where the token of a publisher lives: on a transport whose lease is not longer than its own.

        Also that of a MANUAL one: who is frozen withdraws no token.
        """
        if qos.liveliness is Liveliness.NONE or not is_finite(qos.lease_ms) or qos.lease_ms >= self.lease_ms:
            return self.zenoh
        with self.dispatching:
            if qos.lease_ms not in self._transports:
                joined = self._network.join(self, self.locator, qos.lease_ms)
                self._transports[qos.lease_ms] = joined.session
            return self._transports[qos.lease_ms]

    def _translated(self) -> _Translated:
        return _Translated()

    def _expire(self) -> int:
        """On the thread that watches over leases."""
        now = self.clock.now_ns()
        return min((publisher.expire(now) for publisher in self.publishers()), default=NEVER)


_living: weakref.WeakSet[ZenohSession] = weakref.WeakSet()


@atexit.register
def _end() -> None:
    """Else zenoh 1.10.2 calls its listeners also when Python is no more, which ends the process with SIGSEGV."""
    for session in tuple(_living):
        session.destroy()


class _Translated:
    """zenoh's error as the contract's."""

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, zenoh.ZError):
            raise RmwError(ReturnCode.ERROR, str(error)) from error


def _callback(function: Callable[[Any], None]) -> Any:
    """Called on zenoh's own threads: with ``indirect`` the binding would start one for each handler."""
    return zenoh.handlers.Callback(function, indirect=False)


def _bytes(extra: zenoh.ZBytes | None) -> bytes | None:
    return None if extra is None else extra.to_bytes()  # an empty one is false, and not None
